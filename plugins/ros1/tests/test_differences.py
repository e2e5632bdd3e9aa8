"""What differs from the original's node, item by item of the page's list, on a board with the original's habits."""

import asyncio
import json
import re
from collections.abc import Awaitable, Callable
from math import nan
from pathlib import Path
from typing import Any

import pytest

from benchmarks.board_faults import BOARDS
from txt1 import Robot, run
from txt1.board.board import BoardEvent
from txt1.errors import StopNotVerified
from txt1.sidecar import Request
from txt1_ros1.robot_end import Ros1Desk

PAGE = Path(__file__).parents[1] / "README.md"
ATX, ESC = 0, 1


class Program:
    """A program of ROS that drives the robot and calls the node's services."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.end, self._calls = robot, Ros1Desk(robot), 0

    async def drive(self, v: float, omega: float = 0.0, duration: float = 1.0) -> None:
        for _ in range(round(duration / 0.1)):
            self.end.request(Request("drive", {"v": v, "omega": omega}, 0.0))
            await asyncio.sleep(0.1)

    async def call(self, name: str, **fields: Any) -> bool:
        self._calls += 1
        self.end.request(Request("call", {"id": self._calls, "name": name, "fields": fields}, 0.0))
        while True:
            await asyncio.sleep(0.02)
            for number, done, _ in json.loads(self.end.telemetry() or b"{}").get("answers", ()):
                if number == self._calls:
                    return bool(done)

    @property
    def moves(self) -> bool:
        return self.robot.odometry.v > 0.1


async def arming(program: Program) -> None:
    await program.drive(0.4, duration=2.0)
    assert not program.moves
    assert await program.call("arm")
    await program.drive(0.4, duration=2.0)
    assert program.moves


async def stops_stay(program: Program) -> None:
    for stop in ("stop", "disarm"):
        assert await program.call("arm")
        await program.drive(0.4, duration=2.0)
        assert program.moves
        await program.call(stop)
        await program.drive(0.4, duration=3.0)
        assert not program.moves


async def age_of_commands(program: Program) -> None:
    await program.call("arm")
    await program.drive(0.4, duration=0.1)
    for _ in range(2):
        await asyncio.sleep(0.1)
    assert program.robot.runtime.state.command.v == 0.0  # type: ignore[union-attr]


async def set_points(program: Program) -> None:
    await program.call("arm")
    await program.drive(3.0)
    assert program.robot.runtime.state.control.v == program.robot.config.safety.v_max == 1.5
    await program.drive(0.28, 3.0)
    assert program.robot.runtime.state.control.omega == pytest.approx(0.5)
    await program.drive(nan, 0.0)
    assert program.robot.faults["command_not_finite"] > 0


async def priority(program: Program) -> None:
    await program.call("arm")
    keys = program.robot.source("keys")
    for _ in range(15):
        keys.hold(-0.3, 0.0)
        await program.drive(0.4, duration=0.1)
    assert program.robot.odometry.v < -0.1
    keys.release()
    await program.drive(0.4, duration=2.0)
    assert not program.moves
    await program.drive(0.0, duration=0.1)
    await program.drive(0.4, duration=3.0)
    assert program.moves


async def pwm_by_hand(program: Program) -> None:
    await program.call("arm")
    asked = {"esc": 3000, "front": 0, "rear": 0, "pwm4": 0, "pwm5": 0}
    assert not await program.call("pwm_change", **asked)
    assert not await program.call("manual", manual=True), "without serial.allow_host"


async def power(program: Program) -> None:
    await program.call("arm")
    await program.drive(0.4, duration=2.0)
    assert not await program.call("switched_pwr", source=ATX, on=False)
    assert not await program.call("switched_pwr", source=ESC, on=True)
    await program.call("disarm")
    assert not await program.call("switched_pwr", source=ATX, on=False), "it still rolls"
    await asyncio.sleep(3.0)
    assert await program.call("switched_pwr", source=ESC, on=True)
    assert await program.call("switched_pwr", source=ATX, on=False)


async def gains(program: Program) -> None:
    angular = [1.5, 4.0, 130.0, 0.005]
    assert await program.call("pid_load", linear=[11.0, 18.0, 0.25], angular=angular)
    assert not await program.call("pid_load", linear=[-11.0, 18.0, 0.25], angular=angular)
    board: Any = program.robot.hal.port.board  # type: ignore[attr-defined]
    began = program.robot.now
    await board.power_down()
    assert not await program.call("pid_load", linear=[11.0, 18.0, 0.25], angular=angular)
    assert program.robot.now - began < 6.0


async def shutdown(program: Program) -> None:
    assert not await program.call("shutdown_computer")


CHECKS: dict[str, Callable[[Program], Awaitable[None]]] = {
    "Arming": arming,
    "Stops stay": stops_stay,
    "Age of commands": age_of_commands,
    "Set-points": set_points,
    "Priority": priority,
    "PWM by hand": pwm_by_hand,
    "Power": power,
    "Gains": gains,
    "Shutdown": shutdown,
}


def test_the_page_s_list_is_whole() -> None:
    assert re.findall(r"^- \*\*(.+?)\.\*\*", PAGE.read_text("utf-8"), re.M) == list(CHECKS)


async def after(event: BoardEvent, undone: BoardEvent | None, program: Program) -> None:
    """Let something happen to the board while it drives, and undo it: a stop that nobody asked for."""
    board: Any = program.robot.hal.port.board  # type: ignore[attr-defined]
    assert await program.call("arm")
    await program.drive(0.4, duration=2.0)
    assert program.moves
    board.happen(event)
    await program.drive(0.4, duration=3.0)
    if undone is not None:
        board.happen(undone)
    await program.drive(0.4, duration=5.0)
    assert not program.moves and not program.robot.armed


async def wall(program: Program) -> None:
    """Drive against a wall, and back from it."""
    assert await program.call("arm")
    await program.drive(0.4, duration=15.0)
    await program.drive(-0.4, duration=3.0)
    assert not program.moves and not program.robot.armed and "a wall" in program.robot.reason


STOPS: dict[str, tuple[BoardEvent, BoardEvent | None]] = {
    "a runaway": (BoardEvent("encoders", 0.0), BoardEvent("encoders", 1.0)),
    "a lost link": (BoardEvent("restart", 2.0), None),
}


def test_a_wall_is_a_stop_that_stays() -> None:
    drive(wall, "sim.room.length=6", "sim.room.width=6")


@pytest.mark.parametrize("what", STOPS)
def test_a_stop_that_nobody_asked_for_stays_as_the_page_says(what: str) -> None:
    assert what in PAGE.read_text("utf-8").replace("\n", " ")
    drive(lambda program: after(*STOPS[what], program))


@pytest.mark.parametrize("what", CHECKS)
def test_it_differs_from_the_original_as_the_page_says(what: str) -> None:
    drive(CHECKS[what])


def drive(check: Callable[[Program], Awaitable[None]], *room: str) -> None:
    """Check a program on a board with the habits of the originals, by default in an endless room."""

    async def main() -> None:
        try:
            async with Robot.open("serial", settings=(*BOARDS["original"], *room), seed=1, arm=False) as robot:
                await robot.load_gains()
                await check(Program(robot))
        except StopNotVerified as error:
            # a check that failed
            if error.__cause__ is not None:
                raise error.__cause__ from None

    run(main(), speed="max")
