"""Driving to poses and along waypoints, through the Robot API, in virtual time."""

import asyncio
import os
import random
from math import degrees, hypot, inf, pi

import pytest

from txt1.control.schedule import Schedule
from txt1.errors import CommandRefused, NotArmed
from txt1.kernel import Ticks
from txt1.model.kinematics import wrap_angle
from txt1.model.reeds_shepp import Pose, length, shortest
from txt1.model.vehicle import Geometry
from txt1.navigation import PoseSource, follow, go_to, true_pose, wheel_pose
from txt1.navigation.plan import stays_inside
from txt1.robot import Robot
from txt1.sim.room import Room, clearance

ROOM = Room(5.0, 5.0)
BODY = Geometry()
PAIRS = int(os.environ.get("TXT1_POSE_PAIRS", "24"))
"""1000 for the figure in docs/drive-tests.md; that takes three minutes."""
EXTERNAL_SUPPLY = ("sim.battery.used_1=null",)


class Watch:
    """The true path of a robot: its length, and the least distance of the body from the walls."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.reset()
        robot.add_task("watch", 0.02, self._look, priority=-1)

    def reset(self) -> None:
        self.driven, self.clear = 0.0, inf
        self._last: Pose | None = None

    async def _look(self, ticks: Ticks) -> None:
        async for _ in ticks:
            pose = self._robot.pose
            assert pose is not None
            if self._last is not None:
                self.driven += hypot(pose[0] - self._last[0], pose[1] - self._last[1])
            self._last = pose
            self.clear = min(self.clear, clearance(*pose, ROOM, BODY))


@pytest.mark.parametrize("by", ["odometry", "true pose"])
async def test_it_arrives_from_anywhere_anywhere_inside_the_room(by: str) -> None:
    chance = random.Random(11)

    def pose() -> Pose:
        return chance.uniform(-1.9, 1.9), chance.uniform(-1.9, 1.9), chance.uniform(-pi, pi)

    ratios: list[float] = []
    misses: list[tuple[float, float]] = []
    clear = inf
    async with Robot.open("sim", seed=1, settings=EXTERNAL_SUPPLY) as robot:
        assert await robot.load_gains()
        watch = Watch(robot)
        for _ in range(PAIRS if by == "odometry" else PAIRS // 3):
            start, goal = pose(), pose()
            robot.place(*start)
            await asyncio.sleep(0.1)
            watch.reset()
            source = true_pose(robot) if by == "true pose" else wheel_pose(robot, start)
            assert (await go_to(robot, goal, pose_source=source, room=ROOM)).arrived
            there = robot.pose
            assert there is not None
            misses.append((hypot(there[0] - goal[0], there[1] - goal[1]), degrees(abs(wrap_angle(there[2] - goal[2])))))
            clear = min(clear, watch.clear)
            assert misses[-1][0] <= 0.05
            assert misses[-1][1] <= 5.0
            assert watch.clear > 0.0, "it never touches a wall"
            optimum = shortest(start, goal, BODY.radius_min)
            if stays_inside(start, optimum, ROOM, BODY):
                ratios.append(watch.driven / length(optimum))
    print(
        f"\n{len(misses)} pose pairs by {by}: off by {sum(d for d, _ in misses) / len(misses):.3f} m in the mean, "
        f"{max(d for d, _ in misses):.3f} m at worst, {max(t for _, t in misses):.2f} degrees at worst; path "
        f"{sum(ratios) / len(ratios):.3f} times the optimum in the mean; {clear:.3f} m from a wall at the nearest"
    )
    assert sum(ratios) / len(ratios) <= 1.25


async def test_going_where_it_stands_moves_it_no_farther_than_it_must(robot: Robot) -> None:
    arrival = await go_to(robot, (0.0, 0.0, 0.0))
    assert arrival.plans == 1
    assert arrival.distance < 0.02


async def test_a_closed_gate_ends_it_with_the_reason(robot: Robot) -> None:
    going = asyncio.ensure_future(go_to(robot, (3.0, 0.0, 0.0)))
    await asyncio.sleep(2.0)
    robot.stop()
    with pytest.raises(NotArmed, match="emergency stop"):
        await going


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), 5.0])
async def test_a_speed_that_makes_no_sense_is_refused(robot: Robot, speed: float) -> None:
    with pytest.raises(CommandRefused, match="speed must be"):
        await go_to(robot, (1.0, 0.0, 0.0), speed=speed)


async def test_a_source_that_knows_no_pose_is_refused(robot: Robot) -> None:
    with pytest.raises(CommandRefused, match="'vicon' does not know"):
        await go_to(robot, (1.0, 0.0, 0.0), pose_source=PoseSource("vicon", lambda: None))


async def test_without_gains_that_steer_backward_it_drives_backward_slowly(robot: Robot) -> None:
    assert isinstance(robot.runtime.state.gains.angular, Schedule)
    fastest = 0.0

    async def watch(ticks: Ticks) -> None:
        nonlocal fastest
        async for _ in ticks:
            fastest = max(fastest, -robot.odometry.v)

    robot.add_task("watch", 0.02, watch)
    await go_to(robot, (-0.6, 0.3, -0.8))
    assert 0.05 < fastest < 0.2


async def test_waypoints_are_passed_in_turn_and_the_last_is_a_stop(robot: Robot) -> None:
    legs: list[int] = []
    await follow(
        robot, [(3.0, 0.0), (3.0, 3.0), (0.0, 3.0)], laps=2, on_leg=lambda number, start, end: legs.append(number)
    )
    assert legs == [0, 1, 2, 3, 4, 5, 6]
    await asyncio.sleep(2.0)
    assert robot.pose is not None
    assert hypot(robot.pose[0] - 3.0, robot.pose[1]) < 0.4
    assert robot.odometry.v == 0.0


async def test_no_waypoints_are_refused(robot: Robot) -> None:
    with pytest.raises(CommandRefused, match="no waypoints"):
        await follow(robot, [])
