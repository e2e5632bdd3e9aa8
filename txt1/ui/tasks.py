"""The TASKS screen: rates, cycles, misses, lateness and run times."""

from __future__ import annotations

from typing import Final

from rich.console import RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from txt1.kernel.statistics import Percentiles
from txt1.tasks.fields import Snapshot
from txt1.ui.text import BAD, DASH, DIM, LABEL, clean, count, duration

WIDE: Final = 133
"""Columns from which there is room for p99.9 and the share of the processor."""


def screen(snapshot: Snapshot, width: int) -> RenderableType:
    """TASKS for a body of so many columns."""
    wide = width >= WIDE
    table = Table(box=None, padding=(0, 2 if wide else 0, 0, 1), pad_edge=False, header_style=LABEL)
    table.add_column("\ntask", overflow="ellipsis")
    columns = ["\nprio", "\nrate", "\ncycles", "\nmiss"]
    shares = ("p50", "p99", "p99.9", "max") if wide else ("p50", "p99", "max")
    columns += [f"{'late' if i == 0 else ''}\n{share}" for i, share in enumerate(shares)]
    columns += [f"{'run' if i == 0 else ''}\n{share}" for i, share in enumerate(shares)]
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True, min_width=6 if "p" in name or "max" in name else None)
    if wide:
        table.add_column("p50 load\nshare", justify="right", no_wrap=True)
    for task in snapshot.tasks:
        rate = "event" if task.rate is None else f"{task.rate:g}Hz"
        misses = Text(count(task.misses, 4), style=BAD if task.misses else "")
        cells: list[str | Text] = [
            rate,
            count(task.cycles, 7),
            misses,
            *_times(task.lateness, wide),
            *_times(task.run_time, wide),
        ]
        if wide:
            cells.append(DASH if task.rate is None else f"{100.0 * task.rate * task.run_time.p50:.2f} %")
        table.add_row(clean(task.name), str(task.priority), *cells)
    return Panel(table, title="TASKS (lateness of the start, run time)", border_style=DIM, padding=0)


def _times(times: Percentiles, wide: bool) -> list[str]:
    """The percentiles and the maximum for people."""
    shown = (times.p50, times.p99, times.p999, times.max) if wide else (times.p50, times.p99, times.max)
    return [duration(s) for s in shown]
