"""Driving to poses and along waypoints, through the Robot API, in virtual time."""

import asyncio
import os
from math import hypot

import pytest

from benchmarks.poses import ratio, sentence, trips
from txt1.control.schedule import Schedule
from txt1.errors import CommandRefused, NotArmed
from txt1.kernel.ticks import Ticks
from txt1.navigation import PoseSource, follow, go_to
from txt1.robot import Robot
from txt1.sim.room import Room

ROOM = Room(5.0, 5.0)
PAIRS = int(os.environ.get("POSE_PAIRS", "24"))
"""1000 for the figure in docs/results/drive-tests.md; that takes three minutes."""
EXTERNAL_SUPPLY = ("sim.battery.used_1=null",)


@pytest.mark.long
@pytest.mark.parametrize("by_truth", [False, True], ids=["by odometry", "by the true pose"])
async def test_it_arrives_from_anywhere_anywhere_inside_the_room(by_truth: bool) -> None:
    async with Robot.open("sim", seed=1, settings=EXTERNAL_SUPPLY) as robot:
        assert await robot.load_gains()
        found = await trips(robot, PAIRS // 3 if by_truth else PAIRS, ROOM, seed=11, by_truth=by_truth)
    print(f"\n{sentence(found)}")
    assert all(trip.arrived for trip in found)
    assert ratio(found) <= 1.25


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
