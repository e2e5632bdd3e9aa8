"""A gamepad, SDL's virtual one, drives the robot from a process of its own; unplugged or killed, the robot stops."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import pytest

from txt1.bridges.registry import BRIDGES, bridge
from txt1.kernel.loop import run
from txt1.robot import Robot

pytest.importorskip("pygame", reason="pygame-ce is not installed: pip install 'txt1[gamepad]'")

ROOT = Path(__file__).parents[2]
PATIENT = ("safety.missed_ticks_max=100000", "sim.room.length=.inf", "sim.room.width=.inf")


@pytest.mark.parametrize("what", ["unplugged", "killed"])
def test_a_pad_drives_and_the_robot_stops_when_it_is_gone(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}")
    monkeypatch.setitem(BRIDGES.ours, "gamepad", "tests.unit.bridges.virtual_pad:driven")  # type: ignore[arg-type]

    async def main() -> tuple[float, float]:
        async with Robot.open(hal="sim", seed=1, settings=PATIENT) as robot:
            await robot.load_gains()
            state = robot.runtime.state

            async def until(moves: bool) -> None:
                async with asyncio.timeout(20.0):
                    while (state.control.v > 1.0) is not moves:
                        await asyncio.sleep(0.002)

            async with bridge(robot, "gamepad", {"unplugged": what == "unplugged"}) as beside:
                await until(True)
                assert robot.driver.name == "gamepad" and state.control.v == 1.5
                if what == "killed":
                    await asyncio.sleep(0.2)
                    assert beside.pid is not None
                    os.kill(beside.pid, signal.SIGKILL)
                    began = robot.now
                else:
                    began = 0.0
                await until(False)
                return began, robot.now

    began, ended = run(main())
    assert what == "unplugged" or ended - began < 0.25 + 0.02 + 0.05
