"""Which stop survives what: the table in docs/safety.md names tests that exist; some of them are here."""

from __future__ import annotations

import ast
import asyncio
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.e2e.conftest import ENDLESS
from txt1.board.board import Board, BoardEvent
from txt1.errors import StopNotVerified
from txt1.robot import Robot

ROOT = Path(__file__).parents[2]
WIRE = ("serial.port=virtual", *ENDLESS)
BOARDS = {"ours": WIRE, "original": (*WIRE, "board.habits=original", "sim.vehicle.grip=2")}


def silence(robot: Robot) -> None:
    """Let nothing go to the board any more, as a host that hangs, is killed, or has a cut line."""
    hal: Any = robot.hal
    hal.line.send = lambda data: None


def dead_encoders(robot: Robot, board: Board) -> None:
    board.happen(BoardEvent("encoders", 0.0))


def sagging(robot: Robot, board: Board) -> None:
    board.happen(BoardEvent("battery", 8.0))


def hung_host(robot: Robot, board: Board) -> None:
    silence(robot)


FAULTS: dict[str, Callable[[Robot, Board], None]] = {
    "encoders dead": dead_encoders,
    "battery sagging": sagging,
    "host hung": hung_host,
}


@asynccontextmanager
async def driving(board: str) -> AsyncIterator[tuple[Robot, Board]]:
    """A robot at 0.6 m/s."""
    with suppress(StopNotVerified):
        async with Robot.open("serial", settings=BOARDS[board], seed=1, arm=True) as robot:
            await robot.load_gains()
            await robot.drive(0.6, 0.0, 2.0)
            robot.command(0.6, 0.0)
            yield robot, robot.hal.port.board  # type: ignore[attr-defined]


async def stands(board: Board, within: float) -> bool:
    """Whether the true car stands then."""
    await asyncio.sleep(within)
    board.vehicle.advance_to(board.now)
    return abs(board.vehicle.motion[3]) < 0.05


@pytest.mark.parametrize("fault", ["encoders dead", "battery sagging"])
@pytest.mark.parametrize("board", BOARDS)
async def test_a_stop_at_the_gate_stands_the_car(board: str, fault: str) -> None:
    async with driving(board) as (robot, at):
        FAULTS[fault](robot, at)
        robot.stop()
        assert await stands(at, 4.0)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("board", BOARDS)
async def test_the_board_s_own_time_out_stands_the_car(board: str, fault: str) -> None:
    async with driving(board) as (robot, at):
        FAULTS[fault](robot, at)
        silence(robot)
        assert await stands(at, 6.0)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("board", BOARDS)
async def test_a_car_whose_plug_is_pulled_stands(board: str, fault: str) -> None:
    async with driving(board) as (robot, at):
        FAULTS[fault](robot, at)
        at.vehicle.esc_on = at.vehicle.atx_on = False
        assert await stands(at, 2.5)


async def test_a_stop_of_a_host_that_hangs_is_the_board_s() -> None:
    async with driving("original") as (robot, at):
        silence(robot)
        robot.stop()
        assert not await stands(at, 0.5), "it drives on"
        assert await stands(at, 3.5), "until its time-out"


# -- the table ----------------------------------------------------------------------------------------------------


def cells() -> list[str]:
    """The cells of the table, without its first row and column."""
    page = (ROOT / "docs" / "safety.md").read_text()
    table = page.split("## Which stop survives what", 1)[1].split("\n\n## ")[0]
    rows = [line for line in table.splitlines() if line.startswith("|")][2:]
    return [cell.strip() for row in rows for cell in row.strip("|").split("|")[1:]]


def names_in(file: Path) -> set[str]:
    """The functions of a file."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    return {node.name for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, functions)}


def notes() -> dict[str, str]:
    """The tests that the notes below the table name, by their letters."""
    page = (ROOT / "docs" / "safety.md").read_text()
    found = re.findall(r"^- \*\*([a-z])\*\* `([^`]+)`", page, re.MULTILINE)
    assert len(dict(found)) == len(found)
    return dict(found)


def test_each_cell_of_the_table_names_a_test_or_says_drives_on() -> None:
    named, used = notes(), set()
    assert len(cells()) == 7 * 7
    for cell in cells():
        letters = re.findall(r"\*\*([a-z])\*\*", cell)
        assert letters or "drives on" in cell or cell == "–", cell
        assert set(letters) <= named.keys(), cell
        used |= set(letters)
    assert used == named.keys()


def test_each_test_that_the_table_names_is_there() -> None:
    for name in notes().values():
        file, _, test = name.partition("::")
        assert test in names_in(ROOT / file), name
