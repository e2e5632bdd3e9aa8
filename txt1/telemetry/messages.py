"""Message definitions of ROS 2: its common interfaces, without comments and constants.

Messages that ROS does not have, ``txt1_msgs/...``, are defined beside the topics that use them. A recording and the
live view contain the definitions, so a reader does not need txt1.
"""

import re
from functools import cache
from typing import Final, NamedTuple

_COMMON: Final = """\
builtin_interfaces/Time: int32 sec; uint32 nanosec
std_msgs/Header: builtin_interfaces/Time stamp; string frame_id
std_msgs/String: string data
std_msgs/Float64: float64 data
geometry_msgs/Vector3: float64 x; float64 y; float64 z
geometry_msgs/Point: float64 x; float64 y; float64 z
geometry_msgs/Quaternion: float64 x; float64 y; float64 z; float64 w
geometry_msgs/Pose: geometry_msgs/Point position; geometry_msgs/Quaternion orientation
geometry_msgs/PoseStamped: std_msgs/Header header; geometry_msgs/Pose pose
geometry_msgs/PoseWithCovariance: geometry_msgs/Pose pose; float64[36] covariance
geometry_msgs/Twist: geometry_msgs/Vector3 linear; geometry_msgs/Vector3 angular
geometry_msgs/TwistStamped: std_msgs/Header header; geometry_msgs/Twist twist
geometry_msgs/TwistWithCovariance: geometry_msgs/Twist twist; float64[36] covariance
geometry_msgs/Transform: geometry_msgs/Vector3 translation; geometry_msgs/Quaternion rotation
geometry_msgs/TransformStamped: std_msgs/Header header; string child_frame_id; geometry_msgs/Transform transform
tf2_msgs/TFMessage: geometry_msgs/TransformStamped[] transforms
nav_msgs/Odometry: std_msgs/Header header; string child_frame_id; geometry_msgs/PoseWithCovariance pose;
    geometry_msgs/TwistWithCovariance twist
sensor_msgs/BatteryState: std_msgs/Header header; float32 voltage; float32 temperature; float32 current;
    float32 charge; float32 capacity; float32 design_capacity; float32 percentage; uint8 power_supply_status;
    uint8 power_supply_health; uint8 power_supply_technology; bool present; float32[] cell_voltage;
    float32[] cell_temperature; string location; string serial_number
diagnostic_msgs/KeyValue: string key; string value
diagnostic_msgs/DiagnosticStatus: byte level; string name; string message; string hardware_id;
    diagnostic_msgs/KeyValue[] values
diagnostic_msgs/DiagnosticArray: std_msgs/Header header; diagnostic_msgs/DiagnosticStatus[] status
rcl_interfaces/Log: builtin_interfaces/Time stamp; uint8 level; string name; string msg; string file; string function;
    uint32 line
"""

DEFINITIONS: Final[dict[str, str]] = {
    name: "\n".join(field.strip() for field in fields.split(";"))
    for name, fields in (text.split(":") for text in re.split(r"\n(?! )", _COMMON.strip()))
}
"""Definitions by ``package/Name``: a line ``type name`` for each field. ``byte`` is ROS's word for an octet."""


class Field(NamedTuple):
    """A field: its name, the type of an element, and the number of elements.

    The number is 1 for a plain field, the size of an array, and None for a sequence.
    """

    name: str
    type: str
    length: int | None
    array: bool


def define(name: str, text: str) -> str:
    """Define a message, given as ``package/Name``, with one ``type name`` a line; returns its name.

    Raises ValueError if another message of this name is defined already.
    """
    if DEFINITIONS.setdefault(name, text) != text:
        raise ValueError(f"message {name}: defined already with other fields; choose another name")
    return name


@cache
def fields(message: str) -> tuple[Field, ...]:
    """Return the fields of a message, given as ``package/Name``."""
    found = []
    for line in DEFINITIONS[message].splitlines():
        kind, name = line.split()
        kind, array, length = kind.rstrip("]").partition("[")
        found.append(Field(name, kind, int(length) if length else None if array else 1, bool(array)))
    return tuple(found)


def schema_name(message: str) -> str:
    """Return the name of a message in ROS 2 tools: ``package/msg/Name``."""
    return message.replace("/", "/msg/")


def schema_text(message: str) -> str:
    """Return the definition of a message and of every type in it, as rosbag2 writes it (encoding ros2msg of MCAP).

    It includes ROS's own `builtin_interfaces`, because some viewers have no built-in types.
    """
    kinds = [message]
    # the list grows meanwhile
    for kind in kinds:
        found = (field.type for field in fields(kind) if field.type in DEFINITIONS)
        kinds += dict.fromkeys(kind for kind in found if kind not in kinds)
    parts = (f"{'=' * 80}\nMSG: {kind}\n{DEFINITIONS[kind]}\n" for kind in kinds[1:])
    return f"{DEFINITIONS[message]}\n{''.join(parts)}"
