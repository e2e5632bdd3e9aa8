"""Boxes that move along paths in the simulated room."""

import asyncio
from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import txt1
from txt1.config import load
from txt1.errors import ConfigError
from txt1.kernel.loop import run
from txt1.model.light_sensors import LUX_MIN, Readings
from txt1.sensors.light import LIGHT, eyes
from txt1.sim.movers import Moving
from txt1.sim.obstacles import gap
from txt1.sim.parameters import Box, Mover, Post
from txt1.sim.shadow import between
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


def test_a_path_without_length_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"sim\.movers\.0\.path: all points of its path are the same: give two"):
        run(met("sim.movers=[{path: [[1, 1], [1, 1]], speed: 1}]"), speed="max")
    with pytest.raises(ConfigError, match=r"sim\.movers\.0\.path: tuple should have at least 2 items"):
        load(overrides=["sim.movers=[{path: [[1, 1]], speed: 1}]"])
    with pytest.raises(ConfigError, match=r"sim\.start: .*sticks into something that moves"):
        run(met("sim.start=[1, 1.4, 0]"), speed="max")


@pytest.mark.parametrize(
    ("obstacle", "hidden"),
    [
        (Post(1.0, 0.0, 0.1), True),
        (Post(1.0, 0.11, 0.1), False),
        (Post(2.5, 0.0, 0.1), False),
        (Box(1.0, 0.2, 0.2, 0.5), True),
        (Box(1.0, 0.3, 0.2, 0.5), False),
        (Box(1.0, 0.3, 0.2, 0.7), True),
        (Box(1.0, 0.3, 0.2, 0.7, 1.57), False),
        (Box(-0.5, 0.0, 0.2, 0.5), False),
    ],
)
def test_an_obstacle_between_two_places_hides_them_from_each_other(obstacle: Box | Post, hidden: bool) -> None:
    assert between(obstacle, (2.0, 0.0), (0.0, 0.0)) is hidden
    assert between(obstacle, (0.0, 0.0), (2.0, 0.0)) is hidden


def test_an_obstacle_throws_a_shadow_but_not_the_one_that_the_lamp_stands_on() -> None:
    bare = load(overrides=["sim.light.noise=0"]).config
    post = load(overrides=["sim.light.noise=0", "sim.obstacles=[{kind: post, x: 1.0, y: 0.0, radius: 0.3}]"]).config
    lamp_post = load(overrides=["sim.light.noise=0", "sim.obstacles=[{kind: post, x: 0, y: 0, radius: 0.1}]"]).config
    see, clear, on_post = (eyes(config, np.random.default_rng(1)) for config in (post, bare, lamp_post))
    assert see((2.0, 0.0, 0.0)) == (LUX_MIN,) * 4
    assert see((0.0, 2.0, 0.0)) == clear((0.0, 2.0, 0.0))
    assert on_post((2.0, 0.0, 0.0)) == clear((2.0, 0.0, 0.0))


def test_a_mover_s_shadow_moves_with_it() -> None:
    async def seen() -> list[Readings]:
        settings = ["sim.light.noise=0", "sim.start=[2, 0, 0]", "sim.room={length: .inf, width: .inf}"]
        settings += ["sensors.light.driver=sim_light", "sim.movers=[{path: [[1, 2], [1, -2]], speed: 1.0}]"]
        told: list[Readings] = []
        async with txt1.Robot.open("sim", settings=settings) as robot:
            robot.runtime.bus.subscribe(lambda _, value, time: told.append(value), [LIGHT])
            await asyncio.sleep(4.0)
        return told

    dark = [each == (LUX_MIN,) * 4 for each in run(seen(), speed="max")]
    assert not dark[0] and not dark[-1]
    assert any(dark)
