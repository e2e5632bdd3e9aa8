"""What a gamepad's buttons and axes mean: a dead-man, the original's rule for speed and yaw rate, and a few buttons.

Buttons and axes go by SDL's names of a game controller (a, b, leftx, righttrigger ...), the same on every pad. No clock
and no device in here: `now` is s on any clock.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import copysign, inf, isfinite
from typing import Final, NamedTuple

from txt1.units import Positive

BUTTONS: Final = (
    "a", "b", "x", "y", "back", "guide", "start", "leftstick", "rightstick", "leftshoulder", "rightshoulder",
    "dpup", "dpdown", "dpleft", "dpright",
)  # fmt: skip
AXES: Final = ("leftx", "lefty", "rightx", "righty", "lefttrigger", "righttrigger")
HOLD: Final = 0.5  # s that the arm button is held
DEAD: Final = 0.1  # share of an axis around its middle that counts as none


@dataclass(frozen=True, slots=True)
class PadParameters:
    """Driving with a gamepad; buttons and axes by SDL's names, the same on every pad."""

    speed: Positive = 1.5
    """Speed at full deflection, m/s: the original's."""
    dead_man: str = "a"
    """Nothing moves unless it is held; its release stops the robot."""
    stop: str = "b"
    """Emergency stop, of any pad."""
    arm: str = "start"
    """Arms when it is held for half a second."""
    screen: str = "y"
    """The next screen."""
    manual: str = "back"
    """Controller or manual mode."""
    ahead: str = "lefty"
    """Axis of the speed: away from you is ahead."""
    steer: str = "leftx"
    """Axis of the yaw rate: left is anticlockwise."""
    forward: str = "righttrigger"
    """Pulled, it sets the speed in place of the axis, where a pad has it."""
    reverse: str = "lefttrigger"
    """... and this one backwards."""
    silence: Positive | None = None
    """s without a report after which a pad counts as gone; for pads that report all the time, null for others."""
    mapping: str | None = None
    """File with SDL's mappings of pads that it does not know; `txt1 gamepad --map FILE` writes one."""


class PadState(NamedTuple):
    """A pad now: the buttons that are down; axes from -1 (left, away from you) to 1, triggers from 0."""

    buttons: frozenset[str] = frozenset()
    axes: Mapping[str, float] = {}


class Wish(NamedTuple):
    """What a pad's hand wants: v in m/s, omega in rad/s while the dead-man is held, else None; and what was pressed."""

    velocity: tuple[float, float] | None = None
    stop: bool = False
    arm: bool = False
    screen: bool = False
    manual: bool = False


def shaped(value: float) -> float:
    """An axis without its dead middle, -1 to 1; one that is no number is at rest."""
    if not isfinite(value):
        return 0.0
    size = min(1.0, max(0.0, (abs(value) - DEAD) / (1.0 - DEAD)))
    return copysign(size, value)


def velocity(reading: PadState, parameters: PadParameters, radius_min: float) -> tuple[float, float]:
    """The original's rule: v = speed times one axis, omega = abs(v) / R_min times the other; m/s and rad/s."""
    axes = reading.axes
    ahead = shaped(axes.get(parameters.forward, 0.0)) - shaped(axes.get(parameters.reverse, 0.0))
    if ahead == 0.0:
        ahead = -shaped(axes.get(parameters.ahead, 0.0))
    v = parameters.speed * ahead
    return v, abs(v) / radius_min * -shaped(axes.get(parameters.steer, 0.0)) + 0.0  # never -0.0, which looks odd


@dataclass(eq=False)
class Pad:
    """One pad and its dead-man.

    A dead-man that is down when the pad comes, or when it was silent, counts only after it was up once.
    """

    parameters: PadParameters
    radius_min: float  # m
    ready: bool = False  # the dead-man has been up
    _down: frozenset[str] = field(default_factory=frozenset)
    _arming: float = inf  # since when the arm button is held

    def take(self, reading: PadState, now: float, heard: float) -> Wish:
        """What the hand wants; the pad has been heard last at `heard`."""
        p, pressed = self.parameters, reading.buttons - self._down
        self._down = reading.buttons
        held = p.dead_man in reading.buttons
        silent = p.silence is not None and now - heard > p.silence
        if silent or not held:
            self.ready = not silent
        if p.arm not in reading.buttons:
            self._arming = inf
        elif p.arm in pressed:
            self._arming = now
        arm = now - self._arming >= HOLD and not silent
        if arm:
            self._arming = inf  # once
        return Wish(
            velocity(reading, p, self.radius_min) if held and self.ready and not silent else None,
            p.stop in pressed,
            arm,
            p.screen in pressed,
            p.manual in pressed,
        )


class Pads:
    """Several pads, of which one drives: the one whose dead-man was held first, until it is let go of."""

    def __init__(self, parameters: PadParameters, radius_min: float) -> None:
        self._parameters, self._radius_min = parameters, radius_min
        self._pads: dict[int, Pad] = {}
        self.driver: int | None = None
        """The number of the pad that drives."""

    def take(self, readings: Mapping[int, tuple[PadState, float]], now: float) -> Wish:
        """What they want together; `readings`, and when each was heard last, by the numbers of all that there are."""
        for gone in self._pads.keys() - readings.keys():
            del self._pads[gone]
        wishes = {}
        for number, (reading, heard) in readings.items():
            pad = self._pads.setdefault(number, Pad(self._parameters, self._radius_min))
            wishes[number] = pad.take(reading, now, heard)
        if self.driver not in wishes or wishes[self.driver].velocity is None:
            self.driver = None
        for number, wish in wishes.items():
            if self.driver is None and wish.velocity is not None:
                self.driver = number
        for number, pad in self._pads.items():
            if number != self.driver and wishes[number].velocity is not None:
                pad.ready = False  # it takes over when it is pressed anew, not when the other lets go
        return Wish(
            None if self.driver is None else wishes[self.driver].velocity,
            *(any(wish[k] for wish in wishes.values()) for k in range(1, 5)),
        )
