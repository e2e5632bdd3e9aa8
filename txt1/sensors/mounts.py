"""Where the original's sensors sit on the robot: links without joints, and their static transforms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from txt1.sensors.readings import BASE, OPTICAL, DepthImage, FixReading, Image, ImuReading, Scan
from txt1.telemetry.topics import Rule, Topic

Links = dict[str, tuple[str, float, float, float]]
"""Links without joints, by name: the parent, and the place in it, m; only `OPTICAL` is turned."""

MOUNTS: Final[Mapping[str, tuple[float, float, float]]] = {
    "base_laser_link": (0.1905, 0.0, 0.1435),
    "base_camera_link": (0.1448, 0.0, 0.2832),
    "base_imu_link": (-0.1016, 0.0, 0.3187),
    "base_gps_link": (-0.0762, 0.0, 0.3492),
}
"""Places of the original's sensors in base_link, m."""
_LINK: Final[Mapping[type, str]] = {
    Scan: "base_laser_link",
    Image: "base_camera_link",
    DepthImage: "base_camera_link",
    ImuReading: "base_imu_link",
    FixReading: "base_gps_link",
}
# rotation from the camera to its optical frame
TO_OPTICAL: Final = {"x": -0.5, "y": 0.5, "z": -0.5, "w": 0.5}


def links_of(kinds: Iterable[type]) -> Links:
    """Return the links of a robot with sensors of these types of readings."""
    wanted = {_LINK[kind] for kind in kinds if kind in _LINK}
    sensors: Links = {name: ("base_link", *place) for name, place in MOUNTS.items() if name in wanted}
    if "base_camera_link" in sensors:
        sensors[OPTICAL] = "base_camera_link", 0.0, 0.0, 0.0
    return {"base_link": ("base_footprint", 0.0, 0.0, BASE), **sensors}


def fixed(links: Links) -> Topic[object]:
    """Return the topic of the static transforms of links: by name, the parent and the place in it, m."""
    transforms = [
        {
            "header": {"frame_id": above},
            "child_frame_id": name,
            "transform": {
                "translation": {"x": x, "y": y, "z": z},
                "rotation": TO_OPTICAL if name == OPTICAL else {"w": 1.0},
            },
        }
        for name, (above, x, y, z) in links.items()
    ]
    return Topic(
        "/tf_static",
        object,
        "m",
        "tf2_msgs/TFMessage",
        Rule.EVENT,
        "where everything sits on the robot",
        make=lambda _: {"transforms": transforms},
    )
