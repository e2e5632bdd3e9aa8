"""Trips between random poses in a room: what `go_to` is worth, by the simulator's true motion."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Sequence
from math import degrees, hypot, inf, pi
from typing import Final, NamedTuple

from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import wrap_angle
from txt1.model.reeds_shepp import Pose, length, paths
from txt1.navigation import PoseSource, go_to, true_pose, wheel_pose
from txt1.navigation.plan import stays_inside
from txt1.robot import Robot
from txt1.sim.room import Room, clearance

FROM_THE_WALLS: Final = 0.6  # m that starts and goals keep from them


class Trip(NamedTuple):
    """A drive from one pose to another."""

    start: Pose  # m and rad, where the robot was put down
    goal: Pose  # m and rad
    distance: float  # of the robot from the goal in the end, m
    turn: float  # of the robot from the goal's heading in the end, rad, never negative
    clear: float  # least distance of the body from the walls, m; negative: it would have stood in one
    driven: float  # m
    optimum: float | None  # length of the shortest Reeds-Shepp path, m; None where that touches a wall

    @property
    def arrived(self) -> bool:
        """Whether it is within 5 cm and 5 degrees of the goal, and has touched no wall."""
        return self.distance <= 0.05 and degrees(self.turn) <= 5.0 and self.clear > 0.0


async def trips(robot: Robot, count: int, room: Room, seed: int, *, by_truth: bool = False) -> list[Trip]:
    """Trips between random poses at least 0.6 m from the walls, on odometry or on the true pose.

    The robot is a simulator's, armed, its gains loaded; `seed` repeats the poses.

    Raises NoPath: a goal cannot be reached inside the room.
    """
    chance = random.Random(seed)
    reach_x, reach_y = 0.5 * room.length - FROM_THE_WALLS, 0.5 * room.width - FROM_THE_WALLS
    body = robot.config.geometry
    driven, clear, last = 0.0, inf, robot.pose

    async def watch(ticks: Ticks) -> None:
        nonlocal driven, clear, last
        async for _ in ticks:
            pose = robot.pose
            assert pose is not None and last is not None
            driven += hypot(pose[0] - last[0], pose[1] - last[1])
            clear = min(clear, clearance(*pose, room, body))
            last = pose

    def anywhere() -> Pose:
        return chance.uniform(-reach_x, reach_x), chance.uniform(-reach_y, reach_y), chance.uniform(-pi, pi)

    robot.add_task("watch", 0.02, watch, priority=-1)
    found = []
    for _ in range(count):
        start, goal = anywhere(), anywhere()
        robot.place(*start)
        await asyncio.sleep(0.1)
        driven, clear = 0.0, inf
        source: PoseSource = true_pose(robot) if by_truth else wheel_pose(robot, start)
        await go_to(robot, goal, pose_source=source, room=room)
        there = robot.pose
        assert there is not None
        path = paths(start, goal, body.radius_min)[0]
        optimum = length(path) if stays_inside(start, path, room, body) else None
        distance, turn = hypot(there[0] - goal[0], there[1] - goal[1]), abs(wrap_angle(there[2] - goal[2]))
        found.append(Trip(start, goal, distance, turn, clear, driven, optimum))
    return found


def ratio(found: Sequence[Trip]) -> float:
    """Mean of driven length over optimum, of the trips whose optimum stays inside."""
    ratios = [trip.driven / trip.optimum for trip in found if trip.optimum]
    return sum(ratios) / len(ratios)


def sentence(found: Sequence[Trip]) -> str:
    """Return the figures of these trips."""
    inside = sum(trip.optimum is not None for trip in found)
    return (
        f"{sum(trip.arrived for trip in found)} of {len(found)} arrived within 5 cm and 5 degrees and touched no wall. "
        f"They were off by {100.0 * sum(trip.distance for trip in found) / len(found):.1f} cm in the mean, "
        f"{100.0 * max(trip.distance for trip in found):.1f} cm and "
        f"{degrees(max(trip.turn for trip in found)):.1f} degrees at worst. "
        f"The nearest came within {100.0 * min(trip.clear for trip in found):.1f} cm of a wall. "
        f"In {inside} trips the Reeds-Shepp optimum stays inside the room; "
        f"there the path is {ratio(found):.3f} times the optimum in the mean"
    )
