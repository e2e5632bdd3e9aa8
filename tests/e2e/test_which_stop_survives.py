"""Which stop survives what: the table in docs/safety.md names tests that exist; some of them are here."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from benchmarks.board_faults import BOARDS, FAULTS, stop_despite

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("fault", ["encoders dead", "battery sagging"])
@pytest.mark.parametrize("board", BOARDS)
async def test_a_stop_at_the_gate_stands_the_car(board: str, fault: str) -> None:
    assert (await stop_despite(board, "stop at the gate", fault)).seconds < 4.0


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("board", BOARDS)
async def test_the_board_s_own_time_out_stands_the_car(board: str, fault: str) -> None:
    assert (await stop_despite(board, "board's time-out", fault)).seconds < 6.0


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("board", BOARDS)
async def test_a_car_whose_plug_is_pulled_stands(board: str, fault: str) -> None:
    assert (await stop_despite(board, "plug pulled", fault)).seconds < 2.5


async def test_a_stop_of_a_host_that_hangs_is_the_board_s() -> None:
    course = await stop_despite("original", "stop at the gate", "host hung")
    assert 0.5 < course.seconds < 4.0, "it drives on until its time-out"


# -- the table ----------------------------------------------------------------------------------------------------


def cells() -> list[str]:
    """The cells of the table, without its first row and column."""
    page = (ROOT / "docs" / "safety.md").read_text()
    table = page.split("## Which stop survives what", 1)[1].split("\n\n## ")[0]
    lines = table[table.index("\n|") + 1 :].split("\n\n")[0].splitlines()
    return [cell.strip() for row in lines[2:] for cell in row.strip("|").split("|")[1:]]


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
    assert len(cells()) == 8 * 7
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
