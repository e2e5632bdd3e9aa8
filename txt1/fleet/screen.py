"""The screen FLEET: a line for each robot."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from rich.console import Console, Group, RenderableType
from rich.text import Text

from txt1.fleet.members import FLEET, FLEET_STOP, Member
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.text import BAD, GOOD, LABEL, Column, clean, duration, number, printable, styled, table
from txt1.ui.viewer import Viewer

# cells of the frame and beside it
FRAME_CELLS: Final = 4
# cells between two columns
COLUMN_GAP: Final = 2
# cells of a state, as long as there are columns to do without
STATE_LEAST: Final = 16
# these, in this order
DISPENSABLE: Final = ("clock", "driver", "heard")
_NUMBER: Final = Column(right=True)
COLUMNS: Final = (
    Column("robot", LABEL),
    Column("state"),
    *(_NUMBER._replace(heading=each) for each in ("x", "y", "v")),
    Column("driver"),
    _NUMBER._replace(heading="V"),
    _NUMBER._replace(heading="heard"),
    _NUMBER._replace(heading="clock"),
)


class RobotLine(NamedTuple):
    """A robot's cells by their columns' headings, and the style of its state."""

    cells: dict[str, str]
    style: str


ALONE: Final = (
    ("This robot is alone. Three simulated robots in one room:",),
    ("txt1 fleet --robots 3",),
    ("On a network: txt1 run --name a --fleet",),
)
"""Rows of FLEET without a fleet."""


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """FLEET for a body of width x rows cells; a narrow one does without some columns, and then cuts the states."""
    members, stop = snapshot.get(FLEET) or (), snapshot.get(FLEET_STOP)
    if stop:
        told = Text(f" stop of all: {printable(stop)}", "bold yellow")
        taken = min(rows - 4, len(told.wrap(Console(width=width), width)))
        return Group(_table(members, width, rows - taken), told)
    return _table(members, width, rows)


def _table(members: Sequence[Member], width: int, rows: int) -> RenderableType:
    if not members:
        return table("FLEET", (Column(fold=True),), ALONE)
    lines = tuple(map(_line, members[: max(1, rows - 3)]))
    columns = COLUMNS
    longest = max(len(line.cells["state"]) for line in lines)
    for heading in DISPENSABLE:
        if _left(columns, lines, width) >= min(longest, STATE_LEAST):
            break
        columns = tuple(column for column in columns if column.heading != heading)
    left = max(1, _left(columns, lines, width))
    told = tuple(tuple(_cell(line, column.heading, left) for column in columns) for line in lines)
    return table(f"FLEET of {len(members)}", columns, told, gap=COLUMN_GAP)


def _left(columns: Sequence[Column], lines: Sequence[RobotLine], width: int) -> int:
    """Cells that the other columns leave to the states."""
    others = [column.heading for column in columns if column.heading != "state"]
    taken = (max(len(heading), *(len(line.cells[heading]) for line in lines)) for heading in others)
    return width - FRAME_CELLS - COLUMN_GAP * len(others) - sum(taken)


def _cell(line: RobotLine, heading: str, left: int) -> str:
    text = line.cells[heading]
    if heading != "state":
        return clean(text)
    return styled(clean(text if len(text) <= left else f"{text[: left - 1]}…"), line.style)


def _line(one: Member) -> RobotLine:
    if not one.alive:
        state, style = "gone", BAD
    elif one.silent:
        state, style = f"waits for {one.silent}", "yellow"
    elif one.armed and one.stuck:
        state, style = f"stuck: {one.stuck}", BAD
    else:
        state, style = ("armed", GOOD) if one.armed else (one.reason or "disarmed", "red")
    x, y, _ = one.pose or (None, None, None)
    cells = {
        "robot": one.name,
        "state": state,
        "x": number(x, 2),
        "y": number(y, 2),
        "v": number(one.v, 2),
        "driver": one.driver,
        "V": number(one.battery, 2),
        "heard": "" if one.age is None else f"{duration(one.age)} ago",
        "clock": "" if one.offset is None else duration(abs(one.offset)),
    }
    return RobotLine(cells, style)
