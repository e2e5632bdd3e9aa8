"""The values in the shared state of the tasks, and the topics for snapshots.

Every value is immutable and replaced whole. So a reader never sees half of an update, and no lock is needed. The
board's RTOS used critical sections for this.
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
    """A velocity command: v in m/s, omega in rad/s; time of its origin (s of the run) and the gate's epoch then."""

    v: float
    omega: float
    time: float
    epoch: int = 0


class ManualPwm(NamedTuple):
    """A PWM test command: counts of motor and steering; time of origin (s of the run) and the gate's epoch."""

    motor: int
    front: int
    rear: int
    time: float
    epoch: int = 0


class CombinedSample(NamedTuple):
    """Velocities from combined odometry in m/s and rad/s, and their time of arrival, s of the run."""

    v: float
    omega: float
    time: float


class Power(NamedTuple):
    """The power switches: True is on, False is off, None is unknown.

    If the HAL does not report them, they are as last requested.
    """

    atx: bool | None = None
    esc: bool | None = None
    confirmed: bool = False


class GainTable(NamedTuple):
    """The loaded gains; all zero at power-up, so the robot does not move."""

    linear: Gains = Gains()
    angular: Schedule = Schedule()
    loaded: bool = False


class BatteryState(StrEnum):
    """The state of the batteries, as on the board."""

    EXTERNAL = "external power"
    GOOD = "good"
    WARNING = "warning"
    BAD = "bad"


class Battery(NamedTuple):
    """Smoothed voltages (V), state, and remaining time under full load (s); None where the HAL has no battery.

    The voltages were read or received at `time`, s of the run; `exhausted`: they have been bad long enough to stop the
    robot.
    """

    battery1: float | None = None
    battery2: float | None = None
    state: BatteryState | None = None
    remaining: float | None = None
    time: float = 0.0
    exhausted: bool = False


class LinkState(NamedTuple):
    """Whether the host was heard in the last second, and whether combined odometry came often enough."""

    alive: bool = False
    combined: bool = False


class Source(StrEnum):
    """The source of the measured velocities for the loops."""

    ENCODER = "encoder"
    COMBINED = "combined"
    # without a measurement the commanded velocities stand in
    RECKONED = "reckoned"


class Control(NamedTuple):
    """The controller's last cycle: outputs after the gate; set-point (m/s, rad/s) and angular gains in force."""

    outputs: Outputs = Outputs()
    v: float = 0.0
    omega: float = 0.0
    source: Source = Source.ENCODER
    gains: Gains = Gains()


class Encoders(NamedTuple):
    """Ticks of the right and left encoder in the last period; None without encoders."""

    right: int | None = None
    left: int | None = None


class Panel(NamedTuple):
    """The settings made with the joystick: number of the screen, number of gain sets scrolled past, manual mode.

    Manual mode is None if the loops run on a board, which does not report it.
    """

    screen: int = 0
    scroll: int = 0
    manual: bool | None = False


class Event(NamedTuple):
    """A line of the event log: time (s of the run) and text."""

    time: float
    text: str


class TaskReport(NamedTuple):
    """Statistics of one task: rate in Hz (None on arrival), cycles, misses, lateness and run time in s."""

    name: str
    priority: int
    rate: float | None
    cycles: int
    misses: int
    lateness: Percentiles
    run_time: Percentiles


class Traffic(NamedTuple):
    """Numbers of messages received from the host and sent to it, and the age of the odometry in s."""

    received: int = 0
    transmitted: int = 0
    odometry_age: float = 0.0


class Surroundings(NamedTuple):
    """The room, the light's position (x, y), the robot's body, and the obstacles, in m.

    `room` is length and width. `body` is length, width, and the distance of its centre ahead of the pose.

    Unknown values are None.
    """

    room: tuple[float, float] | None = None
    light: tuple[float, float] | None = None
    body: tuple[float, float, float] = (0.510, 0.385, 0.0)
    obstacles: tuple[Outline, ...] = ()


def _told(name: str, kind: type[T], about: str) -> Topic[T]:
    return declare(Topic(name, kind, "", "std_msgs/String", Rule.SNAPSHOT, about))


CAPABILITIES: Final = _told("/capabilities", Capabilities, "abilities of the hardware layer")
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
SEEN: Final[Topic[tuple[tuple[float, float], ...]]] = _told(
    "/seen", tuple[tuple[float, float], ...], "some points that the lasers of a simulation see in the room: m"
)
PAGE: Final = _told("/page", str, "the address at which the web page answers")
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


_WARN: Final = (
    "disarmed", "link lost", "batteries", "the robot does not", "the robot moves", "the estimate is off", "commands of",
)  # fmt: skip
"""Beginnings of events that ROS gets as warnings."""


def _log_message(event: Event) -> dict[str, object]:
    # ROS's WARN and INFO
    return {"level": 30 if event.text.startswith(_WARN) else 20, "name": "txt1", "msg": event.text}


LOG: Final = declare(Topic("/rosout", Event, "", "rcl_interfaces/Log", Rule.EVENT, "the event log", make=_log_message))
