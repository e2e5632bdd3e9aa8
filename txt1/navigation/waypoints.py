"""Following waypoints by a look-ahead point on the current leg."""

import asyncio
from collections.abc import Callable, Sequence
from math import atan2, hypot, sqrt
from typing import Final

from txt1.control.limits import clip
from txt1.driver import REFRESH, CommandSource
from txt1.errors import CommandRefused
from txt1.model.kinematics import wrap_angle
from txt1.model.reeds_shepp import Pose
from txt1.navigation.goto import HARDLY, halted
from txt1.navigation.pace import pace
from txt1.navigation.pose_source import PoseSource, wheel_pose
from txt1.robot import Robot

# m, at the original's 0.5 m/s
PURSUIT_AHEAD: Final = 1.0
# m/s, the original's
WAYPOINT_SPEED: Final = 0.5
# m/s^2, the largest v^2 abs(curvature); at 0.5 m/s and full lock it is not reached
SIDEWAYS: Final = 0.6

# s for which it waits for something in the way to leave
WAITS: Final = 20.0

# x and y, m
Point = tuple[float, float]


def aim(pose: Pose, leg_start: Point, leg_end: Point, look_ahead: float) -> Point:
    """Return the point on a leg `look_ahead` m ahead of the robot's nearest point on the leg, at most the leg's end."""
    along_x, along_y = leg_end[0] - leg_start[0], leg_end[1] - leg_start[1]
    leg = hypot(along_x, along_y)
    if leg == 0.0:
        return leg_end
    along_x, along_y = along_x / leg, along_y / leg
    abreast = (pose[0] - leg_start[0]) * along_x + (pose[1] - leg_start[1]) * along_y
    side = along_x * (pose[1] - leg_start[1]) - along_y * (pose[0] - leg_start[0])
    # the circle of the look-ahead around the robot meets the leg here; if the robot is farther away, straight to the
    # leg
    ahead = sqrt(max(look_ahead**2 - side**2, 0.0))
    on = min(max(abreast + ahead, 0.0), leg)
    return leg_start[0] + on * along_x, leg_start[1] + on * along_y


def curvature_towards(pose: Pose, point: Point, look_ahead: float) -> float:
    """Return the curvature, 1/m, towards a point: omega / v with omega = 2 v theta_err / look-ahead."""
    error = wrap_angle(atan2(point[1] - pose[1], point[0] - pose[0]) - pose[2])
    return 2.0 * error / look_ahead


def speed_in_curve(speed: float, curvature: float) -> float:
    """Return the speed, m/s, at most `speed`, at which a curve needs no more than `SIDEWAYS`."""
    return min(speed, sqrt(SIDEWAYS / abs(curvature))) if curvature else speed


async def follow(
    robot: Robot,
    points: Sequence[Point],
    *,
    laps: float = 1,
    closed: bool = True,
    speed: float | str = WAYPOINT_SPEED,
    look_ahead: float = PURSUIT_AHEAD,
    pose_source: PoseSource | None = None,
    on_leg: Callable[[int, Point, Point], None] | None = None,
    source: CommandSource | None = None,
) -> None:
    """Drive from waypoint to waypoint, and stop at the last.

    The points, m, are in the frame of the pose source, by default the odometry's. The robot must be armed, with its
    gains loaded. It drives `laps` laps; inf: until it is cancelled or the gate closes. With `closed` a lap ends at the
    first waypoint. `speed` is in m/s; "time" or "energy" chooses the speed that saves it. `look_ahead` is in m.
    `on_leg` is called with number, start and end of each leg when it begins. `source` is the source of its commands;
    None: the program's.

    Raises NotArmed: the gate is closed, or closes on the way; Overruled: another source of commands drives, or takes
    the wheel on the way; Halted: it hardly moves for 20 s; CommandRefused: there are no waypoints, or the pose source
    knows no pose.
    """
    if not points:
        raise CommandRefused("there are no waypoints: give at least one")
    fastest = pace(speed, robot.config)
    poses = wheel_pose(robot) if pose_source is None else pose_source
    wheel = robot.program if source is None else source
    wheel.begin()
    sharpest = 1.0 / robot.config.geometry.radius_min
    pose = poses.pose()
    leg_start: Point = pose[:2]
    legs, in_a_lap = 0, len(points)
    # where it was when it last moved, and since when it has been there; the legs that ended since its last command
    mark, since, passed = pose, robot.now, 0
    last = laps * in_a_lap if closed else in_a_lap * laps - 1
    try:
        while legs <= last:
            leg_end = points[legs % in_a_lap]
            if on_leg is not None:
                on_leg(legs, leg_start, leg_end)
            near = 0.5 * robot.config.geometry.radius_min if legs + 1 > last else look_ahead
            while True:
                pose = poses.pose()
                left = hypot(leg_end[0] - pose[0], leg_end[1] - pose[1])
                if hypot(pose[0] - mark[0], pose[1] - mark[1]) > HARDLY:
                    mark, since = pose, robot.now
                elif robot.now - since > WAITS:
                    raise halted(robot, 1.0, pose)
                if left <= near:
                    passed += 1
                    break
                passed = 0
                point = aim(pose, leg_start, leg_end, look_ahead)
                curvature = clip(curvature_towards(pose, point, look_ahead), sharpest)
                v = speed_in_curve(fastest, curvature)
                wheel.insist(v, v * curvature)
                await asyncio.sleep(REFRESH)
            leg_start = leg_end
            legs += 1
            # a lap within the look-ahead has no command in it, and would never let others run
            if passed > in_a_lap:
                await asyncio.sleep(REFRESH)
    finally:
        wheel.release()
