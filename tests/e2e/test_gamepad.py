"""A gamepad, SDL's virtual one, drives the robot from a process of its own; when it is gone, the robot stops."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.e2e.conftest import ENDLESS, passing
from tests.patience import lateness, until
from txt1.bridges.registry import BRIDGES, bridge
from txt1.control.holding import HOLD_LASTS
from txt1.kernel.loop import run
from txt1.robot import Robot

pytest.importorskip("pygame", reason="pygame-ce is not installed: the extra 'gamepad'")

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.usefixtures("patient")


@pytest.mark.parametrize("what", ["unplugged", "out of reach", pytest.param("killed", marks=pytest.mark.long)])
def test_a_pad_drives_and_the_robot_stops_when_it_is_gone(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}")
    monkeypatch.setitem(BRIDGES.table, "gamepad", "rigs.virtual_pad:driven")  # type: ignore[arg-type]

    async def main(late: Callable[[], float]) -> None:
        async with Robot.open(hal="sim", seed=1, settings=ENDLESS) as robot:
            await robot.load_gains()
            passed = passing(robot.runtime)
            async with bridge(robot, "gamepad", {"unplugged": what == "unplugged"}) as beside:
                await until(lambda: passed and passed[-1].v == 1.5 and robot.driver.name == "gamepad")
                if what == "killed":
                    assert beside.pid is not None
                    os.kill(beside.pid, signal.SIGKILL)
                    await until(lambda: beside.pid is None)
                    killed = robot.now
                if what == "out of reach":
                    began = passed[0].time
                    await until(lambda: robot.now > began + HOLD_LASTS + 0.5 + late())
                    assert HOLD_LASTS - 0.3 - late() < passed[-1].time - began < HOLD_LASTS + 0.3 + late()
                await until(lambda: robot.now > passed[-1].given + 0.5 and robot.runtime.state.control.v == 0.0)
                assert what != "killed" or max(each.given for each in passed) <= killed
                assert max(each.time - each.given for each in passed) <= 0.25 + 1e-6

    with lateness() as late:
        run(main(late))
