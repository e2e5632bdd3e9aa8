"""Where the sensors sit on the robot: their links, and the static transforms of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import cos, sin
from typing import Any, Final, TypeVar

from txt1.sensors.readings import (
    BASE_HEIGHT,
    CAMERA_MOUNT,
    GPS_MOUNT,
    IMU_MOUNT,
    LASER_MOUNT,
    OPTICAL,
    DepthImage,
    FixReading,
    Image,
    ImuReading,
    Mount,
    Scan,
)
from txt1.telemetry.topics import Rule, Topic

T = TypeVar("T")

Mounts = tuple[tuple[str, Mount], ...]
"""The places of sensors on the vehicle, by the names of their links."""

ORIGINAL: Final[Mounts] = (
    ("base_laser_link", LASER_MOUNT),
    ("base_camera_link", CAMERA_MOUNT),
    ("base_imu_link", IMU_MOUNT),
    ("base_gps_link", GPS_MOUNT),
)
"""Places of the original's sensors."""
_LINK: Final[Mapping[type, str]] = {
    Scan: "base_laser_link",
    Image: "base_camera_link",
    DepthImage: "base_camera_link",
    ImuReading: "base_imu_link",
    FixReading: "base_gps_link",
}
# rotation from the camera to its optical frame
TO_OPTICAL: Final = {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5}


def transform(above: str, name: str, place: tuple[float, float, float], yaw: float = 0.0) -> dict[str, Any]:
    """Return the fields of the transform of a link: its parent, its name, its place there, m, and its angle, rad."""
    x, y, z = place
    rotation = TO_OPTICAL if name.endswith("_optical_link") else {"z": sin(0.5 * yaw), "w": cos(0.5 * yaw)}
    return {
        "header": {"frame_id": above},
        "child_frame_id": name,
        "transform": {"translation": {"x": x, "y": y, "z": z}, "rotation": rotation},
    }


def optical(link: str) -> str:
    """Return the link of a camera's pictures: z ahead, x to the right."""
    return link.replace("_link", "_optical_link")


def mounted(mounts: Mounts) -> dict[str, Any]:
    """Return the fields of a TFMessage: base_link, and the sensors at their places."""
    found = [transform("base_footprint", "base_link", (0.0, 0.0, BASE_HEIGHT))]
    for name, mount in mounts:
        found.append(transform("base_link", name, (mount.x, mount.y, mount.z - BASE_HEIGHT), mount.yaw))
        if name.endswith("camera_link"):
            found.append(transform(name, optical(name), (0.0, 0.0, 0.0)))
    return {"transforms": found}


TF_STATIC: Final = Topic[Mounts](
    "/tf_static",
    tuple,
    "m",
    "tf2_msgs/TFMessage",
    Rule.CHANGE,
    "where the sensors sit on the robot",
    make=mounted,
)


class SensorFrames:
    """The places of a robot's sensors, as its readings tell them.

    The first sensor of a kind has the kind's link, such as base_laser_link. A later one has a link of its own, such as
    base_rear_laser_link.
    """

    def __init__(self) -> None:
        self._links: dict[str, str] = {}
        self._kinds = set[type]()
        self._found: dict[str, tuple[str, Mount]] = {}

    def link(self, topic: Topic[Any]) -> str:
        """Return the link of a topic's sensor; "" if it has none. Sensors of a kind come first that are asked first."""
        if topic.name not in self._links:
            link = _LINK.get(topic.type, "")
            if link and topic.type in self._kinds:
                link = link.replace("base_", f"base_{topic.name.rpartition('/')[2]}_", 1)
            self._kinds.add(topic.type)
            self._links[topic.name] = link
        return self._links[topic.name]

    def framed(self, topic: Topic[T], sensor: Topic[Any]) -> Topic[T]:
        """Return a sensor's own topic, or one beside it, in the frame of that sensor."""
        link = self.link(sensor)
        if link in ("", _LINK.get(sensor.type)):
            return topic
        frames = {_LINK[sensor.type]: link, OPTICAL: optical(link)}
        frame = topic.constants["header"]["frame_id"]
        return replace(topic, constants={**topic.constants, "header": {"frame_id": frames.get(frame, frame)}})

    def see(self, topic: Topic[Any], value: Any) -> bool:
        """Take a reading; return whether its sensor sits elsewhere than known before."""
        link = self.link(topic)
        if not link or self._found.get(link, (topic.name,))[0] != topic.name:
            return False
        before, self._found[link] = self._found.get(link), (topic.name, value.mount)
        return before is None or before[1] != value.mount

    @property
    def mounts(self) -> Mounts:
        """The places so far."""
        return tuple((link, mount) for link, (_, mount) in self._found.items())
