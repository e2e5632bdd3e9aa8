"""The names, messages and qualities of service of the robot's topics in ROS 2.

Topics with a conventional name have it (``odom``, ``imu/data``, ``scan``). Every other topic of the table is below the
node's own name, ``~/``.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Literal, NamedTuple

from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.sensors.readings import OPTICAL, DepthImage, FixReading, Image, ImuReading, Scan
from txt1.sensors.ros_messages import camera_info, depth_points, fix
from txt1.tasks.encoder import ROOM
from txt1.telemetry.messages import define
from txt1.telemetry.topics import TOPICS, Rule, Topic

Quality = Literal["default", "sensor", "latched", "clock"]
"""Reliable; best effort, for sensors' data; kept for late subscribers; the newest only."""


class Publication(NamedTuple):
    """A ROS topic: its name, relative to the namespace, its quality of service, and the topic that makes its
    messages.
    """

    name: str
    quality: Quality
    topic: Topic[Any]


STANDARD: Final[dict[str, tuple[str, Quality]]] = {
    "/odom": ("odom", "default"),
    "/odometry/filtered": ("odometry/filtered", "default"),
    "/tf": ("tf", "default"),
    "/map": ("map", "latched"),
    "/battery1": ("battery_state", "latched"),
    "/diagnostics": ("/diagnostics", "default"),
    "/faults": ("/diagnostics", "default"),
    "/sensors": ("/diagnostics", "default"),
    "/estimation": ("/diagnostics", "default"),
    "/rosout": ("/rosout", "latched"),
}
"""Topics of the table with a conventional name in ROS."""

NOT_TOLD: Final = frozenset(
    {
        "/tf_room",
        "/tf_room_below",
        "/tf_map",
        "/markers",
        "/snapshot",
        "/input",
        "/reports",
        "/steps",
        "/link",
        "/cmd_vel",
    }
)
"""Topics for recordings and the live view only.

``/tf_room`` and similar topics: the node itself publishes at most one frame above odom, with each odometry.
``/cmd_vel``: the commanded velocities came from ROS, or are in ``~/setpoint``. ``/markers``: RViz has the description
of the robot, and some versions of ROS lack the message.
"""

define(
    "sensor_msgs/JointState",
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
)
define("rosgraph_msgs/Clock", "builtin_interfaces/Time clock")


# -- frames ------------------------------------------------------------------------------------------------------

_FORWARD: Final = tuple(
    f"transforms.0.transform.{name}" for name in ("translation.x", "translation.y", "rotation.z", "rotation.w")
)


def parent(frame: str) -> Topic[tuple[float, float, float]]:
    """Return the topic of the transform from `frame`, map or room, to odom: poses (m, rad) of the odometry's origin."""
    return Topic(
        f"/tf_{frame}",
        tuple,
        "m",
        "tf2_msgs/TFMessage",
        Rule.CYCLE,
        f"where the odometry began in the {frame}",
        {"transforms": [{"header": {"frame_id": frame}, "child_frame_id": "odom"}]},
        _FORWARD,
        ROOM.make,
    )


_FRAMED: Final = ("geometry_msgs/", "nav_msgs/", "sensor_msgs/", "tf2_msgs/", "txt1_msgs/")
_FRAMES: Final = ("frame_id", "child_frame_id")


def in_namespace(topic: Topic[Any], prefix: str, owner: str) -> Topic[Any]:
    """Return a topic whose frames' names begin with `prefix`, with diagnostics of `owner`; "" changes nothing."""

    def prefixed(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {name: f"{prefix}{each}" if name in _FRAMES else prefixed(each) for name, each in value.items()}
        if isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            return [prefixed(each) for each in value]
        return value

    def owned(value: Any) -> Any:
        told: Any = topic.make(value)
        statuses = [each | {"name": f"{owner}: {each['name']}", "hardware_id": owner} for each in told["status"]]
        return {**told, "status": statuses}

    def made(value: Any) -> Any:
        told = topic.make(value)
        return prefixed(told) if isinstance(told, Mapping) else told

    if owner and topic.message == "diagnostic_msgs/DiagnosticArray":
        return replace(topic, make=owned)
    if not prefix or not topic.message.startswith(_FRAMED):
        return topic
    return replace(topic, constants=prefixed(topic.constants), make=topic.make if topic.paths else made)


# -- joints ------------------------------------------------------------------------------------------------------

WHEELS: Final = ("front_left", "front_right", "rear_left", "rear_right")
JOINTS: Final = (*(f"{wheel}_wheel_joint" for wheel in WHEELS), *(f"{wheel}_steering_joint" for wheel in WHEELS))


class Joints(NamedTuple):
    """Angles (rad) and speeds (rad/s) of the joints, in the order of `JOINTS`."""

    positions: tuple[float, ...]
    velocities: tuple[float, ...]


JOINT_STATES: Final = Topic(
    "/joint_states",
    Joints,
    "rad, rad/s",
    "sensor_msgs/JointState",
    Rule.CYCLE,
    "wheels by the odometry, steering as it was told",
    {"header": {"frame_id": "base_link"}, "name": list(JOINTS), "position": [0.0] * 8, "velocity": [0.0] * 8},
    (*(f"position.{k}" for k in range(8)), *(f"velocity.{k}" for k in range(8))),
    lambda joints: joints.positions + joints.velocities,
)


AXLES: Final = {"both": (True, True), "front": (True, False), "skid": (False, False)}
"""Whether the front and the rear wheels steer."""


def turned(front: int, rear: int, geometry: Geometry) -> tuple[float, float]:
    """Return the front's and the rear's steering angle (rad, left positive) for PWM counts of the two channels."""
    axles = AXLES[geometry.steering]
    unit = -geometry.steering_max / STEERING_MAX
    return unit * front * axles[0], unit * rear * axles[1]


# -- speed and steering angle --------------------------------------------------------------------------------------

define(
    "ackermann_msgs/AckermannDrive",
    "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\nfloat32 acceleration\nfloat32 jerk",
)
define("ackermann_msgs/AckermannDriveStamped", "std_msgs/Header header\nackermann_msgs/AckermannDrive drive")


class SteeredDrive(NamedTuple):
    """Speed (m/s) and angle of the front wheels (rad, left positive)."""

    speed: float
    angle: float


STEERED_DRIVE: Final = Topic(
    "/steered_drive",
    SteeredDrive,
    "m/s, rad",
    "ackermann_msgs/AckermannDriveStamped",
    Rule.CYCLE,
    "the set-point in force, as speed and steering angle",
    {"header": {"frame_id": "base_link"}},
    ("drive.speed", "drive.steering_angle"),
    tuple,
)


def steered(v: float, omega: float, geometry: Geometry) -> SteeredDrive:
    """Return speed and steering angle for a velocity, m/s and rad/s; straight ahead at rest."""
    return SteeredDrive(v, geometry.steering_share(omega / v) * geometry.steering_max if v else 0.0)


# -- sensors -----------------------------------------------------------------------------------------------------


_KINDS: Final[dict[type, str]] = {
    ImuReading: "imu/data",
    Scan: "scan",
    FixReading: "fix",
    Image: "image_raw/compressed",
    DepthImage: "depth/image_raw",
}


def sensor(topic: Topic[Any], first: bool) -> Sequence[Publication]:
    """Return the publications of a sensor's topic; the first sensor of its kind has the conventional name."""
    name = topic.name.removeprefix("/sensors/")
    known = _KINDS.get(topic.type)
    if known is None:
        return (Publication(f"~{topic.name}", "sensor", topic),)
    place = "camera/" if topic.type in (Image, DepthImage) else ""
    if not first:
        place = f"{name}/"
    if topic.type is FixReading:
        return Publication(f"{place}fix", "sensor", fix("/fix")), Publication(f"~{topic.name}", "sensor", topic)
    if topic.type in (Image, DepthImage):
        header = {"frame_id": OPTICAL}
        seen = (
            topic
            if topic.constants.get("header") == header
            else replace(topic, constants={**topic.constants, "header": header})
        )
        told = Publication(f"{place}{known}", "sensor", seen)
        if topic.type is DepthImage:
            place += "depth/"
        info = Publication(f"{place}camera_info", "sensor", camera_info(f"/{place}camera_info"))
        if topic.type is Image:
            return told, info
        return told, info, Publication(f"{place}points", "sensor", depth_points(f"/{place}points"))
    return (Publication(f"{place}{known}", "sensor", topic),)


_RECORDED: Final = {
    "sensor_msgs/Imu": "imu/data",
    "sensor_msgs/LaserScan": "scan",
    "sensor_msgs/CompressedImage": "camera/image_raw/compressed",
    "sensor_msgs/Image": "camera/depth/image_raw",
    "sensor_msgs/NavSatFix": "fix",
    "sensor_msgs/CameraInfo": "camera/camera_info",
    "sensor_msgs/PointCloud2": "camera/depth/points",
}
"""Places of a recorded sensor's messages, by type."""


def recorded(name: str, message: str, taken: Container[str]) -> tuple[str, Quality] | None:
    """Return the name and quality of service of a recorded topic; None for topics that are not published.

    If the conventional name is `taken`, the topic gets another.
    """
    if name in ("/tf_room", "/tf_room_below", "/tf_map"):
        return "tf", "default"
    if name in NOT_TOLD:
        return None
    if name == "/tf_static":
        return "tf_static", "latched"
    if name.startswith("/sensors/"):
        place = _RECORDED.get(message, "")
        return place if place and place not in taken else f"~{name}", "sensor"
    return of_the_table(TOPICS[name])[:2] if name in TOPICS else (f"~{name}", "default")


def of_the_table(topic: Topic[Any]) -> Publication:
    """Return the publication of any other topic of the table."""
    if topic.name in STANDARD:
        name, quality = STANDARD[topic.name]
        return Publication(name, quality, topic)
    return Publication(f"~{topic.name}", "latched" if topic.rule in (Rule.CHANGE, Rule.SECOND) else "default", topic)
