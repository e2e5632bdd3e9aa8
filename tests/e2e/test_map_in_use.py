"""A robot with a map: what is asked of it by a click is meant on the map."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from math import hypot, nan
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from txt1.bridges.services import Services
from txt1.errors import CommandRefused
from txt1.kernel.ticks import Ticks
from txt1.mapping.drive import Sweep
from txt1.mapping.placing import OnMap
from txt1.mapping.poses import composed, difference, placed
from txt1.mapping.telling import MapNews, sheet_of
from txt1.maps.files import read
from txt1.model.reeds_shepp import Pose
from txt1.navigation import go_to, map_pose, plan
from txt1.navigation.goto import Blocked
from txt1.navigation.plan import along
from txt1.robot import Robot
from txt1.ros.robot_end import Ros2RobotEnd
from txt1.sensors.base import Reading
from txt1.sim.room import clearance

ENDLESS = ("sim.battery.used_1=null",)
SURE = (1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-4)


def news(robot: Robot, lost: bool = False) -> Reading[MapNews]:
    """The map's origin is 3 m behind where odometry began."""
    time = robot.now
    x, y, theta = robot.odometry[:3]
    return Reading(time, MapNews(time, (x + 3.0, y, theta), SURE, (3.0, 0.0, 0.0), 0.9, lost))


@pytest.fixture
def there(robot: Robot) -> OnMap:
    """A robot on a map of which nothing but its pose is known."""
    there = OnMap(robot.runtime, False, None)
    robot.runtime.parts.append(there)
    return there


async def test_a_click_is_meant_on_the_map(
    robot: Robot, there: OnMap, tmp_path: Path, every_tick: Callable[[Callable[[], None]], None]
) -> None:
    services = Services(robot, robot.config, "max", tmp_path)
    there.heard(news(robot))
    every_tick(lambda: services.requests["hold"](0.0))  # type: ignore[arg-type,return-value]
    services.requests["go"]([[4.5, 0.0]], 0.5)
    await asyncio.sleep(8.0)
    found = there.pose()
    assert found is not None and hypot(found.x - 4.5, found.y) < 0.4
    assert robot.pose is not None and robot.pose[0] < 2.0
    await services.close()


async def test_a_lost_robot_goes_nowhere_by_a_click(robot: Robot, there: OnMap, tmp_path: Path) -> None:
    services = Services(robot, robot.config, "max", tmp_path)
    there.heard(news(robot, lost=True))
    with pytest.raises(CommandRefused, match="does not know where the robot is"):
        services.requests["go"]([[4.5, 0.0]], 0.5)
    await services.close()


@pytest.fixture
async def flat() -> AsyncIterator[Robot]:
    async with Robot.open("sim", seed=1, settings=(*ENDLESS, "sim.room.map=flat")) as robot:
        assert await robot.load_gains()
        yield robot


def known(robot: Robot) -> OnMap:
    """The robot on the map of the flat; its pose is the true one, told as scans would tell it."""
    there = OnMap(robot.runtime, False, None)
    robot.runtime.parts.append(there)
    sheet = sheet_of(read("flat").grid)

    def tell() -> None:
        assert robot.pose is not None
        pose = robot.pose
        back = difference(robot.odometry[:3], (0.0, 0.0, 0.0))
        x, y, theta = map(float, composed(pose, back))
        there.heard(Reading(robot.now, MapNews(robot.now, pose, SURE, (x, y, theta), 0.9, False, sheet=sheet)))

    tell()
    robot.add_task("news", 0.1, lambda ticks: each(ticks, tell))
    return there


async def each(ticks: Ticks, do: Callable[[], None]) -> None:
    async for _ in ticks:
        do()


async def test_a_click_behind_a_wall_is_reached_round_it(flat: Robot, tmp_path: Path) -> None:
    services = Services(flat, flat.config, "max", tmp_path)
    there, body, least = known(flat), flat.config.geometry, 1.0
    room = there.floor()
    assert room is not None and room.walls is not None and flat.pose is not None
    goal = (5.39, 3.0)
    x, y, _ = flat.pose
    straight = [(x + k / 50.0 * (goal[0] - x), y + k / 50.0 * (goal[1] - y)) for k in range(51)]
    assert min(room.walls.distance(*place) for place in straight) < 0.0, "a wall is between them"
    flat.add_task("hold", 0.05, lambda ticks: each(ticks, lambda: services.requests["hold"](0.0)))  # type: ignore[arg-type,return-value]
    services.requests["go"]([goal], 0.4)
    for _ in range(1200):
        await asyncio.sleep(0.1)
        least = min(least, clearance(*flat.pose, room, body))
        if "the route has been driven" in [event.text for event in flat.runtime.state.events]:
            break
    assert hypot(flat.pose[0] - goal[0], flat.pose[1] - goal[1]) < 0.05
    assert least > 0.0
    await services.close()


async def test_a_goal_in_a_wall_is_refused_and_the_robot_stays(flat: Robot, tmp_path: Path) -> None:
    services = Services(flat, flat.config, "max", tmp_path)
    known(flat)
    before = flat.pose
    flat.add_task("hold", 0.05, lambda ticks: each(ticks, lambda: services.requests["hold"](0.0)))  # type: ignore[arg-type,return-value]
    services.requests["go"]([[20.0, 20.0]], 0.4)
    await asyncio.sleep(1.0)
    assert any("no path leads to" in event.text for event in flat.runtime.state.events)
    assert flat.pose == before and flat.driver.name != "route"
    await services.close()


async def test_rviz_goals_and_places_are_meant_on_the_map(flat: Robot) -> None:
    there, end = known(flat), Ros2RobotEnd(flat)
    where: list[Pose] = []
    there._sensor = SimpleNamespace(place=where.append, newest=None)  # type: ignore[assignment] # noqa: SLF001
    x, y, _ = flat.pose or (nan, nan, nan)
    end._calls.call(1, "initial_pose", {"frame": "map", "x": x, "y": y, "theta": 0.5})  # noqa: SLF001
    end._calls.call(2, "initial_pose", {"frame": "odom", "x": x, "y": y, "theta": 0.5})  # noqa: SLF001
    end._calls.call(3, "initial_pose", {"frame": "map", "x": 20.0, "y": y, "theta": 0.5})  # noqa: SLF001
    end._calls.call(4, "goal_pose", {"frame": "map", "x": 2.41, "y": 3.09, "theta": -2.0})  # noqa: SLF001
    await asyncio.sleep(0.1)
    assert where == [(x, y, 0.5)]
    told = " ".join(event.text for event in flat.runtime.state.events)
    assert "/initialpose: frame_id 'odom': give map" in told and "is no free floor on the map" in told
    for _ in range(900):
        await asyncio.sleep(0.1)
        if any("/goal_pose: " in event.text for event in flat.runtime.state.events):
            break
    assert flat.pose is not None and hypot(flat.pose[0] - 2.41, flat.pose[1] - 3.09) < 0.06
    end._calls.call(5, "goal_pose", {"frame": "map", "x": 20.0, "y": 0.0, "theta": 0.0})  # noqa: SLF001
    await asyncio.sleep(0.2)
    assert any("/goal_pose: no path leads to" in event.text for event in flat.runtime.state.events)


async def test_what_the_laser_sees_in_the_way_stops_the_robot_and_the_next_way_leads_round_it(flat: Robot) -> None:
    there = known(flat)
    room, body = there.floor(), flat.config.geometry
    assert room is not None and flat.pose is not None
    x, y, theta = flat.pose
    box = np.array([(x + 1.6, y + 0.02 * k - 0.1) for k in range(11)])

    class Laser:
        """Sees the front of a box ahead that the map does not have."""

        @property
        def newest(self) -> Sweep:
            assert flat.pose is not None
            back = difference(flat.pose, (0.0, 0.0, 0.0))
            return Sweep(flat.now, placed(back, box), np.array(flat.odometry[:3]))

    goal = (x + 2.6, y, theta)
    there._sensor = Laser()  # type: ignore[assignment] # noqa: SLF001
    with pytest.raises(Blocked, match="something stands in the way"):
        await go_to(flat, goal, pose_source=map_pose(flat), room=room)
    await asyncio.sleep(1.0)
    assert flat.odometry.v == 0.0 and flat.pose[0] > x + 0.3
    assert flat.pose[0] + 0.5 * body.length < box[0, 0], "no contact"
    again = there.floor()
    assert again is not None and len(there.seen()) == 11
    way = plan(flat.pose, goal, again, body)
    nearest = min(hypot(px - box[0, 0], py - y) for px, py, _ in along(flat.pose, way, 0.05))
    assert nearest > 0.5 * body.width
    arrival = await go_to(flat, goal, pose_source=map_pose(flat), room=again)
    assert arrival.arrived
