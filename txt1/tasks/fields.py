"""What the tasks share, as values: the fields of `txt1.tasks.state.State`, and all of them at one instant.

Every value is immutable and replaced whole, so a reader never sees half of an update.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final, NamedTuple

from txt1.control.pid import Gains
from txt1.control.schedule import Schedule
from txt1.hal.base import BoardLink, Capabilities, Outputs
from txt1.kernel.statistics import Percentiles
from txt1.model.odometry import Odometry


class Command(NamedTuple):
    """A velocity command: v in m/s, omega in rad/s, when its author gave it (s of the run), the gate's epoch then."""

    v: float
    omega: float
    time: float
    epoch: int = 0


class ManualPwm(NamedTuple):
    """A PWM test command: counts of motor and steering, when its author gave it (s of the run), the epoch then."""

    motor: int
    front: int
    rear: int
    time: float
    epoch: int = 0


class CombinedSample(NamedTuple):
    """Combined odometry's velocities in m/s and rad/s, and when they arrived, s of the run."""

    v: float
    omega: float
    time: float


class Power(NamedTuple):
    """The power switches; both on at power-up."""

    atx: bool = True
    esc: bool = True


class GainTable(NamedTuple):
    """The gains that were loaded; all zero at power-up, so nothing moves."""

    linear: Gains = Gains()
    angular: Schedule = Schedule()
    loaded: bool = False


class BatteryState(StrEnum):
    """How the batteries are (the board's states)."""

    EXTERNAL = "external power"
    GOOD = "good"
    WARNING = "warning"
    BAD = "bad"


class Battery(NamedTuple):
    """Smoothed voltages (V), state, and remaining time under full load (s); None where the HAL has no battery.

    Attributes:
        time: when the voltages were read or received, s of the run.
        exhausted: the state has been bad for so long that it is believed.

    """

    battery1: float | None = None
    battery2: float | None = None
    state: BatteryState | None = None
    remaining: float | None = None
    time: float = 0.0
    exhausted: bool = False


class LinkState(NamedTuple):
    """What the mode task found in the last second."""

    alive: bool = False
    combined: bool = False


class Source(StrEnum):
    """Where the loops take the measured velocities from."""

    ENCODER = "encoder"
    COMBINED = "combined"


class Control(NamedTuple):
    """What the controller did in its last cycle.

    Attributes:
        outputs: as they left the safety gate.
        v: set-point in force, m/s.
        omega: set-point in force, rad/s.
        source: of the measured velocities.
        gains: angular gains in force.

    """

    outputs: Outputs = Outputs()
    v: float = 0.0
    omega: float = 0.0
    source: Source = Source.ENCODER
    gains: Gains = Gains()


class Encoders(NamedTuple):
    """Ticks of the right and left encoder in the last period; None for a HAL without them."""

    right: int | None = None
    left: int | None = None


class Panel(NamedTuple):
    """What the joystick has set: which screen, how far the gains are scrolled, manual mode."""

    screen: int = 0
    scroll: int = 0
    manual: bool = False


class Event(NamedTuple):
    """Something worth telling: when (s of the run) and what."""

    time: float
    text: str


SCREENS: Final = ("STATUS", "PWM", "ENCODERS", "PID GAINS", "MAP", "TASKS")
"""The screens in the order of the joystick: the LCD's four, and two that it could not show."""


class TaskReport(NamedTuple):
    """One task's statistics: rate in Hz (None on arrival), cycles, misses, lateness and run time in s."""

    name: str
    priority: int
    rate: float | None
    cycles: int
    misses: int
    lateness: Percentiles
    run_time: Percentiles


class Snapshot(NamedTuple):
    """Everything the screens show, at one instant.

    Attributes:
        time: s of the run.
        hal: name of the HAL.
        capabilities: what it can do; what it cannot is shown as a dash.
        armed: the safety gate is open.
        stopped: the emergency stop is latched.
        reason: why the gate is closed, empty when it is open.
        faults: counters of the safety gate and the tasks, by name.
        board: the link to the board; None for a HAL without one.
        odometry_age: of the odometry, s.
        room: length and width of the room in m, and the light's position (x, y); None when unknown.

    The others are the state's fields of the same name.

    """

    time: float
    hal: str
    capabilities: Capabilities
    armed: bool
    stopped: bool
    reason: str
    faults: dict[str, int]
    command: Command | None
    gains: GainTable
    power: Power
    servos: tuple[int, int]
    received: int
    transmitted: int
    encoders: Encoders
    odometry: Odometry
    pose: tuple[float, float, float] | None
    board: BoardLink | None
    odometry_age: float
    link: LinkState
    control: Control
    battery: Battery
    panel: Panel
    backlight: float | None
    buzzer: bool
    room: tuple[float, float] | None
    light: tuple[float, float] | None
    tasks: tuple[TaskReport, ...]
    events: tuple[Event, ...]
