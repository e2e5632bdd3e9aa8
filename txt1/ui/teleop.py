"""Driving with w, a, s, d from a terminal, which reports a key's press but never its release.

So a key counts as held for KEY_HELD seconds after its last press (a keyboard repeats a held key long before), and then
its effect decays within DECAY seconds. Only the last of several held keys repeats. So pressing a or d also renews a
hold of w or s; otherwise a curve could not be driven.

Repeats are made by the computer, also when a key's release was lost, so they prove no hand (`txt1.control.holding`). A
press is fresh if it is of another key than the press before, or comes after KEY_HELD seconds without one; any other
press counts as a repeat. Repeats count for HOLD_LASTS - KEY_HELD seconds after the last fresh press. So a key that
nobody holds moves the robot for HOLD_LASTS seconds and the decay, and then only a fresh press moves it.

``a`` turns the steering wheel left, as in a car. Forwards the robot turns left (omega > 0). In reverse the front wheels
point left, too, and the yaw rate is negative.
"""

from dataclasses import dataclass
from math import inf
from typing import Final

from txt1.control.hand import DEFAULT_HAND, Hand
from txt1.control.holding import HOLD_LASTS, Hold
from txt1.errors import CommandRefused

# s that a key counts as held after its last press
KEY_HELD: Final = 0.7
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
        # the last press of a driving key: its time, and the key
        self._pressed, self._last = -inf, ""
        # the last call of `command`
        self._listened = -inf
        self._hold = Hold(HOLD_LASTS - KEY_HELD)
        # whether a repeat came after the end of the hold
        self._refused = False
        self.release()

    def release(self) -> None:
        """Release every key at once; the next `command` is None."""
        # direction and time of the last press
        self._drive = self._steer = (0, -inf)
        self._active = self._refused = False
        self._hold.end(-inf)

    def key(self, key: str, now: float) -> str:
        """Take a key press, which replaces the opposite key at once; other keys are ignored.

        Returns the new speed, in words, after + and -; "" after any other key.
        """
        if key in _DRIVE or key in _STEER:
            # no press for a while is a release, unless nobody listened meanwhile: the computer may have stood still
            paused = now - self._pressed > KEY_HELD and now - self._listened <= KEY_HELD
            if key != self._last or paused:
                self._hold.press(0, now)
            self._last, self._pressed = key, now
            if self._hold.drives(now) is None:
                self._refused = True
                return ""
        if key in _DRIVE:
            self._drive = _DRIVE[key], now
        elif key in _STEER:
            self._steer = _STEER[key], now
            direction, pressed = self._drive
            if now - pressed <= KEY_HELD:
                self._drive = direction, now
        elif key in ("+", "-"):
            speed = round(self.speed + (SPEED_STEP if key == "+" else -SPEED_STEP), 1)
            self.speed = min(self.hand.v_max, max(SPEED_MIN, speed))
            return f"w and s drive {self.speed:g} m/s, of {SPEED_MIN:g} to {self.hand.v_max:g}"
        self._active |= key in _DRIVE or key in _STEER
        return ""

    def command(self, now: float) -> tuple[float, float] | None:
        """Return (v, omega) in m/s and rad/s; None if the keyboard commands nothing.

        After the last decay it is (0, 0) once, then None: an idle keyboard does not override a program. Raises
        CommandRefused, in place of this zero: repeats go on after the end of the hold.
        """
        self._listened = now
        if not self._active:
            return None
        drive, steer = (
            direction * min(1.0, max(0.0, (KEY_HELD + DECAY - (now - pressed)) / DECAY))
            for direction, pressed in (self._drive, self._steer)
        )
        self._active = bool(drive or steer)
        if self._refused and not self._active:
            raise CommandRefused(
                f"'{self._last}' repeats for {HOLD_LASTS:g} s, as if its release was lost: let go and press again, "
                "or press another key"
            )
        return self.hand.velocity(self.speed, drive, self.hand.turn * steer, wheel=True)
