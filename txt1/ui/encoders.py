"""The ENCODERS screen: ticks, velocities and pose."""

from __future__ import annotations

from math import degrees
from typing import Final

from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from txt1.model.odometry import Odometry
from txt1.tasks.encoder import ENCODERS, ODOMETRY, POSE
from txt1.tasks.fields import Encoders
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.map import framed
from txt1.ui.text import DASH, DIM, LABEL, centred_bar, number
from txt1.ui.viewer import Viewer

V_MAX: Final = 1.5
"""m/s, full scale of the bar: what the controller accepts."""

OMEGA_MAX: Final = V_MAX / 0.56
"""rad/s, full scale of the bar: the tightest bend at full speed, (2.16)."""

WIDE: Final = 130
"""Columns from which the path is drawn beside the numbers."""


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """ENCODERS for a body of width x rows cells."""
    if width < WIDE:
        return _numbers(snapshot, width, rows)
    left = width // 2
    layout = Layout()
    layout.split_row(
        Layout(_numbers(snapshot, left, rows), size=left),
        Layout(framed(snapshot, viewer, width - left, rows)),
    )
    return layout


def _numbers(snapshot: Snapshot, width: int, rows: int) -> RenderableType:
    """Ticks, velocities and poses in two panels."""
    odometry, ticks = snapshot.get(ODOMETRY, Odometry()), snapshot.get(ENCODERS, Encoders())
    length = max(11, width - 34)
    motion = _grid()
    motion.add_row("ticks right", _count(ticks.right), "per period")
    motion.add_row("ticks left", _count(ticks.left), "per period")
    motion.add_row()
    motion.add_row("v", number(odometry.v, 3), "m/s", centred_bar(odometry.v / V_MAX, length))
    motion.add_row("omega", number(odometry.omega, 3), "rad/s", centred_bar(odometry.omega / OMEGA_MAX, length))
    pose = _grid()
    pose.add_row("", Text("odometry", style=LABEL), "", Text("room", style=LABEL))
    true = snapshot.get(POSE) or (None, None, None)
    pose.add_row("x", number(odometry.x, 3), "m", number(true[0], 3))
    pose.add_row("y", number(odometry.y, 3), "m", number(true[1], 3))
    heading = None if true[2] is None else degrees(true[2])
    pose.add_row("theta", number(degrees(odometry.theta), 1), "°", number(heading, 1))
    padding = (1 if rows >= 20 else 0, 1)
    return Group(
        Panel(motion, title="encoders", border_style=DIM, padding=padding),
        Panel(pose, title="pose", border_style=DIM, padding=padding),
    )


def _grid() -> Table:
    """Columns for name, number, unit, and one more."""
    table = Table.grid(padding=(0, 1))
    table.add_column(style=LABEL, no_wrap=True)
    table.add_column(justify="right", no_wrap=True, min_width=9)
    table.add_column(style=DIM, no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    return table


def _count(ticks: int | None) -> str:
    """The ticks; a dash for None."""
    return DASH if ticks is None else str(ticks)
