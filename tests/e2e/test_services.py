"""What bridges ask for beyond driving: a route that goes on only while it is held, gains, and recordings."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from math import inf, isfinite, nan
from pathlib import Path

import pytest

from txt1.bridges.services import RECORDING, ROUTE, Services
from txt1.errors import CommandRefused, ConfigError, NotArmed, RecordingError
from txt1.protocol.messages import PidSet
from txt1.record.reader import FilePass
from txt1.record.verification import verify
from txt1.robot import Robot
from txt1.ros.robot_end import Ros2RobotEnd

TICK = 0.02


@pytest.fixture
async def services(robot: Robot, tmp_path: Path) -> AsyncIterator[Services]:
    services = Services(robot, robot.config, "max", tmp_path)
    yield services
    await services.close()


def speed(robot: Robot) -> float:
    return robot.runtime.state.control.v


async def test_a_route_is_driven_to_its_end_while_it_is_held(
    robot: Robot, services: Services, every_tick: Callable[[Callable[[], None]], None]
) -> None:
    every_tick(lambda: services.requests["hold"](0.0))  # type: ignore[arg-type,return-value]
    services.requests["go"]([[1.5, 0.0], [2.5, 0.5]], 0.5)
    await asyncio.sleep(1.0)
    assert robot.driver.name == "route" and speed(robot) > 0.3
    assert robot.runtime.bus.read(ROUTE) == ((1.5, 0.0), (2.5, 0.5))
    await asyncio.sleep(10.0)
    assert speed(robot) == 0.0 and robot.runtime.bus.read(ROUTE) == ()
    assert robot.pose is not None and robot.pose[0] > 2.0
    assert "the route has been driven" in [event.text for event in robot.runtime.state.events]


async def test_a_route_that_nobody_holds_ends_when_a_command_would_be_stale(robot: Robot, services: Services) -> None:
    services.requests["go"]([[5.0, 0.0]], 0.5)
    for _ in range(20):
        services.requests["hold"](0.05)
        await asyncio.sleep(0.05)
    assert speed(robot) > 0.3
    last = robot.now - 0.05 - 0.05
    while speed(robot) > 0.0:
        await asyncio.sleep(0.001)
    assert robot.now - last <= 0.25 + 2 * TICK + 0.002
    await asyncio.sleep(1.0)
    services.requests["hold"](0.0)
    await asyncio.sleep(0.5)
    assert speed(robot) == 0.0, "it does not go on by itself"


async def test_halt_ends_it_at_once_and_whoever_outranks_it_does_too(robot: Robot, services: Services) -> None:
    keys = robot.source("keys")
    for end in (services.requests["halt"], lambda: keys.command(-0.2, 0.0), robot.stop):
        robot.arm()
        services.requests["go"]([[9.0, 0.0]], 0.5)
        for _ in range(10):
            services.requests["hold"](0.0)
            await asyncio.sleep(0.05)
        assert robot.driver.name == "route"
        end()
        await asyncio.sleep(2 * TICK)
        assert speed(robot) <= 0.0
        keys.release()
        await asyncio.sleep(0.5)
        assert speed(robot) == 0.0 and robot.driver.name == ""


async def test_what_is_no_route_is_refused(robot: Robot, services: Services) -> None:
    for points in ([1.0], [["a", 2]], [[1.0]], [[1, 2, 3]], None):
        with pytest.raises(CommandRefused):
            services.requests["go"](points, 0.5)
    with pytest.raises(CommandRefused):
        services.requests["hold"]("long")
    robot.disarm()
    with pytest.raises(NotArmed):
        services.requests["go"]([[1.0, 0.0]], 0.5)


async def test_gains_are_loaded_and_wrong_ones_refused(robot: Robot, services: Services) -> None:
    services.requests["gains"]([1.0, 2.0, 0.3], [[1.5, 4.0, 5.0, 0.6]])
    await asyncio.sleep(0.5)
    assert robot.runtime.state.gains.linear == (1.0, 2.0, 0.3)
    for linear, angular in (([1.0], []), ("abc", []), ([1, 2, 3], [[1.5]]), ([1, 2, 3], [[2, 1, 1, 1], [1, 1, 1, 1]])):
        with pytest.raises(CommandRefused):
            services.requests["gains"](linear, angular)


@pytest.mark.parametrize("bad", [-5.0, -1e-3, 99999.0, inf, nan], ids=str)
@pytest.mark.parametrize("way", ["program", "page", "message", "ros"])
async def test_no_way_loads_what_is_no_gain(robot: Robot, services: Services, way: str, bad: float) -> None:
    before, count = robot.runtime.state.gains, len(robot.runtime.state.events)
    linear, sets = before.linear._replace(kp=bad), before.angular.sets
    if way == "message":
        robot.runtime.post(PidSet(linear, tuple((v_max, *gains) for v_max, gains in sets)), robot.now)
    elif way == "program":
        with pytest.raises(CommandRefused, match="kp"):
            await robot.load_gains(linear)
    elif way == "page":
        with suppress(CommandRefused):  # at once where it is no number, else it is told
            services.requests["gains"](linear, [(v_max, *gains) for v_max, gains in sets])
    else:
        with pytest.raises(ConfigError, match="kp"):
            await Ros2RobotEnd(robot)._set({"control.linear.kp": bad})  # noqa: SLF001
    await asyncio.sleep(0.1)
    assert robot.runtime.state.gains == before
    if way in ("message", "page") and isfinite(bad):
        assert any(
            "linear.kp" in str(event) and "give 0 to" in str(event) for event in [*robot.runtime.state.events][count:]
        )


async def test_a_recording_is_begun_and_completed_on_the_way(robot: Robot, services: Services, tmp_path: Path) -> None:
    robot.command(0.3, 0.0)
    await asyncio.sleep(1.0 - robot.now)
    services.requests["record"](True)
    await asyncio.sleep(2.0)
    name = robot.runtime.bus.read(RECORDING)
    assert name and (tmp_path / name).exists()
    services.requests["record"](False)
    await asyncio.sleep(1.0)
    assert robot.runtime.bus.read(RECORDING) == ""
    reading = await asyncio.to_thread(lambda: FilePass(tmp_path / name))
    topics = await asyncio.to_thread(lambda: {item.topic for item in reading})
    assert {"/odom", "/setpoint", "/snapshot"} <= topics and reading.complete
    with pytest.raises(RecordingError, match=r"it begins 1\.0 s into its run, .*'txt1 run --log FILE'"):
        await asyncio.to_thread(verify, tmp_path / name)
