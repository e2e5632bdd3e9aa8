"""The obstacle stop: in random worlds, at random speeds, the laser late by 0.1 s, the vehicle touches nothing."""

from __future__ import annotations

import pytest

from benchmarks.obstacle_stop import LATE, drive
from txt1.config import Config, load
from txt1.errors import ConfigError
from txt1.robot import Robot
from txt1.sim.obstacles import gap
from txt1.sim.room import clearance


async def test_no_contact_in_random_worlds() -> None:
    drives = [await drive(seed) for seed in range(1, 6)]
    assert all(each.nearest > 0.0 for each in drives)
    assert sum(each.slowed > 0 for each in drives) >= 3
    assert max(each.fastest for each in drives) > 0.8


@pytest.fixture(params=["txt1", "f1tenth", "donkeycar", "rover"])
def car(request: pytest.FixtureRequest) -> Config:
    chosen = () if request.param == "txt1" else (f"vehicle={request.param}",)
    return load(None, [*LATE, *chosen, "hal=sim", "seed=1", "sim.room.length=8", "sim.room.width=8"], {}).config


async def test_each_car_stands_before_a_wall(car: Config) -> None:
    async with Robot.open(config=car) as robot:
        await robot.load_gains()
        for _ in range(8):
            await robot.drive(1.0, 0.0, 1.0)
        vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
        assert abs(vehicle.motion[3]) < 0.05
        left = clearance(*vehicle.pose, vehicle.world.room, vehicle.body)
        assert 0.04 < left < 0.15, "it stands, in front of the wall, by about the margin"


async def test_a_silent_laser_stops_the_vehicle_and_backwards_is_slow() -> None:
    settings = (*LATE, "sensors.laser.drop_out=1.0", "sim.room.length=20", "sim.room.width=20")
    async with Robot.open("sim", settings=settings) as robot:
        assert await robot.load_gains()
        await robot.drive(1.0, 0.0, 2.0)
        assert robot.pose is not None
        assert robot.pose[0] == pytest.approx(0.0, abs=1e-6)
        await robot.drive(-1.0, 0.0, 2.0)
        assert robot.runtime.state.control.v == pytest.approx(-0.3)


@pytest.mark.parametrize(("people", "slow"), [(1.6, True), (0.0, False)])
async def test_it_has_nearly_stopped_when_somebody_walks_into_it_head_on(people: float, slow: bool) -> None:
    somebody = "sim.movers=[{path: [[6.0, 0.0], [-6.0, 0.0]], speed: 1.6, length: 0.3, width: 0.3}]"
    settings = (*LATE, somebody, f"obstacle_stop.people={people}", "sim.room.length=20", "sim.room.width=20")
    async with Robot.open("sim", settings=settings) as robot:
        assert await robot.load_gains()
        vehicle, left = robot.hal.vehicle, 9.0  # type: ignore[attr-defined]
        while left > 0.03:
            await robot.drive(0.6, 0.0, 0.02)
            left = gap(vehicle.outline(vehicle.motion), *vehicle.world.moving(vehicle, robot.now))
        assert (abs(vehicle.motion[3]) < 0.05) == slow


async def test_without_a_laser_there_is_no_obstacle_stop() -> None:
    async with Robot.open("sim") as robot:
        assert robot.runtime.gate.guards == []
    with pytest.raises(ConfigError, match=r"obstacle_stop.sensor: '' is no laser scanner; name one of: none"):
        async with Robot.open("sim", settings=("obstacle_stop.enabled=always",)):
            pass


async def test_no_guard_makes_it_faster_or_turns_it_round() -> None:
    async with Robot.open("sim") as robot:
        gate = robot.runtime.gate
        for wild in ((2.0, 0.0), (-0.5, 0.0), (float("nan"), 0.0), (0.5, float("inf"))):
            gate.guards[:] = [lambda v, omega, now, wild=wild: wild]
            assert gate.guarded(1.0, 0.2, 0.0) == (0.0, 0.0)
        gate.guards[:] = [lambda v, omega, now: (0.5 * v, 0.5 * omega)]
        assert gate.guarded(1.0, 0.2, 0.0) == (0.5, 0.1)
