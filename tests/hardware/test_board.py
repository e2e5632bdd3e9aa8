"""A real board keeps to the protocol, and does as it is told."""

import asyncio
from itertools import pairwise
from statistics import median

import pytest

from tests.patience import S
from txt1.errors import CommandRefused, NotArmed
from txt1.robot import Robot


async def test_it_is_heard_and_the_line_is_clean(robot: Robot) -> None:
    await asyncio.sleep(5.0)
    damaged = {name: count for name, count in robot.faults.items() if name.startswith("line_") and count}
    damaged.pop("line_old_command", None)  # original boards send one
    damaged.pop("line_late_odometry", None)  # says as much about this computer as about the line
    assert damaged == {}
    assert robot.faults["reconnects"] == 0


async def test_its_odometry_comes_20_times_a_second(robot: Robot) -> None:
    stream = robot.odometry_stream()
    times = []
    for _ in range(100):
        await asyncio.wait_for(anext(stream), S)
        times.append(robot.now)
    assert median(later - earlier for earlier, later in pairwise(times)) == pytest.approx(0.05, abs=0.005)


async def test_it_acknowledges_the_gains(robot: Robot) -> None:
    assert await robot.load_gains(timeout=5.0 * S)


async def test_it_does_not_move_before_it_is_armed(robot: Robot) -> None:
    before = robot.odometry
    robot.command(0.3, 0.0)
    await asyncio.sleep(1.0)
    assert (robot.odometry.x, robot.odometry.y, robot.odometry.v) == (before.x, before.y, 0.0)
    with pytest.raises((NotArmed, CommandRefused)):
        await robot.drive(0.3, 0.0, 0.5)


@pytest.mark.usefixtures("wheels_up")
@pytest.mark.parametrize("v", [0.3, -0.3])
async def test_it_drives_at_the_speed_that_is_asked_for_and_stops(robot: Robot, v: float) -> None:
    assert await robot.load_gains(timeout=5.0 * S)
    robot.arm()
    speeds = []

    async def listen() -> None:
        async for message in robot.odometry_stream():
            speeds.append(message.v)

    listener = asyncio.create_task(listen())
    try:
        await robot.drive(v, 0.0, 3.0)
    finally:
        robot.disarm()
        listener.cancel()
    assert median(speeds[-20:]) == pytest.approx(v, abs=0.1)
    await asyncio.sleep(1.5)
    assert robot.odometry.v == pytest.approx(0.0, abs=0.02)


@pytest.mark.usefixtures("wheels_up")
async def test_an_emergency_stop_stops_it_within_a_second(robot: Robot) -> None:
    assert await robot.load_gains(timeout=5.0 * S)
    robot.arm()
    await robot.drive(0.5, 0.0, 2.0)
    robot.stop()
    await asyncio.sleep(1.0)
    assert robot.odometry.v == pytest.approx(0.0, abs=0.02)
    with pytest.raises(NotArmed):
        await robot.drive(0.3, 0.0, 0.5)
