"""The robot as URDF: simple shapes, wheels that turn and steer, and every sensor in its place."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import tau
from typing import Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring  # nosec: nothing is read

from txt1.model.vehicle import Geometry
from txt1.ros.topics import AXLES, WHEELS
from txt1.sensors.readings import BASE, OPTICAL, DepthImage, FixReading, Image, ImuReading, Scan

Links = dict[str, tuple[str, float, float, float]]
"""Of links without joints by their names: the one above, and where they are in it, m; none but `OPTICAL` is turned."""

MOUNTS: Final[Mapping[str, tuple[float, float, float]]] = {
    "base_laser_link": (0.1905, 0.0, 0.1435),
    "base_camera_link": (0.1448, 0.0, 0.2832),
    "base_imu_link": (-0.1016, 0.0, 0.3187),
    "base_gps_link": (-0.0762, 0.0, 0.3492),
}
"""Where the sensors of the original are in base_link, m."""
_LINK: Final[Mapping[type, str]] = {
    Scan: "base_laser_link", Image: "base_camera_link", DepthImage: "base_camera_link", ImuReading: "base_imu_link",
    FixReading: "base_gps_link",
}  # fmt: skip
_SIZES: Final = {
    "base_laser_link": (0.05, 0.05, 0.07), "base_camera_link": (0.07, 0.28, 0.06),
    "base_imu_link": (0.044, 0.024, 0.064), "base_gps_link": (0.061, 0.061, 0.02),
}  # fmt: skip
TYRE: Final = 0.085  # width of a tyre, m
HEIGHT: Final = 0.14  # of the body, m


def links_of(kinds: Iterable[type]) -> Links:
    """The links of a robot with sensors of these types of readings."""
    wanted = {_LINK[kind] for kind in kinds if kind in _LINK}
    sensors: Links = {name: ("base_link", *place) for name, place in MOUNTS.items() if name in wanted}
    if "base_camera_link" in sensors:
        sensors[OPTICAL] = "base_camera_link", 0.0, 0.0, 0.0
    return {"base_link": ("base_footprint", 0.0, 0.0, BASE), **sensors}


def robot_description(name: str, geometry: Geometry, links: Links) -> str:
    """The robot as URDF; ROS 2's robot_state_publisher moves its joints by ``joint_states``."""
    robot = Element("robot", name=name or "txt1")
    for colour, rgba in (("grey", "0.35 0.38 0.42 1"), ("black", "0.1 0.1 0.1 1"), ("blue", "0.1 0.4 0.8 1")):
        SubElement(SubElement(robot, "material", name=colour), "color", rgba=rgba)
    SubElement(robot, "link", name="base_footprint")
    body = (geometry.length, geometry.width - 2.0 * TYRE, HEIGHT)
    for link, (above, x, y, z) in links.items():
        if link == OPTICAL:
            SubElement(robot, "link", name=link)
            _joint(robot, f"{link}_joint", "fixed", above, link, (x, y, z), turned=f"{-tau / 4:.9f} 0 {-tau / 4:.9f}")
            continue
        size = body if link == "base_link" else _SIZES[link]
        ahead = geometry.centre if link == "base_link" else 0.0
        _link(robot, link, "blue" if link == "base_link" else "grey", box=size, ahead=ahead)
        _joint(robot, f"{link}_joint", "fixed", above, link, (x, y, z))
    radius = geometry.circumference / tau
    for wheel in WHEELS:
        is_front = wheel.startswith("front")
        rear = 0.0 if geometry.steering == "front" else -0.5 * geometry.wheelbase  # the pose is on that car's rear axle
        x = rear + geometry.wheelbase * is_front
        y = 0.5 * geometry.track_width * (1.0 if wheel.endswith("left") else -1.0)
        place, hub = (x, y, radius - BASE), f"{wheel}_hub"
        if AXLES[geometry.steering][not is_front]:
            steering = _joint(robot, f"{wheel}_steering_joint", "revolute", "base_link", hub, place, "0 0 1")
            lock = f"{geometry.steering_max:.6f}"
            SubElement(steering, "limit", lower=f"-{lock}", upper=lock, effort="2", velocity="7")
        else:
            _joint(robot, f"{wheel}_steering_joint", "fixed", "base_link", hub, place)
        SubElement(robot, "link", name=f"{wheel}_hub")
        _joint(robot, f"{wheel}_wheel_joint", "continuous", f"{wheel}_hub", f"{wheel}_wheel", (0.0, 0.0, 0.0), "0 1 0")
        _link(robot, f"{wheel}_wheel", "black", cylinder=(radius, TYRE))
    indent(robot)
    return f'<?xml version="1.0"?>\n{tostring(robot, encoding="unicode")}\n'


def _link(
    robot: Element,
    name: str,
    colour: str,
    box: tuple[float, float, float] | None = None,
    cylinder: tuple[float, float] | None = None,
    ahead: float = 0.0,
) -> None:
    link = SubElement(robot, "link", name=name)
    for part in ("visual", "collision"):
        shape = SubElement(link, part)
        if cylinder is not None:
            SubElement(shape, "origin", xyz="0 0 0", rpy=f"{tau / 4:.6f} 0 0")
        elif ahead:
            SubElement(shape, "origin", xyz=f"{ahead:.6g} 0 0", rpy="0 0 0")
        geometry = SubElement(shape, "geometry")
        if box is not None:
            SubElement(geometry, "box", size=" ".join(f"{each:g}" for each in box))
        if cylinder is not None:
            SubElement(geometry, "cylinder", radius=f"{cylinder[0]:.6f}", length=f"{cylinder[1]:g}")
        if part == "visual":
            SubElement(shape, "material", name=colour)


def _joint(
    robot: Element, name: str, kind: str, above: str, below: str, at: tuple[float, float, float], axis: str = "",
    turned: str = "0 0 0",
) -> Element:  # fmt: skip
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=above)
    SubElement(joint, "child", link=below)
    SubElement(joint, "origin", xyz=" ".join(f"{each:.6g}" for each in at), rpy=turned)
    if axis:
        SubElement(joint, "axis", xyz=axis)
    return joint
