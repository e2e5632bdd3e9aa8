"""Boxes that move along paths in the simulated room."""

import asyncio
from math import pi
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import txt1
from txt1.config import load
from txt1.errors import ConfigError
from txt1.kernel.loop import run
from txt1.sim.movers import Moving
from txt1.sim.obstacles import gap
from txt1.sim.parameters import Mover
from txt1.tasks.fields import MOVERS

PATH = ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0))
ACROSS = "sim.movers=[{path: [[1.0, 1.5], [1.0, -1.5]], speed: 0.5}]"


def test_it_goes_to_and_fro_or_round_and_round() -> None:
    to_and_fro, round_ = Moving(Mover(PATH, 1.0)), Moving(Mover((*PATH, (0.0, 1.0)), 1.0, lap=True))
    places = [to_and_fro.at(t) for t in (0.0, 1.0, 2.5, 3.0, 3.5, 5.0, 6.0, 7.0)]
    assert [(each.x, each.y) for each in places] == [
        (0.0, 0.0), (1.0, 0.0), (2.0, 0.5), (2.0, 1.0), (2.0, 0.5), (1.0, 0.0), (0.0, 0.0), (1.0, 0.0)
    ]  # fmt: skip
    assert [(each.x, each.y) for each in map(round_.at, (4.0, 5.5, 6.0, 7.0))] == [(1, 1), (0, 0.5), (0, 0), (1, 0)]
    assert round_.at(2.5).theta == pytest.approx(pi / 2)


@given(st.floats(0.0, 1e4), st.floats(0.0, 0.1), st.booleans())
def test_it_is_never_faster_than_its_speed_and_stays_on_its_path(time: float, dt: float, lap: bool) -> None:
    moving = Moving(Mover(PATH, 0.7, lap=lap))
    here, there = moving.at(time), moving.at(time + dt)
    assert abs(there.x - here.x) + abs(there.y - here.y) <= 0.7 * dt * 2.0**0.5 + 1e-6
    assert 0.0 <= here.x <= 2.0 and 0.0 <= here.y <= 1.0


async def met(*settings: str) -> Any:
    async with txt1.Robot.open("sim", settings=[ACROSS, *settings]) as robot:
        await robot.load_gains()
        hal, least = robot.runtime.hal, 1.0
        source = robot.source("test")
        for _ in range(150):
            source.command(0.3, 0.0)
            await asyncio.sleep(0.04)
            least = min([least, *(gap(hal.vehicle.outline(hal.vehicle.pose), each) for each in hal.movers())])
        return hal.vehicle.pose, least, hal.movers(), robot.runtime.snapshot().get(MOVERS)


def test_a_vehicle_is_held_while_something_passes_and_a_run_repeats() -> None:
    pose, least, movers, told = run(met(), speed="max")
    free, _, _, _ = run(met("sim.movers=[]", "seed=0"), speed="max")
    assert pose[0] < free[0] - 0.1, "it was held up"
    assert -0.02 < least < 0.02, "it stood at the mover's side until that had passed"
    assert len(movers) == 1 and told is not None and len(told[0]) == 4
    assert run(met(), speed="max")[0] == pose


def test_the_laser_sees_it_where_it_is() -> None:
    async def seen() -> Any:
        laser = "sensors.laser={driver: sim_laser, options: {noise: 0.0, noise_share: 0.0}}"
        move = "sim.movers=[{path: [[1.2, 0.0], [2.0, 0.0]], speed: 0.1}]"
        async with txt1.Robot.open("sim", settings=[move, laser]) as robot:
            await asyncio.sleep(3.05)
            reading = robot.runtime.sensors["laser"].last
            return reading.value, robot.runtime.hal.movers()[0]

    scan, box = run(seen(), speed="max")
    ahead = scan.ranges[round(-scan.angle_min / scan.angle_step)]
    assert ahead == pytest.approx(box.x - 0.2 - scan.mount.x, abs=0.011)


def test_a_path_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"sim\.movers\.0\.path: all points of its path are one: give two"):
        run(met("sim.movers=[{path: [[1, 1], [1, 1]], speed: 1}]"), speed="max")
    with pytest.raises(ConfigError, match=r"sim\.movers\.0\.path: tuple should have at least 2 items"):
        load(overrides=["sim.movers=[{path: [[1, 1]], speed: 1}]"])
    with pytest.raises(ConfigError, match=r"sim\.start: .*sticks into something that moves"):
        run(met("sim.start=[1, 1.4, 0]"), speed="max")
