"""The PWM screen: the six channels and the mode."""

from __future__ import annotations

from typing import Final

from rich.console import RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from txt1.hal.base import Capabilities
from txt1.tasks.controller import SETPOINT
from txt1.tasks.fields import BACKLIGHT, CAPABILITIES, SERVOS, Control
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.text import DASH, DIM, LABEL, bar, centred_bar
from txt1.ui.viewer import Viewer

COUNTS_MAX: Final = 24000
"""PWM counts at the end of the range: a pulse of 1 or 2 ms."""

_BESIDE_BAR: Final = 32
"""Columns of a row that are not bar."""


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """PWM for a body of width x rows cells."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style=LABEL, justify="right", no_wrap=True)
    table.add_column(style=LABEL, no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    table.add_column(no_wrap=True)
    length = max(11, width - _BESIDE_BAR)
    spaced = rows >= 20
    for channel, (name, counts) in enumerate(channels_of(snapshot), start=1):
        table.add_row(str(channel), name, DASH if counts is None else str(counts), _counts_bar(counts, length))
        if spaced:
            table.add_row()
    light = snapshot.get(BACKLIGHT)
    level = Text() if light is None else bar(light, length)
    table.add_row("6", "backlight", DASH if light is None else f"{100.0 * light:.0f} %", level)
    table.add_row()
    mode = "manual" if snapshot.get(MODE, Mode()).panel.manual else "controller"
    table.add_row("", "mode", mode if snapshot.get(CAPABILITIES, Capabilities()).pwm else DASH)
    return Panel(table, title=f"PWM (counts, ±{COUNTS_MAX})", border_style=DIM, padding=(int(spaced), 1))


def channels_of(snapshot: Snapshot) -> tuple[tuple[str, int | None], ...]:
    """Names and counts of the five output channels; None where this HAL does not tell."""
    outputs = snapshot.get(SETPOINT, Control()).outputs
    capabilities = snapshot.get(CAPABILITIES, Capabilities())
    told = snapshot.get(SERVOS) if capabilities.servos else None
    servos = (outputs.pwm4, outputs.pwm5) if capabilities.pwm else told or (None, None)
    return (
        ("motor", outputs.motor if capabilities.pwm else None),
        ("front", outputs.front if capabilities.pwm else None),
        ("rear", outputs.rear if capabilities.pwm else None),
        ("pwm4", servos[0]),
        ("pwm5", servos[1]),
    )


def _counts_bar(counts: int | None, length: int) -> Text:
    """The bar of a channel; none where it is unknown."""
    return Text() if counts is None else centred_bar(counts / COUNTS_MAX, length)
