"""The TASK_REPORTS screen: rates, cycles, misses, lateness and run times."""

from __future__ import annotations

from typing import Final

from rich.console import RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from txt1.kernel.statistics import Percentiles
from txt1.tasks.fields import TASK_REPORTS
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.text import BAD, DASH, DIM, LABEL, clean, count, duration
from txt1.ui.viewer import Viewer

WIDE: Final = 133
"""Columns from which there is room for p99.9 and the share of the processor."""

NARROW: Final = 72
"""Columns below which p99 has to do."""


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """TASK_REPORTS for a body of width x rows cells."""
    wide = width >= WIDE
    shown = ("p50", "p99", "p999", "max") if wide else ("p50", "p99", "max") if width >= NARROW else ("p99",)
    table = Table(box=None, padding=(0, 2 if wide else 0, 0, 1), pad_edge=False, header_style=LABEL)
    table.add_column("\ntask", no_wrap=True, overflow="ellipsis", min_width=8)
    columns = ["\nprio", "\nrate", "\ncycles", "\nmiss"]
    for what in ("late", "run"):
        columns += [f"{what if i == 0 else ''}\n{share.replace('p999', 'p99.9')}" for i, share in enumerate(shown)]
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True, min_width=6 if "p" in name or "max" in name else None)
    if wide:
        table.add_column("p50 load\nshare", justify="right", no_wrap=True)
    for task in snapshot.get(TASK_REPORTS, ()):
        rate = "event" if task.rate is None else f"{task.rate:g}Hz"
        misses = Text(count(task.misses, 4), style=BAD if task.misses else "")
        cells: list[str | Text] = [
            rate,
            count(task.cycles, 7),
            misses,
            *_times(task.lateness, shown),
            *_times(task.run_time, shown),
        ]
        if wide:
            cells.append(DASH if task.rate is None else f"{100.0 * task.rate * task.run_time.p50:.2f} %")
        table.add_row(clean(task.name), str(task.priority), *cells)
    return Panel(table, title="TASK_REPORTS (lateness of the start, run time)", border_style=DIM, padding=0)


def _times(times: Percentiles, shown: tuple[str, ...]) -> list[str]:
    """The percentiles and the maximum for people."""
    return [duration(getattr(times, share)) for share in shown]
