"""The PID GAINS screen: linear gains, and the scrolling table of angular ones."""

from __future__ import annotations

from bisect import bisect_left

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from txt1.hal.base import Capabilities
from txt1.model.odometry import Odometry
from txt1.tasks.controller import SETPOINT
from txt1.tasks.encoder import ODOMETRY
from txt1.tasks.fields import CAPABILITIES, GAIN_TABLE, GainTable
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.status import gain_cells
from txt1.ui.text import DASH, DIM, GOOD, LABEL, WARNING, number
from txt1.ui.viewer import Viewer

FIXED_ROWS = 7
"""Rows of the screen that are not sets: the linear gains, the table's border and heading."""

WIDE = 70
"""Columns from which the table is spaced generously."""

MARK = "►"


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """PID GAINS for a body of width x rows cells."""
    gains = snapshot.get(GAIN_TABLE, GainTable())
    linear = _table("", width)
    linear.add_row("", "linear", *gain_cells(gains.linear if gains.loaded else None))
    loaded = Text("loaded", style=GOOD) if gains.loaded else Text("not loaded", style=WARNING)
    sets = gains.angular.sets
    shown = visible(len(sets), max(1, rows - FIXED_ROWS), snapshot.get(MODE, Mode()).panel.scroll)
    current = in_force(snapshot)
    angular = _table("v_max (m/s)", width)
    for index in shown:
        marked = index == current
        cells = (number(sets[index].v_max, 2), *gain_cells(sets[index].gains))
        angular.add_row(MARK if marked else "", *cells, style="bold bright_green" if marked else "")
    if not sets:
        angular.add_row("", Text("no sets"))
    known = f"{MARK} in force" if current is not None else f"in force: {DASH}"
    title = f"angular: sets {shown.start + 1} to {shown.stop} of {len(sets)}, {known}" if sets else "angular"
    return Group(
        Panel(linear, title=Text("linear: ").append_text(loaded), border_style=DIM),
        Panel(angular, title=title, border_style=DIM),
    )


def visible(sets: int, rows: int, scroll: int) -> range:
    """Which of the sets to show: from `scroll` on, but never fewer than fit."""
    first = max(0, min(scroll, sets - rows))
    return range(first, min(sets, first + rows))


def in_force(snapshot: Snapshot) -> int | None:
    """The number of the angular set the loop uses; None where the loop runs on a board or uses none of them.

    Several sets may have the same gains, so the measured speed picks first.
    """
    gains, control = snapshot.get(GAIN_TABLE, GainTable()), snapshot.get(SETPOINT)
    sets = gains.angular.sets
    if control is None or not snapshot.get(CAPABILITIES, Capabilities()).pwm or not gains.loaded or not sets:
        return None
    expected = min(bisect_left([s.v_max for s in sets], snapshot.get(ODOMETRY, Odometry()).v), len(sets) - 1)
    equal = [index for index, s in enumerate(sets) if s.gains == control.gains]
    return min(equal, key=lambda index: abs(index - expected), default=None)


def _table(first: str, width: int) -> Table:
    """Columns for the mark, v_max, Kp, Ki and Kd; closer together in a narrow window."""
    wide = width >= WIDE
    table = Table(box=None, padding=(0, 2 if wide else 1), pad_edge=False, header_style=LABEL)
    table.add_column("", width=1)
    for name in (first, "Kp", "Ki", "Kd"):
        table.add_column(name, justify="right", no_wrap=True, min_width=11 if wide else 8)
    return table
