"""ROS as a source of commands among others: its priority and its time-out are configured."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest

from rigs.ros_ends import ROS_ENDS
from tests.e2e.conftest import ENDLESS
from txt1.bridges.registry import RobotEnd
from txt1.cli import execute
from txt1.config.sources import load
from txt1.driver import REFRESH
from txt1.errors import ConfigError
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot
from txt1.sidecar import Request

TICK = 0.02
nodes = pytest.mark.parametrize(("name", "desk"), ROS_ENDS.items())
Desk = Callable[[Robot], RobotEnd]


@asynccontextmanager
async def driven(desk: Desk, *settings: str) -> AsyncIterator[tuple[Robot, asyncio.Event]]:
    """A robot that a program of ROS drives at 0.4 m/s, ten times a second, until it is told to end."""
    async with Robot.open("sim", settings=[*ENDLESS, *settings]) as robot:
        end = desk(robot)
        ends = asyncio.Event()

        async def client(ticks: Ticks) -> None:
            async for _ in ticks:
                if not ends.is_set():
                    end.request(Request("drive", {"v": 0.4, "omega": 0.0}, 0.0))

        robot.add_task("client", 0.1, client)
        await asyncio.sleep(1.0)
        yield robot, ends


POWER = {"ros": ("power", {"switch": "atx", "on": False}), "ros1": ("switched_pwr", {"source": 0, "on": False})}


@nodes
async def test_ros_is_told_that_the_atx_supply_stays_on_while_the_robot_rolls(name: str, desk: Desk) -> None:
    service, fields = POWER[name]
    async with Robot.open("sim", settings=ENDLESS) as robot:
        end = desk(robot)
        await robot.load_gains()
        await robot.drive(1.0, 0.0, 1.0)
        robot.disarm()
        for number, patience in ((1, 2.5 * TICK), (2, 3.0)):
            end.request(Request("call", {"id": number, "name": service, "fields": fields}, 0.0))
            await asyncio.sleep(patience)
        refused, done = json.loads(end.telemetry() or b"{}")["answers"]
        assert refused[:2] == [1, False] and "until they have seen the robot stand" in refused[2]
        assert done == [2, False, refused[2]], "it rolled still"
        end.request(Request("call", {"id": 3, "name": service, "fields": fields}, 0.0))
        await asyncio.sleep(2.5 * TICK)
        assert json.loads(end.telemetry() or b"{}")["answers"] == [[3, True, ""]]


async def insist(robot: Robot, name: str) -> float:
    """Another source asks for -0.2 m/s, ten times a second; the set-point (m/s) after half a second of it."""
    source = robot.program if name == "program" else robot.source(name)

    async def other(ticks: Ticks) -> None:
        async for _ in ticks:
            source.command(-0.2, 0.0)

    robot.add_task(name, 0.1, other)
    await asyncio.sleep(0.5)
    return robot.runtime.state.control.v


@nodes
@pytest.mark.parametrize(
    ("priority", "other", "drives"),
    [(None, "keys", False), (None, "program", True), (60, "keys", True), (5, "program", False)],
)
async def test_ros_gives_way_to_a_higher_priority_and_keeps_the_wheel_from_a_lower(
    name: str, desk: Desk, priority: int | None, other: str, drives: bool
) -> None:
    async with driven(desk, *([] if priority is None else [f"commander.priorities.{name}={priority}"])) as (robot, _):
        assert robot.driver.name == name and robot.runtime.state.control.v == 0.4
        assert await insist(robot, other) == (0.4 if drives else -0.2)
        assert robot.driver.name == (name if drives else other)
        assert robot.driver.refused[other if drives else name] > 2, "who does not drive is refused and counted"


@nodes
@pytest.mark.parametrize(("timeout", "least", "most"), [(None, 0.25, 0.25 + TICK), (0.12, 0.12, 0.12 + REFRESH + TICK)])
async def test_the_robot_is_neutral_when_the_last_command_of_ros_is_as_old_as_its_time_out(
    name: str, desk: Desk, timeout: float | None, least: float, most: float
) -> None:
    """The safety gate sees to its own in each cycle; a shorter one shows when the set-point is sent again."""
    async with driven(desk, *([] if timeout is None else [f"commander.timeouts.{name}={timeout}"])) as (robot, ends):
        ends.set()
        last = robot.runtime.state.command.time
        while robot.runtime.state.control.v:
            await asyncio.sleep(0.25 * TICK)
        assert least <= robot.now - last <= most + 1e-6
        assert robot.driver.name == "" and robot.armed


@nodes
def test_a_time_out_longer_than_the_safety_gate_s_is_refused(
    name: str, desk: Desk, capsys: pytest.CaptureFixture[str]
) -> None:
    refusal = rf"timeouts\.{name}: 0\.3 s; use at most safety\.command_timeout, 0\.25 s"
    with pytest.raises(ConfigError, match=refusal):
        load(overrides=[f"commander.timeouts.{name}=0.3"])
    assert execute(["run", "--headless", "--set", f"commander.timeouts.{name}=0.3"]) == 2
    assert f"timeouts.{name}: 0.3 s; use at most safety.command_timeout" in capsys.readouterr().err
