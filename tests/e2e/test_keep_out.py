"""The areas of a map that a robot keeps out of: by hand, by a planned way, and after it was carried into one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest

from txt1.guards.keep_out.guard import prepare
from txt1.mapping.map_sensors import OnMap
from txt1.mapping.poses import composed, difference, placed
from txt1.mapping.topics import MapNews, sheet_of
from txt1.maps.files import read
from txt1.maps.keep_out import Area, inside
from txt1.navigation import NoPath, go_to, map_floor, map_pose, ways
from txt1.robot import Robot
from txt1.sensors.base import Reading

AHEAD: Area = ((0.9, -0.3), (1.3, -0.3), (1.3, 0.3), (0.9, 0.3))
BEHIND: Area = ((-0.9, -0.3), (-0.8, -0.3), (-0.8, 0.3), (-0.9, 0.3))
ABOUT: Area = ((-0.6, -0.6), (0.6, -0.6), (0.6, 0.6), (-0.6, 0.6))
SURE = (1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-4)


@pytest.fixture(scope="module", autouse=True)
def planner() -> None:
    """The planner, compiled: in a test it plans in the event loop, where reading a cache is a blocking call."""
    ways.prepare()


@pytest.fixture
async def flat() -> AsyncIterator[Robot]:
    async with Robot.open("sim", seed=1, settings=("sim.battery.used_1=null", "sim.room.map=flat")) as robot:
        assert await robot.load_gains()
        yield robot


async def guarded(robot: Robot, *areas: Area) -> None:
    """Give the robot a map of the flat with areas; its pose is the true one."""
    there = OnMap(robot.runtime, False, None)
    robot.runtime.parts.append(there)
    sheet = sheet_of(read("flat").grid)._replace(keep_out=areas)
    assert await prepare(robot.runtime, None) is not None

    async def tell(ticks) -> None:
        async for _ in ticks:
            pose = robot.pose
            x, y, theta = map(float, composed(pose, difference(robot.odometry[:3], (0.0, 0.0, 0.0))))
            there.heard(Reading(robot.now, MapNews(robot.now, pose, SURE, (x, y, theta), 0.9, False, sheet=sheet)))

    robot.add_task("news", 0.1, tell)
    await asyncio.sleep(0.3)


def is_in(robot: Robot, area: Area) -> bool:
    """Whether a corner or a side of the body is in an area."""
    body = robot.config.geometry
    along, aside = np.linspace(-0.5, 0.5, 21) * body.length + body.centre, np.linspace(-0.5, 0.5, 15) * body.width
    x, y = placed(robot.pose, np.column_stack((np.repeat(along, 15), np.tile(aside, 21)))).T
    return bool(inside(area, x, y).any())


@pytest.mark.parametrize(("v", "area"), [(0.8, AHEAD), (-0.5, BEHIND)])
async def test_driven_by_hand_it_stops_before_an_area_in_both_gears(flat: Robot, v: float, area: Area) -> None:
    await guarded(flat, area)
    for _ in range(300):
        flat.program.insist(v, 0.0)
        await asyncio.sleep(0.02)
        deep = is_in(flat, area)
        assert not deep, (flat.pose, flat.odometry.v)
    assert abs(flat.pose[0]) > 0.2 and abs(flat.odometry.v) < 0.02
    assert any("keep out" in event.text for event in flat.runtime.state.events)


async def test_a_way_leads_round_an_area_and_a_goal_in_it_is_refused(flat: Robot) -> None:
    await guarded(flat, AHEAD)
    with pytest.raises(NoPath):
        await go_to(flat, (1.1, 0.0, 0.0), pose_source=map_pose(flat), room=map_floor(flat))
    touched: list[float] = []

    async def look(ticks) -> None:
        async for _ in ticks:
            if is_in(flat, AHEAD):
                touched.append(flat.now)

    flat.add_task("look", 0.05, look)
    arrival = await go_to(flat, (2.0, 0.0, 0.0), pose_source=map_pose(flat), room=map_floor(flat))
    assert arrival.arrived and not touched


async def test_a_robot_that_was_carried_into_an_area_may_leave_it(flat: Robot) -> None:
    await guarded(flat, ABOUT)
    for _ in range(200):
        flat.program.insist(0.5, 0.0)
        await asyncio.sleep(0.02)
    assert flat.pose[0] > 1.0


def test_a_map_that_is_made_anew_keeps_its_areas(tmp_path: Path) -> None:
    from txt1.mapping import grid_files
    from txt1.maps.files import keep_out_of

    file = tmp_path / "room.yaml"
    grid_files.put({file: grid_files.description(read("flat").grid, "room.pgm", (AHEAD, ABOUT)).encode()})
    assert keep_out_of(file) == (AHEAD, ABOUT)
