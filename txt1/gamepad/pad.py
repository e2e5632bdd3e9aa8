"""Meaning of a gamepad's buttons and axes: a dead-man, two axes for the hand rule (`txt1.control.hand`), a few buttons.

A dead-man button that is down is no proof of a hand: a pad whose radio is out of reach keeps its last state. So the
rule of `txt1.control.holding` holds for all pads together, and a report that tells something new is a sign of a hand.

Buttons and axes have SDL's names of a game controller (a, b, leftx, righttrigger ...), which are the same on every pad.
The module uses no clock and no device: `now` is s on any clock.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple, get_args

from annotated_types import Gt, Le

from txt1.control.hand import Hand, shaped
from txt1.control.holding import HOLD_LASTS, Hold
from txt1.errors import ConfigError
from txt1.units import Positive

Button = Literal[
    "a",
    "b",
    "x",
    "y",
    "back",
    "guide",
    "start",
    "leftstick",
    "rightstick",
    "leftshoulder",
    "rightshoulder",
    "dpup",
    "dpdown",
    "dpleft",
    "dpright",
]
Axis = Literal["leftx", "lefty", "rightx", "righty", "lefttrigger", "righttrigger"]
BUTTONS: Final[tuple[str, ...]] = get_args(Button)
AXES: Final[tuple[str, ...]] = get_args(Axis)
# s for which the arm button has to be held
ARMS: Final = 0.5
# s after the appearance of a pad in which its presses are not fresh: its first report may come late
APPEARS: Final = 0.5

Silence = Annotated[float, Gt(0.0), Le(HOLD_LASTS)]


@dataclass(frozen=True, slots=True)
class PadParameters:
    """Driving with a gamepad; buttons and axes by SDL's names, the same on every pad."""

    speed: Positive | None = None
    """Speed at full deflection, m/s; null: the car's fastest, safety.v_max."""
    dead_man: Button = "a"
    """The robot moves only while it is held; the release of any pad's dead-man stops the robot."""
    stop: Button = "b"
    """Emergency stop, of any pad."""
    arm: Button = "start"
    """Arms when it is held for half a second."""
    screen: Button = "y"
    """The next screen."""
    manual: Button = "back"
    """Controller or manual mode."""
    ahead: Axis = "lefty"
    """Axis of the speed: away from you is ahead."""
    steer: Axis = "leftx"
    """Axis of the yaw rate: left is anticlockwise."""
    forward: Axis = "righttrigger"
    """Pulled, it sets the speed forwards in place of the axis, on pads with triggers."""
    reverse: Axis = "lefttrigger"
    """Pulled, it sets the speed backwards."""
    silence: Silence | None = None
    """s without a change in a pad's report after which its hold ends, at most 3; null: 3."""
    mapping: str | None = None
    """File with SDL's mappings of further pads; `txt1 gamepad --map FILE` writes it."""


def mapping_of(parameters: PadParameters) -> str | None:
    """Return the file with further mappings; raises ConfigError if there is no such file, as SDL does not tell it."""
    if parameters.mapping is not None and not Path(parameters.mapping).is_file():
        raise ConfigError(
            f"gamepad.mapping: there is no file {parameters.mapping}; `txt1 gamepad --map FILE` writes one"
        )
    return parameters.mapping


class PadState(NamedTuple):
    """A pad's reading: the pressed buttons; axes from -1 (left, away from you) to 1, triggers from 0."""

    buttons: frozenset[str] = frozenset()
    axes: Mapping[str, float] = {}


class Wish(NamedTuple):
    """The command of a pad: v in m/s and omega in rad/s while the dead-man is held, else None; and the pressed
    buttons.
    """

    velocity: tuple[float, float] | None = None
    stop: bool = False
    arm: bool = False
    screen: bool = False
    manual: bool = False


class Edges(NamedTuple):
    """The buttons of a pad that went down and up, and whether its arm button has been held long enough."""

    pressed: frozenset[str] = frozenset()
    released: frozenset[str] = frozenset()
    arm: bool = False


def velocity(reading: PadState, parameters: PadParameters, hand: Hand) -> tuple[float, float]:
    """Return the velocity for a pad's axes on this car, m/s and rad/s."""
    axes = reading.axes
    ahead = shaped(axes.get(parameters.forward, 0.0)) - shaped(axes.get(parameters.reverse, 0.0))
    if ahead == 0.0:
        ahead = -shaped(axes.get(parameters.ahead, 0.0))
    return hand.velocity(parameters.speed or inf, ahead, -shaped(axes.get(parameters.steer, 0.0)))


@dataclass(eq=False)
class Pad:
    """The buttons of one pad. Buttons that are down when it appears were not pressed."""

    parameters: PadParameters
    # time of its appearance
    since: float
    down: frozenset[str]
    # time since which the arm button is held
    _arming: float = inf

    def take(self, reading: PadState, now: float) -> Edges:
        """Return what has changed since the last reading."""
        p, before = self.parameters, self.down
        self.down = reading.buttons
        pressed = reading.buttons - before
        if now - self.since < APPEARS:
            # a stop counts from the first
            pressed -= {p.dead_man, p.arm}
        if p.arm not in reading.buttons:
            self._arming = inf
        elif p.arm in pressed:
            self._arming = now
        arm = now - self._arming >= ARMS
        if arm:
            # once
            self._arming = inf
        return Edges(pressed, before - reading.buttons, arm)


class Pads:
    """Several pads. The pad whose dead-man was pressed last drives; the release of any dead-man ends every hold."""

    def __init__(self, parameters: PadParameters, hand: Hand) -> None:
        self._parameters, self._hand = parameters, hand
        self._pads: dict[int, Pad] = {}
        self._hold = Hold(parameters.silence or HOLD_LASTS)

    @property
    def driver(self) -> int | None:
        """The number of the pad that holds."""
        return self._hold.by

    @property
    def expired(self) -> bool:
        """Whether the last hold ended without a sign of a hand."""
        return self._hold.expired

    def take(self, readings: Mapping[int, tuple[PadState, float]], now: float) -> Wish:
        """Return the common command of all pads.

        `readings` has each pad's reading and time of last report, by number.
        """
        p, hold = self._parameters, self._hold
        for gone in self._pads.keys() - readings.keys():
            del self._pads[gone]
            if gone == hold.by:
                hold.end(now)
        edges = {}
        for number, (reading, heard) in readings.items():
            pad = self._pads.setdefault(number, Pad(p, now, reading.buttons))
            edges[number] = pad.take(reading, now)
            hold.sign(number, heard)
        if any(p.dead_man in each.released for each in edges.values()):
            hold.end(now)
        for number, each in edges.items():
            if p.dead_man in each.pressed:
                hold.press(number, now)
        driver, pressed = hold.drives(now), frozenset[str]().union(*(each.pressed for each in edges.values()))
        return Wish(
            None if driver is None else velocity(readings[driver][0], p, self._hand),
            p.stop in pressed,
            any(each.arm for each in edges.values()),
            p.screen in pressed,
            p.manual in pressed,
        )
