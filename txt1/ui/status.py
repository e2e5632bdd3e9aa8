"""The STATUS screen: state, batteries, gains in force, faults and the latest events."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from txt1.control.commander import Driver
from txt1.control.pid import Gains
from txt1.hal.base import Capabilities
from txt1.tasks.battery import BATTERIES
from txt1.tasks.controller import SETPOINT
from txt1.tasks.diagnostics import FAULTS
from txt1.tasks.fields import (
    BOARD,
    CAPABILITIES,
    COMMAND,
    DRIVER,
    EVENTS,
    GAIN_TABLE,
    TRAFFIC,
    Battery,
    BatteryState,
    Control,
    GainTable,
    Traffic,
)
from txt1.tasks.mode import MODE, Mode
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.map import framed
from txt1.ui.text import BAD, DASH, DIM, GOOD, LABEL, WARNING, clean, field_table, minutes, number, on_off
from txt1.ui.viewer import Viewer

LEFT = 43
"""Columns of the left half in a window of 80."""

LEFT_ROWS = 21
EVENT_ROWS = 8
"""Rows kept for the events, border included, however many faults there are."""

_BATTERY_STYLES = {
    BatteryState.EXTERNAL: GOOD,
    BatteryState.GOOD: GOOD,
    BatteryState.WARNING: WARNING,
    BatteryState.BAD: BAD,
}


def state_of(snapshot: Snapshot) -> Text:
    """Armed, disarmed with its reason, or EMERGENCY STOP, so that it cannot be overlooked."""
    mode = snapshot.get(MODE, Mode())
    if mode.stopped:
        return Text(" ■ EMERGENCY STOP ■ ", style="bold white on red")
    if mode.armed:
        return Text(" ▶ ARMED ", style="bold black on green")
    reason = f" ({clean(mode.reason)})" if mode.reason else ""
    # the whole reason is among the events
    return Text(f" ▌▌disarmed{reason} ", style="black on yellow", no_wrap=True, overflow="ellipsis")


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """STATUS for a body of width x rows cells; a large window has room for a small map."""
    left_width = max(LEFT, width * 2 // 5)
    layout = Layout()
    left, right = Layout(size=left_width), Layout()
    layout.split_row(left, right)
    state = Group(_robot(snapshot), _batteries(snapshot), _gains(snapshot))
    map_rows = rows - LEFT_ROWS - 1
    if map_rows >= 10:
        left.split_column(Layout(state), Layout(framed(snapshot, viewer, left_width, map_rows), size=map_rows))
    else:
        left.update(state)
    faults, fault_rows = _faults(snapshot, rows - EVENT_ROWS)
    right.split_column(Layout(faults, size=fault_rows), Layout(_events(snapshot, rows - fault_rows - 2)))
    return layout


def _robot(snapshot: Snapshot) -> Panel:
    """Mode of operation and commands."""
    can, control = snapshot.get(CAPABILITIES, Capabilities()), snapshot.get(SETPOINT, Control())
    mode = snapshot.get(MODE, Mode())
    power = mode.power
    switches = Text.assemble("ATX ", on_off(power.atx), "  ESC ", on_off(power.esc))
    return Panel(
        field_table(
            ("state", state_of(snapshot)),
            ("link", _link(snapshot)),
            ("odometry", control.source.value if can.pwm else DASH),
            ("mode", DASH if not can.pwm else "manual" if mode.panel.manual else "controller"),
            ("driver", _driver(snapshot)),
            ("command", _command(snapshot)),
            ("set-point", _velocity(control.v, control.omega)),
            ("power", switches if can.power else DASH),
        ),
        title="robot",
        border_style=DIM,
    )


def _link(snapshot: Snapshot) -> Text:
    """Alive or lost; behind a line also how old the odometry is."""
    if not snapshot.get(MODE, Mode()).link.alive:
        return Text("lost", style=BAD)
    text = Text("alive", style=GOOD)
    if snapshot.get(BOARD) is not None:
        text.append(f", odometry {1000.0 * snapshot.get(TRAFFIC, Traffic()).odometry_age:.0f} ms old", DIM)
    return text


def _driver(snapshot: Snapshot) -> Text:
    """The source of commands that has the wheel, and how often others were refused."""
    driver = snapshot.get(DRIVER, Driver())
    text = Text(clean(driver.name) or "nobody", no_wrap=True, overflow="ellipsis")
    if driver.refused:
        text.append(f", refused {', '.join(f'{clean(name)} {n}' for name, n in driver.refused.items())}", WARNING)
    return text


def _command(snapshot: Snapshot) -> str:
    """The latest velocity command, whoever gave it; the set-point is what became of it."""
    command = snapshot.get(COMMAND)
    return "none" if command is None else _velocity(command.v, command.omega)


def _velocity(v: float, omega: float) -> str:
    """Speed and yaw rate with their units."""
    return f"{number(v, 2):>5} m/s {number(omega, 3):>6} rad/s"


def _batteries(snapshot: Snapshot) -> Panel:
    """Voltages, state and what is left."""
    battery = snapshot.get(BATTERIES[0], Battery())
    state = DASH if battery.state is None else Text(battery.state.value, style=_BATTERY_STYLES[battery.state])
    return Panel(
        field_table(
            ("battery", state),
            ("battery 1", number(battery.battery1, 2, "V")),
            ("battery 2", number(battery.battery2, 2, "V")),
            ("remaining", minutes(battery.remaining)),
        ),
        title="battery",
        border_style=DIM,
    )


def _gains(snapshot: Snapshot) -> Panel:
    """Linear gains as loaded, angular ones as scheduled now; a board keeps the latter to itself."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style=LABEL, no_wrap=True)
    for _ in range(3):
        table.add_column(justify="right", no_wrap=True)
    table.add_row("", *(Text(name, style=LABEL) for name in ("Kp", "Ki", "Kd")))
    gains, can = snapshot.get(GAIN_TABLE, GainTable()), snapshot.get(CAPABILITIES, Capabilities())
    in_force = snapshot.get(SETPOINT, Control()).gains if can.pwm else None
    table.add_row("linear", *gain_cells(gains.linear if gains.loaded else None))
    table.add_row("angular", *gain_cells(in_force))
    title = "gains in force" if gains.loaded else "gains (not loaded)"
    return Panel(table, title=title, border_style=DIM)


def gain_cells(gains: Gains | None) -> list[str]:
    """Kp, Ki and Kd with three decimals each, as the protocol carries them; dashes for None."""
    return [number(gain, 3) for gain in gains] if gains is not None else [DASH] * 3


def _faults(snapshot: Snapshot, rows: int) -> tuple[Panel, int]:
    """The counters that are not zero in at most `rows` rows, and how many rows it takes."""
    counted = [(clean(name), count) for name, count in snapshot.get(FAULTS, {}).items() if count]
    room = max(1, rows - 2)
    if len(counted) > room:
        hidden = counted[room - 1 :]
        counted = [*counted[: room - 1], (f"and {len(hidden)} more", sum(count for _, count in hidden))]
    table = Table.grid(padding=(0, 2))
    table.add_column(overflow="fold")
    table.add_column(justify="right", style=WARNING, no_wrap=True)
    for name, count in counted:
        table.add_row(name, str(count))
    return Panel(table if counted else Text("none", style=GOOD), title="faults", border_style=DIM), max(
        1, len(counted)
    ) + 2


def _events(snapshot: Snapshot, rows: int) -> Panel:
    """The latest events, newest first, as many as can have room in so many rows."""
    table = Table.grid(padding=(0, 1))
    table.add_column(justify="right", style=DIM, no_wrap=True)
    table.add_column(overflow="fold")
    for event in reversed(snapshot.get(EVENTS, ())[-max(1, rows) :]):
        table.add_row(f"{event.time:.1f}", clean(event.text))
    return Panel(table, title="events (s)", border_style=DIM)
