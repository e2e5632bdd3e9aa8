"""Meaning of a gamepad's buttons and axes: a dead-man, two axes for the hand rule (`txt1.control.hand`), a few buttons.

Buttons and axes have SDL's names of a game controller (a, b, leftx, righttrigger ...), which are the same on every pad.
The module uses no clock and no device: `now` is s on any clock.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple

from txt1.control.hand import Hand, shaped
from txt1.units import Positive

BUTTONS: Final = (
    "a", "b", "x", "y", "back", "guide", "start", "leftstick", "rightstick", "leftshoulder", "rightshoulder",
    "dpup", "dpdown", "dpleft", "dpright",
)  # fmt: skip
AXES: Final = ("leftx", "lefty", "rightx", "righty", "lefttrigger", "righttrigger")
# s for which the arm button has to be held
HOLD: Final = 0.5


@dataclass(frozen=True, slots=True)
class PadParameters:
    """Driving with a gamepad; buttons and axes by SDL's names, the same on every pad."""

    speed: Positive | None = None
    """Speed at full deflection, m/s; null: the car's fastest, safety.v_max."""
    dead_man: str = "a"
    """The robot moves only while it is held; its release stops the robot."""
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
    """Pulled, it sets the speed forwards in place of the axis, on pads with triggers."""
    reverse: str = "lefttrigger"
    """Pulled, it sets the speed backwards."""
    silence: Positive | None = None
    """s without a report after which a pad counts as gone; for pads that report all the time, null for all others."""
    mapping: str | None = None
    """File with SDL's mappings of further pads; `txt1 gamepad --map FILE` writes it."""


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


def velocity(reading: PadState, parameters: PadParameters, hand: Hand) -> tuple[float, float]:
    """Return the velocity for a pad's axes on this car, m/s and rad/s."""
    axes = reading.axes
    ahead = shaped(axes.get(parameters.forward, 0.0)) - shaped(axes.get(parameters.reverse, 0.0))
    if ahead == 0.0:
        ahead = -shaped(axes.get(parameters.ahead, 0.0))
    return hand.velocity(parameters.speed or inf, ahead, -shaped(axes.get(parameters.steer, 0.0)))


@dataclass(eq=False)
class Pad:
    """One pad and its dead-man.

    If the dead-man is already down when the pad appears, or after a silence, it counts only after it was released once.
    """

    parameters: PadParameters
    hand: Hand
    # whether the dead-man has been released
    ready: bool = False
    _down: frozenset[str] = field(default_factory=frozenset)
    # time since which the arm button is held
    _arming: float = inf

    def take(self, reading: PadState, now: float, heard: float) -> Wish:
        """Return the command of a pad; its last report came at `heard`."""
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
            # once
            self._arming = inf
        return Wish(
            velocity(reading, p, self.hand) if held and self.ready and not silent else None,
            p.stop in pressed,
            arm,
            p.screen in pressed,
            p.manual in pressed,
        )


class Pads:
    """Several pads. The pad whose dead-man was held first drives, until its dead-man is released."""

    def __init__(self, parameters: PadParameters, hand: Hand) -> None:
        self._parameters, self._hand = parameters, hand
        self._pads: dict[int, Pad] = {}
        self.driver: int | None = None
        """The number of the driving pad."""

    def take(self, readings: Mapping[int, tuple[PadState, float]], now: float) -> Wish:
        """Return the common command of all pads.

        `readings` has each pad's reading and time of last report, by number.
        """
        for gone in self._pads.keys() - readings.keys():
            del self._pads[gone]
        wishes = {}
        for number, (reading, heard) in readings.items():
            pad = self._pads.setdefault(number, Pad(self._parameters, self._hand))
            wishes[number] = pad.take(reading, now, heard)
        if self.driver not in wishes or wishes[self.driver].velocity is None:
            self.driver = None
        for number, wish in wishes.items():
            if self.driver is None and wish.velocity is not None:
                self.driver = number
        for number, pad in self._pads.items():
            if number != self.driver and wishes[number].velocity is not None:
                # another pad takes over when its dead-man is pressed anew, not when the first is released
                pad.ready = False
        return Wish(
            None if self.driver is None else wishes[self.driver].velocity,
            *(any(wish[k] for wish in wishes.values()) for k in range(1, 5)),
        )
