"""Driving with w, a, s, d from a terminal, which tells when a key goes down and never when it comes up.

So a key counts as held for HOLD seconds after its last press (a keyboard repeats a held key long before),
and then its effect decays within DECAY seconds. Only the last of several held keys repeats: pressing a or d
therefore also renews a hold of w or s, or a bend could not be driven.

``a`` turns the steering wheel left, as in a car: forwards the robot turns left (omega > 0), and in reverse,
the front wheels still pointing left, its yaw rate is negative. omega = steering * turn * v / R_min, with
v's sign.
"""

from __future__ import annotations

from typing import Final

HOLD: Final = 0.7
"""s that a key counts as held after its last press."""

DECAY: Final = 0.3
"""s from the end of the hold to zero."""

SPEED_MIN: Final = 0.1
SPEED_MAX: Final = 1.5
SPEED_STEP: Final = 0.1
"""m/s."""

_DRIVE: Final = {"w": 1, "s": -1}
_STEER: Final = {"a": 1, "d": -1}


class Axis:
    """A direction, -1, 0 or 1, and when its key was last pressed, s."""

    __slots__ = ("direction", "pressed")

    def __init__(self) -> None:
        self.direction = 0
        self.pressed = 0.0

    def press(self, direction: int, now: float) -> None:
        """Take a key press; the opposite key replaces this one at once."""
        self.direction, self.pressed = direction, now

    def held(self, now: float) -> bool:
        """Whether the key still counts as held."""
        return self.direction != 0 and now - self.pressed <= HOLD

    def value(self, now: float) -> float:
        """The direction times what is left of it, in [-1, 1]."""
        left = (HOLD + DECAY - (now - self.pressed)) / DECAY
        return self.direction * min(1.0, max(0.0, left))


class Teleop:
    """Velocity commands from key presses. Times are s of the run.

    Args:
        speed: of w and s, m/s; + and - change it.
        turn: share of the yaw-rate limit that a and d command, 0 to 1.
        radius_min: R_min, m: the yaw-rate limit is abs(v) / R_min, (2.16).

    """

    def __init__(self, speed: float = 0.5, turn: float = 0.8, radius_min: float = 0.56) -> None:
        if not SPEED_MIN <= speed <= SPEED_MAX:
            raise ValueError(f"speed must be from {SPEED_MIN} to {SPEED_MAX} m/s, not {speed!r}")
        if not 0.0 <= turn <= 1.0:
            raise ValueError(f"turn must be from 0 to 1, not {turn!r}")
        self.speed = speed
        self.turn = turn
        self.radius_min = radius_min
        self.release()

    def release(self) -> None:
        """Let go of every key at once; the next `command` is None."""
        self._drive = Axis()
        self._steer = Axis()
        self._active = False

    def key(self, key: str, now: float) -> None:
        """Take a key press; keys of other meaning are ignored."""
        if key in _DRIVE:
            self._drive.press(_DRIVE[key], now)
            self._active = True
        elif key in _STEER:
            self._steer.press(_STEER[key], now)
            self._active = True
            if self._drive.held(now):
                self._drive.pressed = now
        elif key in ("+", "-"):
            speed = self.speed + (SPEED_STEP if key == "+" else -SPEED_STEP)
            self.speed = round(min(SPEED_MAX, max(SPEED_MIN, speed)), 1)

    def command(self, now: float) -> tuple[float, float] | None:
        """(v, omega) in m/s and rad/s, or None when the keyboard has nothing to say.

        After the last decay it is (0, 0) once, then None: an idle keyboard does not override a program.
        """
        if not self._active:
            return None
        drive, steer = self._drive.value(now), self._steer.value(now)
        self._active = bool(drive or steer)
        v = self.speed * drive
        return v, steer * self.turn * v / self.radius_min
