"""The speed steps of the thesis's figure 4.3, on boards with the habits of the originals and on ours."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from tests.e2e.test_board import GAINS, Desk, Host
from txt1.config import load
from txt1.link.base import connect
from txt1.link.impairments import paced
from txt1.protocol.messages import Velocity
from txt1.robot import Robot
from txt1.sim.vehicle import Vehicle

ENDLESS = ("sim.room.length=.inf", "sim.room.width=.inf")
STEPS = (0.25, 0.5, 1.0)
"""m/s, each forwards and backwards, with a rest before."""


class Watched:
    """What a car did in each step: its mean speed in the last second, m/s, and the most by which its wheels slipped."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.speeds: dict[float, float] = {}
        self.slips: dict[float, float] = {}

    async def step(self, v: float, seconds: float) -> None:
        speeds, slips = [], [0.0]
        for _ in range(round(seconds / 0.02)):
            await asyncio.sleep(0.02)
            speeds.append(self.vehicle.state.v)
            slips.append(abs(self.vehicle.state.spin))
        self.speeds[v], self.slips[v] = sum(speeds[-50:]) / 50, max(slips)

    def judge(self, scale: float) -> None:
        for v in (way * step for step in STEPS for way in (1, -1)):
            assert self.speeds[v] == pytest.approx(v / scale, rel=0.05), f"it follows {v} m/s"


@pytest.mark.parametrize(("habits", "scale"), [("original", 0.937), ("ours", 1.0)])
@pytest.mark.parametrize("seed", [1, 2])
async def test_a_host_that_only_sends_velocities_drives_the_steps(habits: str, scale: float, seed: int) -> None:
    desk, host = Desk("virtual", f"board.habits={habits}", f"seed={seed}", *ENDLESS), Host()
    await desk.power_up()
    connect(host, paced(desk, 57600))
    host.send(GAINS)
    await host.drive(Velocity(0.0, 0.0), 2.5)
    end: Any = desk.end
    watched = Watched(end.vehicle)
    for v in (way * step for step in STEPS for way in (1, -1)):
        await asyncio.gather(host.drive(Velocity(v, 0.0), 4.0), watched.step(v, 4.0))
        await host.drive(Velocity(0.0, 0.0), 3.0)
        assert abs(end.vehicle.state.v) < 0.05, "and stands between them"
    await desk.power_down()
    watched.judge(scale)
    assert (watched.slips[1.0] > 0.3) is (habits == "original"), "its wheels lose their hold at 1 m/s"


@pytest.mark.parametrize(("habits", "scale"), [("original", 0.937), ("ours", 1.0)])
async def test_our_host_drives_the_steps_and_nothing_disarms_it(habits: str, scale: float) -> None:
    given = ["hal=serial", "serial.port=virtual", f"board.habits={habits}", "seed=1", *ENDLESS]
    async with Robot.open(config=load(None, given).config, arm=True) as robot:
        hal: Any = robot.hal
        await robot.load_gains()
        watched = Watched(hal.port.board.vehicle)
        for v in (way * step for step in STEPS for way in (1, -1)):
            await asyncio.gather(robot.drive(v, 0.0, 4.0), watched.step(v, 4.0))
            await robot.drive(0.0, 0.0, 3.0)
        assert robot.armed
        assert not any(robot.faults.values()), robot.faults
    watched.judge(scale)
