"""The values in the shared state of the tasks, and topics of those that a snapshot tells.

Every value is immutable and replaced whole, so a reader never sees half of an update and nothing needs a lock; this
is what the critical sections of the RTOS were for.
"""

from enum import StrEnum
from typing import Final, NamedTuple, TypeVar

from txt1.control.commander import Driver
from txt1.control.hand import Hand
from txt1.control.pid import Gains
from txt1.control.schedule import Schedule
from txt1.hal.base import BoardLink, Capabilities, Outputs
from txt1.kernel.statistics import Percentiles
from txt1.sim.obstacles import Outline
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

T = TypeVar("T")


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
    """The power switches: as they are, or as they were asked to be where nobody confirms it; None: nobody knows."""

    atx: bool | None = None
    esc: bool | None = None
    confirmed: bool = False


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

    The voltages were read or received at `time`, s of the run; `exhausted`: bad for so long that it is believed.
    """

    battery1: float | None = None
    battery2: float | None = None
    state: BatteryState | None = None
    remaining: float | None = None
    time: float = 0.0
    exhausted: bool = False


class LinkState(NamedTuple):
    """Whether the host was heard in the last second, and combined odometry came often enough."""

    alive: bool = False
    combined: bool = False


class Source(StrEnum):
    """Where the loops take the measured velocities from."""

    ENCODER = "encoder"
    COMBINED = "combined"
    # nothing measures them: they are what was asked for
    RECKONED = "reckoned"


class Control(NamedTuple):
    """The controller's last cycle: outputs behind the gate; set-point (m/s, rad/s) and angular gains in force."""

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
    """What the joystick has set: the screen, counted round and round, how far the gains are scrolled, manual mode.

    Nobody knows of manual mode where the loops run on a board: None.
    """

    screen: int = 0
    scroll: int = 0
    manual: bool | None = False


class Event(NamedTuple):
    """Something worth telling: when (s of the run) and what."""

    time: float
    text: str


class TaskReport(NamedTuple):
    """One task's statistics: rate in Hz (None on arrival), cycles, misses, lateness and run time in s."""

    name: str
    priority: int
    rate: float | None
    cycles: int
    misses: int
    lateness: Percentiles
    run_time: Percentiles


class Traffic(NamedTuple):
    """Messages received from the host and transmitted to it, and the age of the odometry in s."""

    received: int = 0
    transmitted: int = 0
    odometry_age: float = 0.0


class Surroundings(NamedTuple):
    """The room, the light's position (x, y), the robot's body, and what stands there, in m.

    Of the room length and width; of the body, too, and how far its centre is ahead of the pose.

    None is what nobody knows.
    """

    room: tuple[float, float] | None = None
    light: tuple[float, float] | None = None
    body: tuple[float, float, float] = (0.510, 0.385, 0.0)
    obstacles: tuple[Outline, ...] = ()


def _told(name: str, kind: type[T], about: str) -> Topic[T]:
    return declare(Topic(name, kind, "", "std_msgs/String", Rule.SNAPSHOT, about))


CAPABILITIES: Final = _told("/capabilities", Capabilities, "what the hardware layer can do")
HAND: Final = _told(
    "/hand", Hand, "the car's numbers for the hand rule; not in recordings, which have the configuration"
)
BOARD: Final = _told("/board", BoardLink, "the link to the board, where there is one")
COMMAND: Final = _told("/command", Command, "the latest velocity command")
GAIN_TABLE: Final = _told("/gain_table", GainTable, "the gains that were loaded")
SERVOS: Final[Topic[tuple[int, int]]] = _told("/servos", tuple, "counts of the two free servos")
TRAFFIC: Final = _told("/traffic", Traffic, "messages to and from the host, and how old the odometry is")
BACKLIGHT: Final = _told("/backlight", float, "brightness of the board's display, 0 to 1")
SURROUNDINGS: Final = _told("/surroundings", Surroundings, "the simulated room, light, obstacles, the robot's size")
WALLS: Final[Topic[tuple[Outline, ...]]] = _told("/walls", tuple[Outline, ...], "the walls of a map, closed lines: m")
VEHICLES: Final[Topic[tuple[tuple[float, float, float], ...]]] = _told(
    "/vehicles", tuple[tuple[float, float, float], ...], "the other robots' poses: m, rad"
)
TASK_REPORTS: Final[Topic[tuple[TaskReport, ...]]] = _told("/tasks", tuple[TaskReport, ...], "the tasks' statistics")
EVENTS: Final[Topic[tuple[Event, ...]]] = _told("/events", tuple[Event, ...], "the latest events, oldest first")
WARNINGS: Final[Topic[tuple[str, ...]]] = _told("/warnings", tuple[str, ...], "what is not at work beside the robot")
MOVERS: Final[Topic[tuple[Outline, ...]]] = _told(
    "/movers", tuple[Outline, ...], "the boxes that move in the simulated room: corners, m"
)
DRIVER: Final = declare(
    Topic(
        "/driver",
        Driver,
        "s",
        define(
            "txt1_msgs/Driver", "std_msgs/Header header\nstring name\nfloat64 since\nstring[] refused\nuint32[] times"
        ),
        Rule.CHANGE,
        "the source of commands that drives, and how many times each was refused",
        make=lambda driver: {
            "name": driver.name,
            "since": driver.since,
            "refused": list(driver.refused),
            "times": list(driver.refused.values()),
        },
    )
)


_WARN: Final = ("disarmed", "link lost", "batteries", "the robot does not", "the robot moves", "the estimate is off")
"""Beginnings of events that are warnings."""


def _log_message(event: Event) -> dict[str, object]:
    warns = event.text.startswith(_WARN)
    # ROS's WARN and INFO
    return {"level": 30 if warns else 20, "name": "txt1", "msg": event.text}


LOG: Final = declare(Topic("/rosout", Event, "", "rcl_interfaces/Log", Rule.EVENT, "the event log", make=_log_message))
