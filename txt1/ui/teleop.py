"""Driving with w, a, s, d from a terminal, which reports a key's press but never its release.

So a key counts as held for HOLD seconds after its last press (a keyboard repeats a held key long before), and then its
effect decays within DECAY seconds. Only the last of several held keys repeats. So pressing a or d also renews a hold of
w or s; otherwise a curve could not be driven.

``a`` turns the steering wheel left, as in a car. Forwards the robot turns left (omega > 0). In reverse the front wheels
point left, too, and the yaw rate is negative.
"""

from dataclasses import dataclass
from math import inf
from typing import Final

from txt1.control.hand import DEFAULT_HAND, Hand

# s that a key counts as held after its last press
HOLD: Final = 0.7
# s from the end of the hold to zero
DECAY: Final = 0.3
SPEED_MIN: Final = 0.1
SPEED_STEP: Final = 0.1  # m/s
_DRIVE: Final = {"w": 1, "s": -1}
_STEER: Final = {"a": 1, "d": -1}


@dataclass
class Teleop:
    """Velocity commands from key presses. Times are s of the run.

    `speed` is that of w and s in m/s; + and - change it, up to the car's fastest. `hand` has the car's numbers.
    """

    speed: float = 0.5
    hand: Hand = DEFAULT_HAND

    def __post_init__(self) -> None:
        self.speed = min(self.speed, self.hand.v_max)
        self.release()

    def release(self) -> None:
        """Release every key at once; the next `command` is None."""
        # direction and time of the last press
        self._drive = self._steer = (0, -inf)
        self._active = False

    def key(self, key: str, now: float) -> None:
        """Take a key press, which replaces the opposite key at once; other keys are ignored."""
        if key in _DRIVE:
            self._drive = _DRIVE[key], now
        elif key in _STEER:
            self._steer = _STEER[key], now
            direction, pressed = self._drive
            if now - pressed <= HOLD:
                self._drive = direction, now
        elif key in ("+", "-"):
            speed = round(self.speed + (SPEED_STEP if key == "+" else -SPEED_STEP), 1)
            self.speed = min(self.hand.v_max, max(SPEED_MIN, speed))
        self._active |= key in _DRIVE or key in _STEER

    def command(self, now: float) -> tuple[float, float] | None:
        """Return (v, omega) in m/s and rad/s; None if the keyboard commands nothing.

        After the last decay it is (0, 0) once, then None: an idle keyboard does not override a program.
        """
        if not self._active:
            return None
        drive, steer = (
            direction * min(1.0, max(0.0, (HOLD + DECAY - (now - pressed)) / DECAY))
            for direction, pressed in (self._drive, self._steer)
        )
        self._active = bool(drive or steer)
        return self.hand.velocity(self.speed, drive, self.hand.turn * steer, wheel=True)
