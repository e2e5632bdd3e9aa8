"""Several robots in one world, in one process, on one event loop."""

from __future__ import annotations

import asyncio
import gc
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import may_block
from tests.patience import LIMIT, until
from txt1.config import load
from txt1.errors import ConfigError, NotArmed
from txt1.hal.registry import in_world
from txt1.kernel.loop import Speed, run
from txt1.record.session import recording
from txt1.record.verification import verify
from txt1.robot import Robot
from txt1.sim.obstacles import gap
from txt1.sim.parameters import Post
from txt1.sim.room import Room
from txt1.sim.vehicle import Vehicle
from txt1.sim.world import World

Pose = tuple[float, float, float]
LEFT, RIGHT, AWAY = (-0.6, 0.0, 0.0), (0.6, 0.0, 3.14159), (0.0, 3.0, 0.0)


def vehicle_of(robot: Robot) -> Vehicle:
    one: Vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
    return one


async def brought_up(stack: AsyncExitStack, world: World, starts: dict[str, Pose]) -> list[Robot]:
    """Robots with their gains loaded; all at once, so that the runs begin in the same instant."""
    robots = [
        await stack.enter_async_context(
            Robot.open("sim", world=world, name=name, seed=1, patience=0.0, settings=[f"sim.start={list(start)}"])
        )
        for name, start in starts.items()
    ]
    for robot in robots:
        await robot.linked(5.0)
        robot.arm()
    assert all(await asyncio.gather(*(robot.load_gains() for robot in robots)))
    return robots


async def drive(robot: Robot, seconds: float) -> str:
    """Drive ahead; return why the gate stopped it, or ""."""
    try:
        await robot.drive(0.5, 0.0, seconds)
    except NotArmed as error:
        return str(error)
    return ""


@pytest.mark.usefixtures("patient")
@pytest.mark.parametrize("speed", ["max", None])
def test_two_robots_collide_and_stop_in_virtual_and_in_real_time(speed: Speed) -> None:
    async def main() -> None:
        world = World(Room(6.0, 6.0))
        async with AsyncExitStack() as stack:
            one, two = await brought_up(stack, world, {"one": LEFT, "two": RIGHT})
            assert world.vehicles == [vehicle_of(one), vehicle_of(two)]
            async with asyncio.timeout(LIMIT):
                while gap(*(each.outline(each.pose) for each in world.vehicles)) > 0.04:
                    await asyncio.gather(drive(one, 0.1), drive(two, 0.1))
            stopped = await asyncio.gather(drive(one, 3.0), drive(two, 3.0))
            assert "another vehicle, two" in stopped[0] and "another vehicle, one" in stopped[1]
            await until(lambda: all(abs(each.state.v) < 0.1 for each in world.vehicles))
            assert 0.0 <= gap(*(each.outline(each.pose) for each in world.vehicles)) < 0.05
            (west, *_), (east, *_) = one.pose or LEFT, two.pose or RIGHT
            assert LEFT[0] < west < east - 0.4 < RIGHT[0] - 0.4, "both came nearer, and stand nose to nose"

    run(main(), speed=speed)


def log_of(starts: dict[str, Pose], who: str, until: float = 6.0, leave: str = "") -> list[tuple[object, ...]]:
    """All that one of several robots sensed in a drive, of which another may be closed on the way."""

    async def main() -> list[tuple[object, ...]]:
        seen: list[tuple[object, ...]] = []
        world = World(Room(8.0, 8.0))
        async with AsyncExitStack() as stack:
            robots = dict(zip(starts, await brought_up(stack, world, starts), strict=True))
            for name, robot in robots.items():
                if name == leave:
                    robot.runtime.gate.disarm("leaves")
                    await robot.runtime.stop()
            robot = robots[who]
            while robot.now < until:
                if robot.armed:
                    robot.command(0.4, 0.3)
                await asyncio.sleep(0.05)
                seen.append((robot.odometry, robot.pose, robot.battery, robot.armed, robot.runtime.gate.reason))
        return seen

    return run(main(), speed="max")


def test_a_seed_repeats_bit_for_bit_whatever_the_number_and_the_order_of_the_robots() -> None:
    alone = log_of({"one": LEFT}, "one")
    assert alone == log_of({"one": LEFT}, "one")
    assert alone == log_of({"one": LEFT, "two": AWAY}, "one")
    assert alone == log_of({"three": (2.5, -2.5, 0.0), "two": AWAY, "one": LEFT}, "one")
    assert alone != log_of({"other": LEFT}, "other"), "another name has other noise from the same seed"


def test_closing_one_robot_changes_nothing_for_the_other() -> None:
    starts = {"one": LEFT, "two": AWAY}
    assert log_of(starts, "one") == log_of(starts, "one", leave="two")


async def test_the_garbage_collector_is_as_before_when_the_last_robot_has_gone() -> None:
    before, world = gc.get_threshold(), World()
    async with Robot.open("sim", world=world, name="one"):
        async with Robot.open("sim", world=world, name="two", settings=["sim.start=[2, 0, 0]"]):
            seldom = gc.get_threshold()
        assert gc.get_threshold() == seldom != before
    assert gc.get_threshold() == before


async def test_a_start_where_another_robot_stands_is_refused() -> None:
    world = World(obstacles=(Post(0.0, 2.0, 0.1),))
    async with Robot.open("sim", world=world, name="one"):
        with pytest.raises(ConfigError, match=r"sim.start: .* sticks into another vehicle, one; choose another start"):
            async with Robot.open("sim", world=world, name="two"):
                pass
        with pytest.raises(ConfigError, match=r"sim.start: .* sticks into obstacle 0, a post at \(0, 2\)"):
            async with Robot.open("sim", world=world, settings=["sim.start=[0, 2, 0]"]):
                pass


async def test_a_robot_in_a_world_has_that_worlds_room_in_its_configuration() -> None:
    world = World(Room(7.0, 3.0), (1.0, 0.5), (Post(0.0, 1.0, 0.1),))
    async with Robot.open("sim", world=world) as robot:
        sim = robot.config.sim
        assert (sim.room.length, sim.room.width, sim.room.light) == (7.0, 3.0, (1.0, 0.5))
        assert sim.obstacles == (Post(0.0, 1.0, 0.1),)


async def test_a_world_is_for_simulated_robots() -> None:
    with pytest.raises(ConfigError, match="world: a robot with the HAL 'serial' is in none; choose hal=sim"):
        async with Robot.open("serial", world=World()):
            pass


async def test_obstacles_come_from_the_configuration() -> None:
    post = "sim.obstacles=[{kind: post, x: 1.0, y: 0.0, radius: 0.1}]"
    async with Robot.open("sim", settings=[post]) as robot:
        await robot.load_gains()
        await drive(robot, 3.0)
        assert (robot.pose or AWAY)[0] == pytest.approx(1.0 - 0.1 - 0.255, abs=0.03)


def test_each_recording_is_its_own_and_verifies(tmp_path: Path, blocking_calls_fail: BlockBuster) -> None:
    may_block(blocking_calls_fail, "txt1/record/verification.py", "_replay", "_replay_steps", "write", "close")
    may_block(blocking_calls_fail, "txt1/record/recorder.py", "_write", "_close_sinks")

    async def main() -> None:
        world = World(Room(8.0, 8.0))
        async with AsyncExitStack() as stack:
            for name, start in {"one": LEFT, "two": AWAY}.items():
                config = in_world(load(None, [f"name={name}", f"sim.start={list(start)}"]).config, world)
                attach = await stack.enter_async_context(recording(tmp_path / name, config, "max", {}, print))
                robot = await stack.enter_async_context(Robot.open(config=config, world=world, attach=attach))
                assert await robot.load_gains()
                await robot.drive(0.3, 0.3, 1.0)

    run(main(), speed="max")
    for name in ("one", "two"):
        verdict = verify(tmp_path / name)
        assert verdict.difference is None and verdict.compared > 100
