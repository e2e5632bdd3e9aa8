"""The obstacle stop: in random worlds, at random speeds, the laser late by 0.1 s, the vehicle touches nothing."""

from __future__ import annotations

import pytest
from blockbuster import BlockBuster
from numpy.random import Generator, default_rng

from txt1.config import Config, load
from txt1.control.limits import Fault
from txt1.errors import ConfigError
from txt1.hal.registry import create as create_hal
from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import yaw_rate_max
from txt1.robot import Robot
from txt1.sim.obstacles import gap
from txt1.sim.room import clearance

LATE = ("sensors.laser.driver=sim_laser", "sensors.laser.delay=0.1")


@pytest.fixture(autouse=True)
def drivers_are_imported_when_they_are_asked_for(blocking_calls_fail: BlockBuster) -> None:
    for function in blocking_calls_fail.functions.values():
        function.can_block_in("txt1/sensors/registry.py", {"create"})


def random_world(rng: Generator) -> Config:
    """A room of 5 x 5 m with up to six posts and boxes, and a start that is 0.15 m from anything."""
    obstacles = []
    for _ in range(rng.integers(1, 7)):
        x, y = rng.uniform(-2.3, 2.3, 2).round(3).tolist()
        if rng.random() < 0.5:
            obstacles.append(f"{{kind: post, x: {x}, y: {y}, radius: {rng.uniform(0.03, 0.3):.3f}}}")
        else:
            length, width, theta = rng.uniform(0.05, 1.0), rng.uniform(0.05, 0.5), rng.uniform(-3.0, 3.0)
            obstacles.append(
                f"{{kind: box, x: {x}, y: {y}, length: {length:.3f}, width: {width:.3f}, theta: {theta:.3f}}}"
            )
    seed = int(rng.integers(1 << 30))
    config = load(None, [*LATE, f"seed={seed}", f"sim.obstacles=[{', '.join(obstacles)}]"], {}).config
    while True:
        pose = (*rng.uniform(-2.0, 2.0, 2).tolist(), float(rng.uniform(-3.1, 3.1)))
        there = config.model_copy(update={"sim": config.sim.model_copy(update={"start": pose})})
        try:
            hal = create_hal(there)
        except ConfigError:
            continue
        if hal.world.in_the_way(hal.vehicle, *pose, 0.15) is None:  # type: ignore[attr-defined]
            return there


async def nearest_to_contact(config: Config, rng: Generator, duration: float = 5.0) -> tuple[float, float, int]:
    """The least distance to anything (m), the highest speed (m/s) and how often it was slowed, driving at random."""
    least, fastest = float("inf"), 0.0
    async with Robot.open(config=config) as robot:
        assert await robot.load_gains()
        vehicle = robot.hal.vehicle  # type: ignore[attr-defined]

        async def drive(ticks: Ticks) -> None:
            nonlocal least, fastest
            ends = 0.0
            async for now in ticks:
                if now >= ends:
                    v = float(rng.uniform(0.2, 1.5))
                    omega = float(rng.uniform(-1.0, 1.0)) * yaw_rate_max(v, config.geometry.radius_min)
                    ends = now + float(rng.uniform(0.5, 3.0))
                robot.command(v, omega)
                body = vehicle.outline(vehicle.pose)
                gaps = [gap(body, each) for each in config.sim.obstacles]
                least = min(least, *gaps, clearance(*vehicle.pose, vehicle.world.room, vehicle.body))
                fastest = max(fastest, vehicle.motion[3])

        robot.add_task("drive", 0.02, drive)
        robot.runtime.scheduler.end_at(robot.now + duration)
        await robot.runtime.scheduler.ended
        return least, fastest, robot.faults[Fault.OBSTACLE]


@pytest.mark.parametrize("worlds", [5, pytest.param(1000, marks=pytest.mark.long)])
async def test_no_contact_in_random_worlds(worlds: int) -> None:
    rng, fastest, slowed, contacts, least = default_rng(15), 0.0, 0, [], float("inf")
    for number in range(worlds):
        config = random_world(rng)
        nearest, speed, times = await nearest_to_contact(config, rng)
        if nearest <= 0.0:
            contacts.append((number, nearest))
        least, fastest, slowed = min(least, nearest), max(fastest, speed), slowed + (times > 0)
    print(f"{worlds} worlds: {len(contacts)} contacts, nearest {least:.3f} m, {fastest:.2f} m/s, slowed in {slowed}")
    assert contacts == []
    assert slowed > 0.5 * worlds
    assert fastest > 0.8


async def test_a_silent_laser_stops_the_vehicle_and_backwards_is_slow() -> None:
    settings = (*LATE, "sensors.laser.drop_out=1.0", "sim.room.length=20", "sim.room.width=20")
    async with Robot.open("sim", settings=settings) as robot:
        assert await robot.load_gains()
        await robot.drive(1.0, 0.0, 2.0)
        assert robot.pose is not None
        assert robot.pose[0] == pytest.approx(0.0, abs=1e-6)
        await robot.drive(-1.0, 0.0, 2.0)
        assert robot.runtime.state.control.v == pytest.approx(-0.3)


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
