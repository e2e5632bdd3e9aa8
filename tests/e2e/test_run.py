"""A session gets its robot ready, unless somebody is in the way."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import may_block
from txt1.cli import execute
from txt1.cli.operated_robot import RunStart
from txt1.robot import Robot

ROOT = Path(__file__).parents[2]
Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def a_status_line_is_written_only_where_it_fits(blocking_calls_fail: BlockBuster) -> None:
    may_block(blocking_calls_fail, "txt1/kit/app.py", "_put")


VIRTUAL = ("serial.port=virtual",)


@pytest.mark.parametrize("intervene", [Robot.stop, Robot.disarm], ids=["stop", "disarm"])
@pytest.mark.parametrize("hal, settings", [("sim", ()), ("serial", VIRTUAL)])
async def test_what_was_stopped_before_the_link_came_up_is_not_armed_by_the_start(
    hal: str, settings: tuple[str, ...], intervene: Callable[[Robot], None]
) -> None:
    async with Robot.open(hal, settings=settings, arm=False, patience=0.0) as robot:
        ready = asyncio.ensure_future(RunStart(robot, arm=True, drive=(0.5, 0.0)).get_ready())
        await asyncio.sleep(0.5)
        intervene(robot)
        await asyncio.sleep(5.0)
        assert ready.done() and robot.runtime.linked
        assert not robot.armed
        assert robot.odometry.x == 0.0


async def test_a_session_arms_when_nobody_is_in_the_way() -> None:
    async with Robot.open("serial", settings=VIRTUAL, arm=False, patience=0.0) as robot:
        await RunStart(robot, arm=True).get_ready()
        assert robot.armed


def test_a_robot_that_was_to_be_armed_and_never_was_is_no_success(capsys: Capture) -> None:
    words = ["run", "--port", "virtual", "--arm", "--json", "--speed", "max", "--duration"]
    assert execute([*words, "1.5"]) == 3
    assert "never armed: " in capsys.readouterr().err
    assert execute([*words, "6"]) == 0


def test_a_port_means_the_serial_hal_and_contradicts_any_other(capsys: Capture) -> None:
    assert execute(["run", "--hal", "sim", "--port", "/dev/ttyUSB7", "--json", "--duration", "1"]) == 2
    assert "/dev/ttyUSB7" in capsys.readouterr().err
    assert execute(["run", "--port", "/dev/ttyUSB77", "--json", "--duration", "1"]) == 1
    assert "/dev/ttyUSB77 does not exist" in capsys.readouterr().err


def test_a_status_line_tells_what_the_link_is_waiting_for(capfd: pytest.CaptureFixture[str]) -> None:
    assert execute(["run", "--port", "virtual", "--headless", "--speed", "max", "--duration", "0.5", "--no-arm"]) == 1
    assert "waiting for odometry" in capfd.readouterr().out


def test_real_time_and_virtual_time_exclude_each_other(capsys: Capture) -> None:
    assert execute(["run", "--realtime", "--speed", "max", "--json", "--duration", "1"]) == 2
    assert "--realtime: in virtual time (--speed) nothing is late" in capsys.readouterr().err


@pytest.mark.parametrize("words", ["nope", "pusher:distance", "pusher:=1"])
def test_a_bridge_that_is_not_there_or_an_option_without_a_value_is_a_mistake(words: str, capsys: Capture) -> None:
    assert execute(["run", "--json", "--duration", "1", "--bridge", words]) == 2
    assert words.split(":")[-1] in capsys.readouterr().err


def test_a_drive_beyond_the_car_is_told_with_the_nearest_that_it_can(capsys: pytest.CaptureFixture[str]) -> None:
    run = ["run", "--headless", "--duration", "1", "--speed", "max", "--drive"]
    assert execute([*run, "0,1"]) == 0
    assert "--drive 0,1: it will be 0,0, as this car turns with a radius of at least 0.56 m" in capsys.readouterr().err
    assert execute([*run, "0.5,0.3"]) == 0
    assert "--drive" not in capsys.readouterr().err
    assert execute([*run, "0,1", "--vehicle", "rover"]) == 0
    assert "--drive" not in capsys.readouterr().err


def test_what_the_first_steps_told_is_printed_too(capfd: pytest.CaptureFixture[str]) -> None:
    """A sensor may be in trouble from the start; a car without encoders tells it in its first step."""
    words = ["run", "--hal", "pi", "--vehicle", "donkeycar", "--set", "hal_options.bus=virtual"]
    execute([*words, "--headless", "--duration", "0.3"])
    assert "no encoders: odometry is dead reckoning" in capfd.readouterr().out
