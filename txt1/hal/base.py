"""The interface between the tasks and the hardware, real or simulated.

A hardware layer (HAL) has a few methods, and capabilities that say what it can do. The tasks ask for a capability,
never for the HAL's name. `txt1.hal.conformance` checks any HAL against the rules in this module.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Final, NamedTuple, Protocol

from txt1.control.limits import Outputs
from txt1.model.odometry import Odometry
from txt1.protocol.messages import CombinedOdometry, PidSet, Switch
from txt1.sim.parameters import Box
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

__all__ = ["LINK", "BoardLink", "Button", "Capabilities", "Hal", "Indicators", "Inputs", "Outputs"]

LINK: Final = declare(
    Topic[tuple[str, bytes]](
        "/link",
        tuple,
        "bytes",
        define("txt1_msgs/LinkBytes", "std_msgs/Header header\nstring direction\nuint8[] data"),
        Rule.EVENT,
        'the bytes on the line to the board, "in" or "out"',
        make=lambda piece: {"direction": piece[0], "data": piece[1]},
    )
)


class Button(IntFlag):
    """The joystick on the board."""

    NONE = 0
    LEFT = 1
    RIGHT = 2
    UP = 4
    DOWN = 8
    CENTRE = 16


@dataclass(frozen=True)
class Capabilities:
    """The abilities of a HAL.

    Values that it lacks are dashes on the screens. The API refuses a call that needs a missing ability, and names it.
    """

    ticks: bool = False
    """Reports encoder counts."""
    odometry: bool = False
    """Reports odometry that it computes itself; a HAL without `pwm` always does."""
    pwm: bool = False
    """Takes PWM outputs, so the velocity loops run in txt1; otherwise it takes set-points and closes its own loops."""
    gains: bool = False
    """Takes gains for its own loops."""
    combined: bool = False
    """Takes combined odometry for its own loops."""
    battery: bool = False
    """Reports battery voltages."""
    smoothed: bool = False
    """Reports voltages that are already smoothed."""
    power: bool = False
    """Has the switches for the ATX supply and the ESC."""
    power_known: bool = False
    """Knows the state of the switches, both on at first; otherwise a state is asked for, and never confirmed."""
    halt: bool = False
    """May disobey a stop, and has `halt` as a stronger means: stops are verified."""
    servos: bool = False
    """Has the two free servo channels."""
    buttons: bool = False
    """Has the joystick."""
    place: bool = False
    """Can put the robot down at a pose: a simulator."""
    pose: bool = False
    """Knows the robot's true pose in the room: a simulator."""
    simulated: bool = False
    """Moves nothing real, so the robot arms by itself."""
    repeats: bool = False
    """Its reports follow from the calls and their times alone, also on the real clock: a replay runs it again."""

    @property
    def by_hand(self) -> bool:
        """Whether somebody may set its PWM channels by hand."""
        return self.pwm

    @property
    def blind(self) -> bool:
        """Whether it takes PWM but measures no motion: a speed map drives it, and its odometry is dead reckoning."""
        return self.pwm and not (self.ticks or self.odometry)


class BoardLink(NamedTuple):
    """The state of the link to a board."""

    # the board has been heard for long enough to be sent a set-point
    ready: bool
    # number of losses of the board so far; each disarms
    losses: int
    # reason for the last loss, in words
    reason: str
    # the last event on the line
    text: str
    # numbers of faults on the line so far, by name
    faults: dict[str, int]
    # whether the board has acknowledged all gains that were sent since it was found
    gains: bool = True
    # whether there is a line for sending
    connected: bool = True


class Inputs(NamedTuple):
    """The hardware's report of an instant; None for values without a sensor."""

    ticks: tuple[int, int] | None = None
    """Encoder counts (right, left) since the start, forward positive."""
    odometry: Odometry | None = None
    """Odometry that the hardware computed itself."""
    odometry_time: float = 0.0
    """Arrival of the odometry, s of the run."""
    batteries: tuple[float, float] | None = None
    """Voltages of the two packs, V; 0 for a pack that is not connected."""
    cut_off: bool = False
    """The battery cut-off circuit has opened."""
    buttons: Button = Button.NONE
    """The buttons that are held down."""
    backlight: float | None = None
    """Position of the display's potentiometer, 0 to 1."""
    pose: tuple[float, float, float] | None = None
    """True pose (x, y, theta) in the room, m and rad."""
    link: BoardLink | None = None
    battery_time: float | None = None
    """Arrival of the voltages, s of the run; None: just now."""
    held: bool = False
    """Whether its motors do not follow the outputs at present, as an ESC that brakes before it reverses."""


class Indicators(NamedTuple):
    """Buzzer and LEDs of the power distribution board."""

    buzzer: bool = False
    receive_led: bool = False
    transmit_led: bool = False


class Hal(Protocol):
    """A hardware layer. `read` and `write` never wait: they are called from the tasks' steps.

    Each of these two takes less than 0.2 ms of the processor.

    Times are seconds since the run started and never go backwards. An exception derived from HalError stops the
    robot and reaches the user; a method without its capability raises NotCapable, one of these.

    `txt1.hal.PlainHal` has all members but `open`, `close`, `read` and `write`. Those from `own_channels` on are for a
    few layers only; the plain ones know nothing and do nothing.
    """

    @property
    def name(self) -> str:
        """The HAL's registered name."""

    @property
    def capabilities(self) -> Capabilities:
        """The abilities of this HAL; constant."""

    async def open(self) -> None:
        """Make the hardware ready, with neutral outputs; raises HalError with the cause and the remedy."""

    async def close(self) -> None:
        """Set the outputs to neutral and release the hardware; harmless when it is already closed."""

    def read(self, now: float) -> Inputs:
        """Return the sensors' report at `now`."""

    def write(self, outputs: Outputs, now: float) -> None:
        """Hold these outputs from `now` on."""

    def halt(self, outputs: Outputs, now: float) -> None:
        """Set these neutral outputs directly, past loops and modes that do not obey `write`."""

    def switch(self, switch: Switch, on: bool, now: float) -> None:
        """Turn a power supply on or off."""

    def load_gains(self, gains: PidSet, answered: Callable[[bool], None]) -> None:
        """Send these gains to the hardware's own loops, and again when the hardware was away.

        `answered` is called with True or False, accepted or not, each time that the hardware answers.
        """

    def offer_odometry(self, combined: CombinedOdometry, now: float) -> None:
        """Hand combined odometry to the hardware's own loops."""

    def indicate(self, indicators: Indicators) -> None:
        """Set buzzer and LEDs; does nothing when there are none."""

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        """Place the robot at a pose in the room, at rest; m and rad. Raises ValueError if there is no room for it."""

    @property
    def own_channels(self) -> Any:
        """Its own settings for motor and servo, which stand in place of `channels`; None for a layer without them."""

    @property
    def esc(self) -> bool:
        """Whether ESCs drive its motors, whose way into reverse is the setting `hal_options.reverse`."""

    @property
    def waits(self) -> bool:
        """Whether its whole world is in this process, so its time may wait while the computer is busy.

        Any other layer counts as hardware: too many missed cycles disarm it, and so does a computer that slept.
        """

    def tap_line(self, tap: Callable[[str, bytes], None]) -> bool:
        """Call `tap` from now on with all bytes on the line to a board, as they come ("in") and go ("out").

        Return whether there is a line whose bytes are recorded.
        """

    def clear_loops(self, now: float) -> None:
        """Clear what the hardware's own loops wound up while the robot was held: it is to stand when it may move."""

    def blocked_by(self) -> str | None:
        """Return the thing that the robot has run into, in words; None if it has room, or nobody knows."""

    def attitude(self) -> tuple[float, float]:
        """Return the true roll and pitch of the ground below the robot, rad; 0 if they are unknown."""

    def others(self) -> tuple[tuple[float, float, float], ...]:
        """Return the true poses of the other vehicles in the world, m and rad."""

    def movers(self) -> Sequence[Box]:
        """Return the boxes that move in the world, at their present places."""


def lacking(hal: object) -> list[str]:
    """Return the names of the members of a hardware layer that an object does not have."""
    return [name for name in vars(Hal) if not name.startswith("_") and not hasattr(hal, name)]
