"""The SENSORS screen: every sensor with its values, how old they are, and how it is."""

from __future__ import annotations

from rich.console import RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from txt1.sensors.base import SENSORS, SensorState
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.text import BAD, DASH, DIM, GOOD, LABEL, clean, count, duration
from txt1.ui.viewer import Viewer


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """SENSORS for a body of width x rows cells."""
    table = Table(box=None, padding=(0, 2, 0, 1), pad_edge=False, header_style=LABEL)
    table.add_column("sensor", overflow="ellipsis")
    table.add_column("value", overflow="fold", ratio=1)
    for name in ("age", "readings", "failures"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("state", overflow="fold", min_width=8)
    sensors = snapshot.get(SENSORS, ())
    for sensor in sensors[: rows - 3]:
        table.add_row(
            clean(sensor.name),
            values_of(sensor),
            DASH if sensor.time is None else duration(max(0.0, snapshot.time - sensor.time)),
            count(sensor.readings, 7),
            Text(count(sensor.failures, 7), style=BAD if sensor.failures else ""),
            Text("healthy", style=GOOD) if sensor.healthy else Text(clean(sensor.reason), style=BAD),
        )
    hidden = len(sensors) - len(sensors[: rows - 3])
    title = f"SENSORS (and {hidden} more)" if hidden > 0 else "SENSORS"
    return Panel(table if sensors else Text("none configured", style=DIM), title=title, border_style=DIM, padding=0)


def values_of(sensor: SensorState) -> str:
    """The last reading's numbers, named where there are several, with their unit; a dash before the first."""
    if not sensor.values:
        return DASH
    if len(sensor.values) == 1:
        numbers = f"{next(iter(sensor.values.values())):.6g}"
    else:
        numbers = "  ".join(f"{name} {value:.6g}" for name, value in sensor.values.items())
    return clean(f"{numbers} {sensor.units}".rstrip())
