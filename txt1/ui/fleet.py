"""The screen FLEET: a line for each robot."""

from typing import Final

from rich.console import RenderableType

from txt1.fleet.members import FLEET, Member
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.text import BAD, DIM, GOOD, LABEL, Column, clean, duration, number, styled, table
from txt1.ui.viewer import Viewer

STATE_MAX: Final = 30  # cells of a state: the numbers beside it are to stay readable
_NUMBER: Final = Column(right=True)
COLUMNS: Final = (
    Column("robot", LABEL), Column("state", least=8), *(_NUMBER._replace(heading=each) for each in ("x", "y", "v")),
    Column("driver"), _NUMBER._replace(heading="V"), _NUMBER._replace(heading="heard"),
    _NUMBER._replace(heading="clock"),
)  # fmt: skip


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """FLEET for a body of width x rows cells."""
    members = snapshot.get(FLEET) or ()
    if not members:
        return table("FLEET", (Column(),), ((styled("this robot is alone", DIM),),))
    return table(f"FLEET of {len(members)}", COLUMNS, tuple(map(_cells, members[: max(1, rows - 3)])))


def _cells(one: Member) -> tuple[str, ...]:
    if not one.alive:
        state = styled("gone", BAD)
    elif one.silent:
        state = styled(clean(f"waits for {one.silent}"[:STATE_MAX]), "yellow")
    else:
        state = styled("armed", GOOD) if one.armed else styled(clean(one.reason[:STATE_MAX]) or "disarmed", "red")
    x, y, _ = one.pose or (None, None, None)
    heard = "" if one.age is None else f"{duration(one.age)} ago"
    clock = "" if one.offset is None else duration(abs(one.offset))
    return (
        clean(one.name), state, number(x, 2), number(y, 2), number(one.v, 2), clean(one.driver),
        number(one.battery, 2), heard, clock,
    )  # fmt: skip
