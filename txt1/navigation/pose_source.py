"""Sources of the robot's pose: its encoders, other sensors, a map, or a simulation's true pose."""

import asyncio
from collections.abc import Callable, Sequence
from math import cos, hypot, sin, sqrt
from typing import NamedTuple

from txt1.driver import REFRESH
from txt1.errors import CommandRefused, NotCapable
from txt1.model.kinematics import move_along_arc, wrap_angle
from txt1.model.reeds_shepp import Pose
from txt1.model.vehicle import Geometry
from txt1.robot import Robot
from txt1.sensors.geodesy import UtmGrid
from txt1.sensors.readings import FixReading
from txt1.sim.room import Room
from txt1.tasks.on_map import MapInUse


class PoseSource(NamedTuple):
    """A source of the robot's pose."""

    # its name in figures and reports
    name: str
    # returns the present pose, m and rad; None while it is unknown
    read: Callable[[], Pose | None]
    # the map in whose frame it is, for a way round what is seen
    sees: MapInUse | None = None

    def pose(self) -> Pose:
        """Return the present pose, m and rad; raises CommandRefused while it is unknown."""
        pose = self.read()
        if pose is None:
            raise CommandRefused(
                f"the pose source '{self.name}' does not know where the robot is; wait, or drive by hand, until it does"
            )
        return pose


def true_pose(robot: Robot) -> PoseSource:
    """Return the simulator's true pose in the room, like a tracking system's; raises NotCapable: the HAL has none."""
    if not robot.hal.capabilities.pose:
        raise NotCapable(robot.hal.name, "pose")
    return PoseSource("true pose", lambda: robot.pose)


def fused_pose(robot: Robot) -> PoseSource:
    """Return the pose fused from all sensors, in the frame of those that measure one.

    Raises NotCapable: ``estimation`` is off.
    """
    # it computes with numpy
    from txt1.estimation.task import Estimator

    if robot.runtime.part(Estimator) is None:
        raise NotCapable("nothing is fused: set estimation.preset or estimation.sensors")

    def read() -> Pose | None:
        estimate = robot.estimate
        return estimate[:3] if estimate is not None and estimate.located else None

    return PoseSource("fused pose", read)


def best_pose(robot: Robot) -> PoseSource:
    """Return the pose on the map if the robot has one, else the true pose if it is known, else the wheels' pose."""
    if robot.runtime.part(MapInUse) is not None:
        return map_pose(robot)
    return true_pose(robot) if robot.hal.capabilities.pose else wheel_pose(robot)


def map_floor(robot: Robot) -> Room | None:
    """Return the walls of the robot's map, in the frame of `map_pose`; None if there are no walls to plan round."""
    there = robot.runtime.part(MapInUse)
    return None if there is None else there.floor()


def map_pose(robot: Robot) -> PoseSource:
    """Return the pose on the map, from a laser and the odometry since its last scan; raises NotCapable: there
    is no map.
    """
    there = robot.runtime.part(MapInUse)
    if there is None:
        raise NotCapable("there is no map: give --in MAP or --map NAME; in a program set mapping.room or mapping.make")

    def read() -> Pose | None:
        found = there.pose()
        return None if found is None or found.lost else found[:3]

    return PoseSource("pose on the map", read, there)


async def located(robot: Robot, source: PoseSource, speed: float = 0.4, patience: float = 60.0) -> None:
    """Drive in a wide curve until a pose source knows the pose: positions at rest show no heading.

    Raises CommandRefused: the pose is still unknown after `patience` s; Overruled, NotArmed: as `Robot.drive`.
    """
    ends = robot.now + patience
    while source.read() is None:
        if robot.now >= ends:
            raise CommandRefused(f"the pose source '{source.name}' knows no pose after {patience:g} s of driving")
        robot.program.insist(speed, 0.25 * speed)
        await asyncio.sleep(REFRESH)


async def places_on_earth(
    robot: Robot, sensor: str, places: Sequence[tuple[float, float]], patience: float = 10.0
) -> tuple[tuple[float, float], ...]:
    """Convert places in degrees of latitude and longitude to metres in the frame of a GPS, which must have a fix.

    Raises CommandRefused: it has no fix in `patience` s; ConfigError: there is no such sensor.
    """
    ends = robot.now + patience
    while (reading := robot.sensor(sensor)) is None:
        if robot.now >= ends:
            raise CommandRefused(f"'{sensor}' has no fix after {patience:g} s, so no place on earth can be found")
        await asyncio.sleep(REFRESH)
    fix = reading.value
    if not isinstance(fix, FixReading):
        raise CommandRefused(f"'{sensor}' is no GPS: give metres, or the name of one")
    grid = UtmGrid(fix.latitude, fix.longitude)
    return tuple((fix.x + x, fix.y + y) for x, y in (grid.place(*place) for place in places))


def wheel_pose(robot: Robot, at: Pose | None = None) -> PoseSource:
    """Return the pose from the encoders, corrected for their places; it must be read at least 5 times a second.

    `at` is the robot's present pose; None: the odometry's.
    """
    last: Pose = robot.odometry[:3]
    pose = last if at is None else at

    def read() -> Pose:
        nonlocal last, pose
        before, last = last, robot.odometry[:3]
        distance, turn = step_between(before, last)
        if distance or turn:
            distance, turn = straighten(distance, turn, robot.config.geometry)
            pose = move_along_arc(*pose, distance, turn / distance if distance else 0.0, 0.0)
        return pose

    return PoseSource("odometry", read)


def step_between(before: Pose, after: Pose) -> tuple[float, float]:
    """Return length (m, backward negative) and turn (rad) of the arc from one pose to another."""
    dx, dy = after[0] - before[0], after[1] - before[1]
    turn = wrap_angle(after[2] - before[2])
    half = 0.5 * turn
    direction = before[2] + half
    chord = hypot(dx, dy) if dx * cos(direction) + dy * sin(direction) >= 0.0 else -hypot(dx, dy)
    return chord * (half / sin(half) if abs(half) > 1e-4 else 1.0), turn


def straighten(distance: float, turn: float, geometry: Geometry) -> tuple[float, float]:
    """Return the centre's path (m) and turn (rad), from the encoders' path and turn at the steered front wheels.

    At the steering angle phi the front wheels roll 1 / cos(phi) of the centre's path, and show cos(phi) of the turn, as
    they are turned out of the axle's direction. So with q half the measured curvature times L,

        q = tan(phi) cos(phi)^2 = tan(phi) / (1 + tan(phi)^2),   tan(phi) = (1 - sqrt(1 - 4 q^2)) / (2 q)

    At full lock that is 4.3 % of the path and 4.5 % of the turn. Values beyond full lock are noise, and are limited.
    Other vehicles have their encoders on wheels that do not steer; their readings are true.
    """
    if not distance or geometry.steering != "both":
        return distance, turn
    q = geometry.lever * turn / distance
    tan_max = geometry.tan_steering_max
    q_max = tan_max / (1.0 + tan_max * tan_max)
    tangent = tan_max if abs(q) >= q_max else (1.0 - sqrt(1.0 - 4.0 * q * q)) / (2.0 * q) if abs(q) > 1e-6 else q
    # 1 / cos(phi)
    stretch = sqrt(1.0 + tangent * tangent)
    return distance / stretch, turn * stretch


def encoders_view(v: float, curvature: float, geometry: Geometry) -> tuple[float, float]:
    """Return (v, omega) as the encoders show a centre's motion at v m/s along a curvature in 1/m; for set-points."""
    if geometry.steering != "both":
        return v, v * curvature
    tangent = geometry.lever * curvature
    stretch = sqrt(1.0 + tangent * tangent)
    return v * stretch, v * curvature / stretch
