"""The robot as URDF: simple shapes, wheels that turn and steer, and every sensor at its place."""

from __future__ import annotations

from math import tau
from typing import Final

from txt1.model.vehicle import Geometry
from txt1.ros.topics import AXLES, WHEELS
from txt1.sensors.mounts import Mounts, optical
from txt1.sensors.readings import BASE_HEIGHT

# sizes of the original's sensors by the ends of their links' names, m
_SIZES: Final = {
    "laser_link": (0.05, 0.05, 0.07),
    "camera_link": (0.07, 0.28, 0.06),
    "imu_link": (0.044, 0.024, 0.064),
    "gps_link": (0.061, 0.061, 0.02),
}
# of any other
SMALL: Final = (0.03, 0.03, 0.03)
# width of a tyre, m
TYRE: Final = 0.085
# height of the body, m
BODY_HEIGHT: Final = 0.14
BODY_DENSITY: Final = (
    # kg/m^3 of the body's box; assumed: an F1TENTH, whose published mass is 3.74 kg, gets 4.1
    300.0
)
# kg/m^3 of a tyre's cylinder; assumed
TYRE_DENSITY: Final = 150.0
# kg; assumed: a simulator leaves out a link without a mass, and the wheel with it
HUB: Final = 0.05
_ROBOT: Final = """\
<?xml version="1.0"?>
<robot name="{}">
  <material name="grey"><color rgba="0.35 0.38 0.42 1"/></material>
  <material name="black"><color rgba="0.1 0.1 0.1 1"/></material>
  <material name="blue"><color rgba="0.1 0.4 0.8 1"/></material>
  <link name="base_footprint"/>
{}
</robot>
"""
_BODY: Final = """\
  <link name="{0}">{4}
    <visual>{1}<geometry>{2}</geometry><material name="{3}"/></visual>
    <collision>{1}<geometry>{2}</geometry></collision>
  </link>"""
_INERTIAL: Final = """
    <inertial>{}<mass value="{:.4g}"/>
      <inertia ixx="{:.4g}" iyy="{:.4g}" izz="{:.4g}" ixy="0" ixz="0" iyz="0"/></inertial>"""
_JOINT: Final = """\
  <joint name="{}" type="{}">
    <parent link="{}"/><child link="{}"/>{}{}
  </joint>"""


def robot_description(name: str, geometry: Geometry, mounts: Mounts = ()) -> str:
    """Return the robot with sensors at these places as URDF; ROS 2's robot_state_publisher moves its joints by
    ``joint_states``.
    """
    size = geometry.length, geometry.width - 2.0 * TYRE, BODY_HEIGHT
    place = _origin((geometry.centre, 0.0, 0.0))
    parts = [
        _BODY.format("base_link", place, _cuboid(size), "blue", _box(place, size)),
        _fixed("base_footprint", "base_link", _origin((0.0, 0.0, BASE_HEIGHT))),
    ]
    here = _origin((0.0, 0.0, 0.0))
    for link, mount in mounts:
        at = _origin((mount.x, mount.y, mount.z - BASE_HEIGHT), f"0 0 {mount.yaw:.6g}")
        of_the_kind = next((size for kind, size in _SIZES.items() if link.endswith(kind)), SMALL)
        parts += [_BODY.format(link, here, _cuboid(of_the_kind), "grey", ""), _fixed("base_link", link, at)]
        if link.endswith("camera_link"):
            turned = _origin((0.0, 0.0, 0.0), f"{-tau / 4:.9f} 0 {-tau / 4:.9f}")
            parts += [f'  <link name="{optical(link)}"/>', _fixed(link, optical(link), turned)]
    radius, lock = geometry.circumference / tau, geometry.steering_max
    # the pose of this car is on its rear axle
    rear = 0.0 if geometry.steering == "front" else -0.5 * geometry.wheelbase
    tyre = f'<cylinder radius="{radius:.6f}" length="{TYRE:g}"/>'
    # a cylinder stands along z, a wheel turns about y
    lying = _origin((0.0, 0.0, 0.0), f"{tau / 4:.6f} 0 0")
    weight = TYRE_DENSITY * tau / 2 * radius**2 * TYRE
    across = weight * (3.0 * radius**2 + TYRE**2) / 12.0
    wheel_mass = _INERTIAL.format(lying, weight, across, across, 0.5 * weight * radius**2)
    # inertia of a cube as wide as the tyre
    hub_mass = _INERTIAL.format("", HUB, *(HUB * TYRE**2 / 6.0,) * 3)
    limits = f'<axis xyz="0 0 1"/><limit lower="-{lock:.6f}" upper="{lock:.6f}" effort="2" velocity="7"/>'
    for wheel in WHEELS:
        is_front = wheel.startswith("front")
        y = 0.5 * geometry.track_width * (1.0 if wheel.endswith("left") else -1.0)
        place = _origin((rear + geometry.wheelbase * is_front, y, radius - BASE_HEIGHT))
        kind, more = ("revolute", limits) if AXLES[geometry.steering][not is_front] else ("fixed", "")
        axle = _origin((0.0, 0.0, 0.0))
        parts += [
            _JOINT.format(f"{wheel}_steering_joint", kind, "base_link", f"{wheel}_hub", place, more),
            f'  <link name="{wheel}_hub">{hub_mass}\n  </link>',
            _JOINT.format(
                f"{wheel}_wheel_joint", "continuous", f"{wheel}_hub", f"{wheel}_wheel", axle, '<axis xyz="0 1 0"/>'
            ),
            _BODY.format(f"{wheel}_wheel", lying, tyre, "black", wheel_mass),
        ]
    return _ROBOT.format(name or "txt1", "\n".join(parts))


def _cuboid(size: tuple[float, float, float]) -> str:
    return f'<box size="{" ".join(f"{each:g}" for each in size)}"/>'


def _fixed(above: str, link: str, origin: str) -> str:
    return _JOINT.format(f"{link}_joint", "fixed", above, link, origin, "")


def _box(place: str, size: tuple[float, float, float]) -> str:
    """Return the mass and the inertia of the body's box about its centre."""
    x, y, z = size
    mass = BODY_DENSITY * x * y * z
    each = (mass / 12.0 * (one**2 + other**2) for one, other in ((y, z), (x, z), (x, y)))
    return _INERTIAL.format(place, mass, *each)


def _origin(at: tuple[float, float, float], turned: str = "0 0 0") -> str:
    return f'<origin xyz="{" ".join(f"{each:.6g}" for each in at)}" rpy="{turned}"/>'
