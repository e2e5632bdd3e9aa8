"""The screens that are tables: PWM, ENCODERS, PID GAINS, SENSORS and TASKS."""

from bisect import bisect_left
from math import degrees
from typing import Final

from rich.console import Group, RenderableType
from rich.layout import Layout

from txt1.control.hand import DEFAULT_HAND
from txt1.hal.base import Capabilities, Outputs
from txt1.model.odometry import Odometry
from txt1.sensors.base import SENSORS, SensorState
from txt1.tasks import fields
from txt1.tasks.controller import SETPOINT
from txt1.tasks.encoder import ENCODERS, ODOMETRY, POSE
from txt1.tasks.fields import Control, GainTable
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.map import screen as map_screen
from txt1.ui.status import gain_cells, mode_of
from txt1.ui.text import (
    BAD,
    DASH,
    DIM,
    GOOD,
    LABEL,
    NAME_COLUMN,
    WARNING,
    Column,
    Kept,
    bar,
    centred_bar,
    clean,
    count,
    duration,
    number,
    styled,
    table,
)
from txt1.ui.viewer import Viewer

# PWM counts at the end of the range: a pulse of 1 or 2 ms
COUNTS_MAX: Final = 24000
# rows from which PWM and ENCODERS have blank rows
SPACED: Final = 20
_NUMBER: Final = Column(right=True)


def pwm(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """Return PWM for a body of width x rows cells: the six channels and the mode."""
    length = max(11, width - 32)
    spaced = rows >= SPACED
    outputs, can = snapshot.get(SETPOINT, Control()).outputs, snapshot.get(fields.CAPABILITIES, Capabilities())
    servos = (snapshot.get(fields.SERVOS) if can.servos else None) or (None, None)
    channels = zip(Outputs._fields, outputs[:5] if can.pwm else (None, None, None, *servos), strict=False)
    cells: list[tuple[str, ...]] = []
    for channel, (name, counts) in enumerate(channels, start=1):
        level = "" if counts is None else centred_bar(counts / COUNTS_MAX, length)
        cells.append((str(channel), name, number(counts, 0), level))
        if spaced:
            cells.append(())
    light = snapshot.get(fields.BACKLIGHT)
    backlight = (DASH, "") if light is None else (f"{100.0 * light:.0f} %", bar(light, length))
    mode = mode_of(snapshot.get(MODE, Mode()).panel, can)
    cells += [("6", "backlight", *backlight), (), ("", "mode", mode)]
    columns = (NAME_COLUMN._replace(right=True), NAME_COLUMN, _NUMBER, Column())
    return table(f"PWM (counts, ±{COUNTS_MAX})", columns, tuple(cells), padding=(int(spaced), 1))


def encoders(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """Return ENCODERS for a body of width x rows cells: ticks, velocities and pose, and the path if there is room."""
    if width < 130:
        return _motion(snapshot, width, rows)
    left, layout = width // 2, Layout()
    picture = map_screen(snapshot, viewer, width - left, rows)
    layout.split_row(Layout(_motion(snapshot, left, rows), size=left), Layout(picture))
    return layout


def _motion(snapshot: Snapshot, width: int, rows: int) -> Group:
    odometry, ticks = snapshot.get(ODOMETRY, Odometry()), snapshot.get(ENCODERS, fields.Encoders())
    x, y, theta = snapshot.get(POSE) or (None, None, None)
    length, hand = max(11, width - 34), snapshot.get(fields.HAND, DEFAULT_HAND)
    # the bars' full scales: the tightest bend at full speed
    v_max, omega_max = hand.velocity(hand.v_max, 1.0, 1.0)
    motion = (
        ("ticks right", number(ticks.right, 0), "per period"),
        ("ticks left", number(ticks.left, 0), "per period"),
        (),
        ("v", number(odometry.v, 3), "m/s", centred_bar(odometry.v / v_max, length)),
        ("omega", number(odometry.omega, 3), "rad/s", centred_bar(odometry.omega / omega_max, length)),
    )
    heading = None if theta is None else degrees(theta)
    pose = (
        ("", styled("odometry", LABEL), "", styled("room", LABEL)),
        ("x", number(odometry.x, 3), "m", number(x, 3)),
        ("y", number(odometry.y, 3), "m", number(y, 3)),
        ("theta", number(degrees(odometry.theta), 1), "°", number(heading, 1)),
    )
    columns = (NAME_COLUMN, Column(right=True, least=9), Column(style=DIM), _NUMBER)
    padding = (int(rows >= SPACED), 1)
    return Group(
        table("encoders", columns, motion, gap=1, padding=padding),
        table("pose", columns, pose, gap=1, padding=padding),
    )


def gains(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """Return PID GAINS for a body of width x rows cells: linear gains, and the scrolling table of angular gains."""
    loaded = snapshot.get(fields.GAIN_TABLE, GainTable())
    sets = loaded.angular.sets
    shown = visible(len(sets), max(1, rows - 7), snapshot.get(MODE, Mode()).panel.scroll)
    current = in_force(snapshot)
    angular = []
    for index in shown:
        mark, style = ("►", "bold bright_green") if index == current else ("", "")
        cells = (mark, number(sets[index].v_max, 2), *gain_cells(sets[index].gains))
        angular.append(tuple(styled(cell, style) for cell in cells))
    known = f"in force: {DASH}" if current is None else "► in force"
    title = f"angular: sets {shown.start + 1} to {shown.stop} of {len(sets)}, {known}" if sets else "angular"
    state = styled("loaded", GOOD) if loaded.loaded else styled("not loaded", WARNING)
    linear = ("", "linear", *gain_cells(loaded.linear if loaded.loaded else None))
    return Group(
        _gain_table(f"linear: {state}", "", (linear,), width),
        _gain_table(title, "v_max (m/s)", tuple(angular) or (("", "no sets"),), width),
    )


def _gain_table(title: str, first: str, cells: tuple[tuple[str, ...], ...], width: int) -> Kept:
    """Return a table of mark, v_max, Kp, Ki and Kd, with narrow columns in a narrow window."""
    gap, least = (4, 11) if width >= 70 else (2, 8)
    columns = (Column(least=1), *(Column(heading, right=True, least=least) for heading in (first, "Kp", "Ki", "Kd")))
    return table(title, columns, cells, gap=gap)


def visible(sets: int, rows: int, scroll: int) -> range:
    """Return the range of visible sets: from `scroll` on, but never fewer than fit."""
    first = max(0, min(scroll, sets - rows))
    return range(first, min(sets, first + rows))


def in_force(snapshot: Snapshot) -> int | None:
    """Return the number of the angular set in force; None if the loop runs on a board or uses no set.

    Several sets may have the same gains, so the measured speed picks first.
    """
    loaded, control = snapshot.get(fields.GAIN_TABLE, GainTable()), snapshot.get(SETPOINT)
    sets = loaded.angular.sets
    if control is None or not snapshot.get(fields.CAPABILITIES, Capabilities()).pwm or not loaded.loaded or not sets:
        return None
    expected = min(bisect_left([s.v_max for s in sets], snapshot.get(ODOMETRY, Odometry()).v), len(sets) - 1)
    equal = [index for index, s in enumerate(sets) if s.gains == control.gains]
    return min(equal, key=lambda index: abs(index - expected), default=None)


NO_SENSORS: Final = (
    ("There are none beside the encoders. To see a simulated laser:",),
    ("txt1 run --set sensors.laser.driver=sim_laser",),
    ("All drivers: txt1 sensor list",),
)
"""Rows of SENSORS without a sensor."""


def sensors(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """Return SENSORS for a body of width x rows cells: each sensor with its values, their age, and its health."""
    every = snapshot.get(SENSORS, ())
    cells = [
        (
            clean(sensor.name),
            values_of(sensor),
            DASH if sensor.time is None else duration(max(0.0, snapshot.time - sensor.time)),
            count(sensor.readings, 7),
            styled(count(sensor.failures, 7), BAD if sensor.failures else ""),
            styled("healthy", GOOD) if sensor.healthy else styled(clean(sensor.reason), BAD),
        )
        for sensor in every[: rows - 3]
    ]
    hidden = len(every) - len(cells)
    title = f"SENSORS (and {hidden} more)" if hidden > 0 else "SENSORS"
    if not cells:
        return table(title, (Column(fold=True),), NO_SENSORS, padding=(0, 1))
    columns = (
        Column("sensor", fold=True, least=8),
        Column("value", fold=True, least=8),
        *(Column(heading, right=True) for heading in ("age", "readings", "failures")),
        Column("state", fold=True, least=8),
    )
    return table(title, columns, tuple(cells), gap=3 if width >= 80 else 1)


def values_of(sensor: SensorState) -> str:
    """Return the last reading's numbers with their unit, and names if there are several; a dash before the first.

    Several units stand in brackets, as none of them belongs to the last number alone.
    """
    if not sensor.values:
        return DASH
    several = len(sensor.values) > 1
    rounded = {
        name: f"{round(value, 3) if abs(value) >= 0.001 else value:.6g}" for name, value in sensor.values.items()
    }
    numbers = "  ".join(f"{name} {value}" if several else value for name, value in rounded.items())
    units = f"({sensor.units})" if "," in sensor.units else sensor.units
    return clean(f"{numbers} {units}".rstrip())


def tasks(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """Return TASKS for a body of width x rows cells: rates, cycles, misses, lateness and run times.

    A narrow window shows p99; a wide window also shows p99.9 and the share of the processor.
    """
    wide = width >= 133
    shown = ("p50", "p99", "p999", "max") if wide else ("p50", "p99", "max") if width >= 72 else ("p99",)
    titles = [name.replace("p999", "p99.9") for name in shown]
    times = [f"{group if name == titles[0] else ''}\n{name}" for group in ("late", "run") for name in titles]
    columns = (
        Column("\ntask", least=8),
        *(Column(f"\n{name}", right=True) for name in ("prio", "rate", "cycles", "miss")),
        *(Column(name, right=True, least=6) for name in times),
        *((Column("p50 load\nshare", right=True),) if wide else ()),
    )
    cells: list[tuple[str, ...]] = []
    for task in snapshot.get(fields.TASK_REPORTS, ()):
        share = DASH if task.rate is None else f"{100.0 * task.rate * task.run_time.p50:.2f} %"
        cells.append(
            (
                clean(task.name),
                str(task.priority),
                "event" if task.rate is None else f"{task.rate:g}Hz",
                count(task.cycles, 7),
                styled(count(task.misses, 4), BAD if task.misses else ""),
                *(duration(getattr(spread, name)) for spread in (task.lateness, task.run_time) for name in shown),
                *((share,) if wide else ()),
            )
        )
    title = "TASKS (lateness of the start, run time)"
    return table(title, columns, tuple(cells), gap=3 if wide else 1, padding=(0, int(wide)))
