"""Every input of the tasks from outside, exact, with its place among their steps: a replay needs it."""

from typing import Any, Final, NamedTuple

from txt1.protocol.messages import Velocity
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare


class Input(NamedTuple):
    """An input of the tasks from outside: a message or action of a `kind`, with its numbers and text.

    `step` counts the scheduler's steps before it. `source` is the task (a user's or the driver's) that gave it, "" for
    none; the present step of this task is counted. `given` is the time of its origin, s of the run.
    """

    step: int
    source: str
    kind: str
    text: str
    given: float
    values: tuple[float, ...]


INPUT: Final = declare(
    Topic(
        "/input",
        Input,
        "",
        define(
            "txt1_msgs/Input",
            "std_msgs/Header header\nuint32 step\nstring source\nstring kind\nstring text\nfloat64 given\n"
            "float64[] values",
        ),
        Rule.EVENT,
        "everything given to the tasks from outside",
        make=lambda given: given,
        own=True,
    )
)


class Report(NamedTuple):
    """A value that was read: a sensor's reading, or the hardware's report.

    `step` counts the scheduler's steps up to it; the present step of the reading task is counted. The `source` is "hal"
    or the name of the task that reads a sensor. A sensor's kinds are "reading", "fails" with the error's `text`, "idle"
    when its readings are no longer needed, and "asked" when they are needed again. The hardware's kinds are "read",
    "write" and its other calls, each with the error's text if it fails, and once "hardware", with its name and
    `Capabilities`.
    """

    step: int
    source: str
    kind: str
    text: str = ""
    # time at which a reading was taken, s of the run
    time: float = 0.0
    value: Any = None


def _report(report: Report) -> dict[str, Any]:
    """Return the fields of a report's message. A value without exact bytes has no data; the replay then says so."""
    # imported here: only a recorder needs it
    from txt1.telemetry import exact

    told: dict[str, Any] = report._asdict()
    value = told.pop("value")
    try:
        told["data"] = b"" if value is None else exact.encode(value)
    except (TypeError, ValueError, ArithmeticError):
        told["data"] = b""
    return told


REPORT: Final = declare(
    Topic(
        "/reports",
        Report,
        "s",
        define(
            "txt1_msgs/Report",
            "std_msgs/Header header\nuint32 step\nstring source\nstring kind\nstring text\nfloat64 time\nuint8[] data",
        ),
        Rule.EVENT,
        "every reading of a sensor, and on real hardware what it reported, exactly",
        {"header": {"frame_id": ""}},
        make=_report,
        own=True,
    )
)
STEP: Final = declare(
    Topic[tuple[int, float, int]](
        "/steps",
        tuple,
        "",
        define("txt1_msgs/Step", "std_msgs/Header header\nuint32 task\nfloat64 time\nuint32 missed"),
        Rule.EVENT,
        "each step of a task and the cycles missed before it, on the real clock",
        {},
        ("task", "time", "missed"),
        lambda step: step,
        own=True,
    )
)
COMMAND: Final = declare(
    Topic(
        "/cmd_vel",
        Velocity,
        "m/s, rad/s",
        "geometry_msgs/TwistStamped",
        Rule.EVENT,
        "velocities asked for, before the safety gate",
        {"header": {"frame_id": "base_footprint"}},
        ("twist.linear.x", "twist.angular.z"),
        lambda asked: (asked.v, asked.omega),
    )
)
