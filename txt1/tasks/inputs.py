"""Everything given to the tasks from outside, exact and with its place among their steps: what a replay needs."""

from typing import Final, NamedTuple

from txt1.protocol.messages import Velocity
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare


class Input(NamedTuple):
    """Something given to the tasks from outside: a message or an action of that `kind`, with its numbers and text.

    `step` counts the scheduler's steps before it, that of the `source` included: the task of the user's or the driver's
    that gave it, empty for none. Its author gave it at `given`, s of the run.
    """

    step: int
    source: str
    kind: str
    text: str
    given: float
    values: tuple[float, ...]


INPUT: Final = declare(Topic(
    "/input", Input, "",
    define(
        "txt1_msgs/Input",
        "std_msgs/Header header\nuint32 step\nstring source\nstring kind\nstring text\nfloat64 given\nfloat64[] values",
    ),
    Rule.EVENT, "everything given to the tasks from outside", make=lambda given: given,
))  # fmt: skip
STEP: Final = declare(Topic[tuple[int, float, int]](
    "/steps", tuple, "",
    define("txt1_msgs/Step", "std_msgs/Header header\nuint32 task\nfloat64 time\nuint32 missed"), Rule.EVENT,
    "each step of a task and the cycles missed before it, in simulation on the real clock",
    {}, ("task", "time", "missed"), lambda step: step,
))  # fmt: skip
COMMAND: Final = declare(Topic(
    "/cmd_vel", Velocity, "m/s, rad/s", "geometry_msgs/TwistStamped", Rule.EVENT,
    "velocities asked for, before the safety gate", {"header": {"frame_id": "base_footprint"}},
    ("twist.linear.x", "twist.angular.z"), lambda asked: (asked.v, asked.omega),
))  # fmt: skip
