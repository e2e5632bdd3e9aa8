"""A robot with a map: what is asked of it by a click is meant on the map."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from math import cos, hypot, inf, isnan, nan, pi, sin
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from txt1.bridges.services import Services
from txt1.errors import CommandRefused, NotArmed
from txt1.kernel.ticks import Ticks
from txt1.mapping.map_sensors import OnMap
from txt1.mapping.poses import composed, difference, placed
from txt1.mapping.sweeps import Sweep
from txt1.mapping.topics import MapNews, sheet_of
from txt1.maps.files import read
from txt1.model.reeds_shepp import Pose, Segment
from txt1.navigation import follow, go_to, goto, map_pose, plan, ways
from txt1.navigation.goto import STUCK_AFTER, Blocked, Halted
from txt1.navigation.plan import NoPath, stretches
from txt1.robot import Robot
from txt1.ros.robot_end import Ros2RobotEnd
from txt1.sensors.base import Reading
from txt1.sim.room import Room, clearance

ENDLESS = ("sim.battery.used_1=null",)
SURE = (1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-4)


def news(robot: Robot, lost: bool = False) -> Reading[MapNews]:
    """The map's origin is 3 m behind where odometry began."""
    time = robot.now
    x, y, theta = robot.odometry[:3]
    return Reading(time, MapNews(time, (x + 3.0, y, theta), SURE, (3.0, 0.0, 0.0), 0.9, lost))


@pytest.fixture(scope="module", autouse=True)
def planner() -> None:
    """The planner, compiled: in a test it plans in the event loop, where reading a cache is a blocking call."""
    ways.prepare()


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
    with pytest.raises(CommandRefused, match="does not know where the robot is; wait, or drive by hand"):
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


async def test_two_taps_tell_place_and_heading_and_one_leaves_the_heading_open(flat: Robot, tmp_path: Path) -> None:
    services, there = Services(flat, flat.config, "max", tmp_path), known(flat)
    where: list[Pose] = []
    there._sensor = SimpleNamespace(place=where.append, newest=None)  # type: ignore[assignment] # noqa: SLF001
    x, y, _ = flat.pose or (nan, nan, nan)
    services.requests["here"]([[x, y], [x, y + 1.0]])
    services.requests["here"]([[x, y]])
    assert where[0] == pytest.approx((x, y, pi / 2.0)) and where[1][:2] == (x, y) and isnan(where[1][2])
    with pytest.raises(CommandRefused, match="no free floor on the map"):
        services.requests["here"]([[20.0, y]])
    with pytest.raises(CommandRefused, match="give one or two pairs"):
        services.requests["here"]([[x]])
    await services.close()


class Laser:
    """Sees what stands ahead that the map does not have: places, m on the map."""

    def __init__(self, robot: Robot, places: Callable[[], Sequence[tuple[float, float]]]) -> None:
        self._robot, self._places = robot, places

    @property
    def newest(self) -> Sweep:
        pose = self._robot.pose
        assert pose is not None
        seen = placed(difference(pose, (0.0, 0.0, 0.0)), np.reshape(self._places(), (-1, 2)))
        by_wheels = np.array(self._robot.odometry[:3])
        return Sweep(self._robot.now, seen[seen[:, 0] > 0.0], by_wheels, by_wheels)


async def test_the_robot_drives_round_what_the_laser_sees_in_the_way(flat: Robot) -> None:
    there = known(flat)
    room, body = there.floor(), flat.config.geometry
    assert room is not None and flat.pose is not None
    x, y, theta = flat.pose
    box = [(x + 1.6, y + 0.02 * k - 0.1) for k in range(11)]
    # it is there when the way has been planned
    there._sensor = Laser(flat, lambda: box if robot_at(flat)[0] > x + 0.2 else ())  # type: ignore[assignment] # noqa: SLF001
    nearest = 10.0

    def look() -> None:
        nonlocal nearest
        px, py, ptheta = robot_at(flat)
        seen = placed(difference((px, py, ptheta), (0.0, 0.0, 0.0)), np.array(box))
        nearest = min(
            nearest, float(np.maximum(abs(seen[:, 0]) - 0.5 * body.length, abs(seen[:, 1]) - 0.5 * body.width).min())
        )

    flat.add_task("look", 0.02, lambda ticks: each(ticks, look))
    arrival = await go_to(flat, (x + 2.6, y, theta), pose_source=map_pose(flat), room=room)
    assert arrival.arrived and nearest > 0.02
    assert any("stands in the way" in event.text for event in flat.runtime.state.events)


async def test_where_somebody_walked_by_there_is_a_way_again(flat: Robot) -> None:
    there = known(flat)
    room = there.floor()
    assert room is not None and flat.pose is not None
    x, y, theta = flat.pose
    goal = (x + 2.6, y, theta)
    # round the robot's front, and out of sight; no ray clears the floor
    way = [(x + 0.8 * cos(0.05 * k), y + 0.8 * sin(0.05 * k)) for k in range(-31, 32)]
    there._sensor = Laser(flat, lambda: way if flat.now < begun + 0.5 else ())  # type: ignore[assignment] # noqa: SLF001
    begun = flat.now
    await asyncio.sleep(1.5)
    floor = there.floor()
    assert floor is not None
    with pytest.raises(NoPath):
        plan(flat.pose, goal, floor, flat.config.geometry)
    assert (await go_to(flat, goal, pose_source=map_pose(flat), room=room)).arrived


async def test_a_robot_that_finds_no_way_round_what_it_sees_says_so_and_stays(flat: Robot) -> None:
    there = known(flat)
    room = there.floor()
    assert room is not None and flat.pose is not None
    x, y, theta = flat.pose
    # whatever it does, something comes into its way
    there._sensor = Laser(flat, lambda: [(robot_at(flat)[0] + 0.6, y + 0.1 * k) for k in range(-6, 7)])  # type: ignore[assignment] # noqa: SLF001
    begun = flat.now
    with pytest.raises(Blocked, match="something stands in the way"):
        await go_to(flat, (x + 2.6, y, theta), pose_source=map_pose(flat), room=room)
    assert flat.now < begun + 20.0
    await asyncio.sleep(0.5)
    assert flat.odometry.v == 0.0 and flat.driver.name != "program"


async def test_a_robot_waits_for_somebody_who_leaves_it_no_way_and_goes_on(flat: Robot) -> None:
    there = known(flat)
    room = there.floor()
    assert room is not None and flat.pose is not None
    x, y, theta = flat.pose
    came: list[float] = []

    def somebody() -> list[tuple[float, float]]:
        """All across the room, as soon as the robot is on its way, and for 6 s."""
        if not came and robot_at(flat)[0] > x + 0.3:
            came.append(flat.now)
        return [(x + 1.3, y + 0.05 * k) for k in range(-50, 51)] if came and flat.now < came[0] + 6.0 else []

    there._sensor = Laser(flat, somebody)  # type: ignore[assignment] # noqa: SLF001
    arrival = await go_to(flat, (x + 2.6, y, theta), pose_source=map_pose(flat), room=room)
    assert arrival.arrived and flat.now > came[0] + STUCK_AFTER


async def test_a_stop_ends_the_wait_for_somebody_who_leaves_no_way(
    flat: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = known(flat)
    room = there.floor()
    assert room is not None and flat.pose is not None
    x, y, theta = flat.pose

    def nothing(start: Pose, goal: Pose, room: Room, *_: object) -> None:
        raise NoPath(goal, room)

    def somebody() -> list[tuple[float, float]]:
        if robot_at(flat)[0] < x + 0.3:
            return []
        monkeypatch.setattr(goto, "plan", nothing)
        monkeypatch.setattr(goto, "plan_with_run_up", nothing)
        return [(x + 1.3, y + 0.05 * k) for k in range(-10, 11)]

    there._sensor = Laser(flat, somebody)  # type: ignore[assignment] # noqa: SLF001
    driving = asyncio.ensure_future(go_to(flat, (x + 2.6, y, theta), pose_source=map_pose(flat), room=room))
    while not any("and looks again" in event.text for event in flat.runtime.state.events):
        assert not driving.done()
        await asyncio.sleep(0.05)
    await asyncio.sleep(1.0)
    stopped = flat.now
    flat.stop()
    with pytest.raises(NotArmed):
        await driving
    assert flat.now < stopped + 0.2


async def test_a_robot_backs_up_only_where_the_laser_has_seen_free_floor(flat: Robot) -> None:
    there = known(flat)
    room, body = there.floor(), flat.config.geometry
    assert room is not None and flat.pose is not None
    x, y, theta = flat.pose
    behind = (x - 0.8, y, theta)
    assert all(segment.distance < 0.0 for segment in plan(flat.pose, behind, room, body)), "the map alone lets it"
    there._sensor = Laser(flat, tuple)  # type: ignore[assignment] # noqa: SLF001
    await asyncio.sleep(0.2)
    floor = there.floor()
    assert floor is not None
    try:
        way = plan(flat.pose, behind, floor, body)
    except NoPath as error:
        assert "only where the laser has seen free floor" in str(error)
    else:
        assert stretches(way)[0][0].distance > 0.0
    # it has driven there itself
    await go_to(flat, (x + 1.0, y, theta), pose_source=map_pose(flat), room=room)
    floor = there.floor()
    assert floor is not None
    assert all(segment.distance < 0.0 for segment in plan(robot_at(flat), (x + 0.1, y, theta), floor, body))


def with_nobody_there(flat: Robot) -> tuple[OnMap, Room]:
    """The map in use with a laser that sees the walls alone, and its floor before that."""
    there = known(flat)
    room = there.floor()
    assert room is not None
    there._sensor = Laser(flat, tuple)  # type: ignore[assignment] # noqa: SLF001
    return there, room


async def test_a_way_that_begins_backward_is_driven_as_far_as_its_floor_was_seen(
    flat: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, room = with_nobody_there(flat)
    assert flat.pose is not None
    x, y, theta = flat.pose
    await go_to(flat, (x + 1.7, y, theta), pose_source=map_pose(flat), room=room)
    goal, ways = (x - 1.0, y, theta), [(Segment(0.0, -2.7),)]

    def way(*_: object) -> tuple[Segment, ...]:
        if ways:
            return ways.pop()
        raise NoPath(goal)

    monkeypatch.setattr(goto, "plan", way)
    with pytest.raises(NoPath):
        await go_to(flat, goal, pose_source=map_pose(flat), room=room)
    assert robot_at(flat)[0] == pytest.approx(x, abs=0.15)


def robot_at(robot: Robot) -> Pose:
    assert robot.pose is not None
    return robot.pose


async def test_a_robot_that_something_holds_gives_up_in_words_within_20_s(flat: Robot) -> None:
    known(flat)
    assert flat.pose is not None
    x, y, theta = flat.pose
    # nothing that it could see: the guard lets it creep at most
    flat.runtime.guard("wall", lambda v, omega, now: (0.001 * v, 0.001 * omega))
    room, begun = flat.runtime.part(OnMap), flat.now
    assert room is not None
    with pytest.raises(Halted, match=r"told to drive and hardly moves: something at \(.*\) stops it"):
        await go_to(flat, (x + 2.0, y, theta), pose_source=map_pose(flat), room=room.floor())
    assert flat.now - begun < 20.0
    await asyncio.sleep(0.5)
    assert flat.odometry.v == 0.0 and flat.driver.name != "program"


async def test_a_patrol_that_something_holds_ends_in_words(flat: Robot) -> None:
    flat.runtime.guard("wall", lambda v, omega, now: (0.0, 0.0))
    with pytest.raises(Halted, match="hardly moves"):
        await follow(flat, [(1.0, 0.0), (0.0, 1.0)], laps=inf)
    assert flat.now < 40.0 and flat.driver.name != "program"
