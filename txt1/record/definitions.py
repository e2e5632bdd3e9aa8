"""The messages of a recording in the words of ROS 2's message definitions.

The standard ones are those of the ROS 2 common interfaces, without comments and constants; ``txt1_msgs`` holds what
ROS has no message for. A reader finds them in the file, so it needs nothing of ours.
"""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

DEFINITIONS: Final = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "sensor_msgs/BatteryState": (
        "std_msgs/Header header\nfloat32 voltage\nfloat32 temperature\nfloat32 current\nfloat32 charge\n"
        "float32 capacity\nfloat32 design_capacity\nfloat32 percentage\nuint8 power_supply_status\n"
        "uint8 power_supply_health\nuint8 power_supply_technology\nbool present\nfloat32[] cell_voltage\n"
        "float32[] cell_temperature\nstring location\nstring serial_number"
    ),
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values"
    ),
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
    "rcl_interfaces/Log": (
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line"
    ),
    "txt1_msgs/Pwm": "std_msgs/Header header\nint32 motor\nint32 front\nint32 rear\nint32 pwm4\nint32 pwm5",
    "txt1_msgs/Gains": (
        "std_msgs/Header header\nfloat64 linear_kp\nfloat64 linear_ki\nfloat64 linear_kd\n"
        "float64 angular_kp\nfloat64 angular_ki\nfloat64 angular_kd"
    ),
    "txt1_msgs/Encoders": "std_msgs/Header header\nint32 right\nint32 left\nbool valid",
    "txt1_msgs/Mode": (
        "std_msgs/Header header\nbool armed\nbool stopped\nbool manual\nbool link_alive\nbool combined\nbool atx\n"
        "bool esc\nuint8 screen\nstring reason"
    ),
    "txt1_msgs/Input": (
        "std_msgs/Header header\nuint32 cycle\nuint32 tick\nuint32 received\n"
        "string source\nstring kind\nstring text\nfloat64 given\nfloat64[] values"
    ),
    "txt1_msgs/LinkBytes": "std_msgs/Header header\nstring direction\nuint8[] data",
    "txt1_msgs/Light": "std_msgs/Header header\nfloat64[4] lux",
    "txt1_msgs/LearningStep": (
        "std_msgs/Header header\nint32 episode\nint32 state\nint32 action\nfloat64 reward\nfloat64[] values"
    ),
    "txt1_msgs/Ticks": "std_msgs/Header header\nuint8[] task\nfloat64[] time\nuint32[] missed",
}
"""By package and name. ``byte`` is ROS's word for an octet."""


class Field(NamedTuple):
    """One field: its name, the type of an element, and how many: 1, a fixed number in an array, None in a sequence."""

    name: str
    type: str
    length: int | None
    array: bool


@cache
def fields(message: str) -> tuple[Field, ...]:
    """The fields of a message, given as ``package/Name``."""
    return tuple(_field(line) for line in DEFINITIONS[message].splitlines())


def _field(line: str) -> Field:
    kind, name = line.split()
    kind, bracket, length = kind.partition("[")
    if not bracket:
        return Field(name, kind, 1, False)
    length = length.rstrip("]")
    return Field(name, kind, int(length) if length else None, True)


def schema_name(message: str) -> str:
    """The name by which ROS 2 tools know a message: ``package/msg/Name``."""
    package, name = message.split("/")
    return f"{package}/msg/{name}"


def schema_text(message: str) -> str:
    """The definition of a message and of all that it contains, as it stands in an MCAP schema (encoding ros2msg)."""
    parts = [DEFINITIONS[message]]
    needed = [field.type for field in fields(message)]
    seen: set[str] = set()
    while needed:
        kind = needed.pop(0)
        if kind in DEFINITIONS and kind not in seen:
            seen.add(kind)
            needed += [field.type for field in fields(kind)]
            if kind != "builtin_interfaces/Time":  # readers have that one built in, and some refuse it twice
                parts.append(f"{'=' * 80}\nMSG: {kind}\n{DEFINITIONS[kind]}")
    return "\n".join(parts) + "\n"
