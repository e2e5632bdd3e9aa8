"""A stranger's guard, by the view of the robot that it is given alone."""

from __future__ import annotations

import asyncio
import sys
from math import hypot
from pathlib import Path

import pytest

from txt1.config import load
from txt1.control.guarding import GuardView
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.runtime import Runtime
from txt1.sensors.readings import Scan

SITE = Path(__file__).parent / "site"


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SITE)


def test_a_fence_keeps_the_robot_near_its_start_and_lets_it_come_back(site: None) -> None:
    from plugin_fence import Fence, prepare

    async def drive() -> tuple[float, float]:
        config = load(overrides=["sim.room.length=20", "sim.room.width=20"]).config
        runtimes: list[Runtime] = []
        async with Robot.open(config=config, attach=runtimes.append) as robot:
            await prepare(runtimes[0], Fence(0.8))
            await robot.load_gains()
            await robot.drive(0.5, 0.0, 5.0)
            out = hypot(*robot.odometry[:2])
            await robot.drive(-0.5, 0.0, 1.0)
            return out, hypot(*robot.odometry[:2])

    out, back = run(drive(), speed="max")
    assert 0.8 < out < 1.1
    assert back < out - 0.2
    sys.modules.pop("plugin_fence", None)


def test_a_view_has_what_the_robot_measures_now() -> None:
    async def look() -> None:
        config = load(overrides=["sensors.laser.driver=sim_laser"]).config
        runtimes: list[Runtime] = []
        async with Robot.open(config=config, attach=runtimes.append) as robot:
            view = GuardView(runtimes[0])
            await robot.load_gains()
            await robot.drive(0.4, 0.2, 2.0)
            assert view.pose == robot.odometry[:3] and view.velocity == robot.odometry[3:]
            assert view.armed and view.size == (0.51, 0.385, config.geometry.centre)
            reading = view.reading("laser", within=0.3)
            assert reading is not None and isinstance(reading.value, Scan)
            assert view.reading("laser", within=0.0) is None
            with pytest.raises(KeyError):
                view.reading("radar", within=1.0)
            robot.disarm("enough")
            await asyncio.sleep(0.1)
            assert not view.armed

    run(look(), speed="max")
