"""A robot with a map: what is asked of it by a click is meant on the map."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import hypot
from pathlib import Path

import pytest

from txt1.bridges.services import Services
from txt1.errors import CommandRefused
from txt1.mapping.placing import OnMap
from txt1.mapping.telling import MapNews
from txt1.robot import Robot
from txt1.sensors.base import Reading

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
