"""The STATUS screen: state, batteries, gains in force, faults and the latest events."""

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.layout import Layout

from txt1.control.commander import Driver
from txt1.control.pid import Gains
from txt1.control.standstill import UNOBEYED, Stop
from txt1.hal.base import Capabilities
from txt1.tasks import fields
from txt1.tasks.battery import BATTERIES
from txt1.tasks.controller import SETPOINT
from txt1.tasks.diagnostics import FAULTS, LIMITED
from txt1.tasks.fields import BatteryState, Control, GainTable, Panel, Power, Traffic
from txt1.tasks.mode import MODE, Mode
from txt1.tasks.standstill import STOP
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.map import screen as map_screen
from txt1.ui.text import (
    BAD,
    DASH,
    DIM,
    FIELDS,
    GOOD,
    LABEL,
    NAME_COLUMN,
    WARNING,
    Column,
    Kept,
    clean,
    number,
    styled,
    table,
)
from txt1.ui.viewer import Viewer

# columns of the left half in a window of 80
LEFT = 43
LEFT_ROWS = 21
# columns of a narrow window, border included
ROBOT_ROWS = 12
# columns below which two halves have no room
HALVES_WIDTH_MIN = 72
# rows kept for the events, border included, whatever the number of faults
EVENT_ROWS = 8
# V, less than any pack and more than an open input shows
NO_PACK = 0.5
_BATTERY_STYLES = {BatteryState.WARNING: WARNING, BatteryState.BAD: BAD}
_NUMBER = Column(right=True)


def state_of(snapshot: Snapshot) -> str:
    """Return armed, disarmed, EMERGENCY STOP, or a failed stop, in colours that stand out."""
    mode, stop = snapshot.get(MODE, Mode()), snapshot.get(STOP)
    if stop in (*UNOBEYED, Stop.UNASKED):
        return f"[bold white on red] ▲ {stop.value} [/]"
    if mode.stopped:
        return "[bold white on red] ■ EMERGENCY STOP ■ [/]"
    if mode.armed:
        return "[bold black on green] ▶ ARMED [/]"
    return "[black on yellow] ▌▌disarmed [/]"


def notes_of(snapshot: Snapshot) -> Iterator[str]:
    """Yield why the robot does not obey, the remedy first: its reason, mode and ESC; then the warnings."""
    mode = snapshot.get(MODE, Mode())
    if mode.reason and not (mode.armed or mode.stopped or mode.reason.startswith("not armed")):
        yield mode.reason
    if mode.panel.manual:
        yield "c: back to controller mode; in manual mode keys do not drive"
    if mode.power.esc is False:
        yield "e: switch the ESC on; it is off, so nothing moves"
    yield from snapshot.get(fields.WARNINGS, ())


def screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """Return STATUS for a body of width x rows cells. A large window includes a small map, a narrow window no gains."""
    if width < HALVES_WIDTH_MIN:
        return _narrow(snapshot, width, rows)
    left_width = max(LEFT, width * 2 // 5)
    layout = Layout()
    left, right = Layout(size=left_width), Layout()
    layout.split_row(left, right)
    state = Group(_robot(snapshot), _batteries(snapshot), _gains(snapshot))
    map_rows = rows - LEFT_ROWS - 1
    if map_rows >= 10:
        left.split_column(Layout(state), Layout(map_screen(snapshot, viewer, left_width, map_rows), size=map_rows))
    else:
        left.update(state)
    faults = _faults(snapshot, max(1, rows - EVENT_ROWS - 2))
    latest = snapshot.get(fields.EVENTS, ())[: -max(1, rows - len(faults) - 4) - 1 : -1]
    right.split_column(
        Layout(table("faults", (Column(fold=True), Column(style=WARNING, right=True)), faults), size=len(faults) + 2),
        Layout(_events(latest)),
    )
    return layout


def _narrow(snapshot: Snapshot, width: int, rows: int) -> RenderableType:
    """Return one column: the robot with its battery and faults, and below it as many events as fit."""
    battery = snapshot.get(BATTERIES[0], fields.Battery())
    values = [number(battery.battery1, 2, "V"), _second(battery), _charge(battery), _left(battery)]
    told = _in_a_line(_faults(snapshot, 100), width - 15)
    robot = table("robot", FIELDS, (*_fields(snapshot), ("battery", "  ".join(values)), ("faults", told)))
    latest = snapshot.get(fields.EVENTS, ())[: -max(1, rows - ROBOT_ROWS) - 1 : -1]
    layout = Layout()
    layout.split_column(Layout(robot, size=ROBOT_ROWS), Layout(_events(latest)))
    return layout


def _robot(snapshot: Snapshot) -> Kept:
    return table("robot", FIELDS, _fields(snapshot))


def mode_of(panel: Panel, can: Capabilities) -> str:
    """Return manual or controller mode in a word; a dash if it is unknown."""
    if panel.manual is None or not can.by_hand:
        return DASH
    return "manual" if panel.manual else "controller"


def _fields(snapshot: Snapshot) -> tuple[tuple[str, str], ...]:
    can, control = snapshot.get(fields.CAPABILITIES, Capabilities()), snapshot.get(SETPOINT, Control())
    mode, command = snapshot.get(MODE, Mode()), snapshot.get(fields.COMMAND)
    link = styled("alive", GOOD) if mode.link.alive else styled("lost", BAD)
    if mode.link.alive and snapshot.get(fields.BOARD) is not None:
        age = 1000.0 * snapshot.get(fields.TRAFFIC, Traffic()).odometry_age
        link += styled(f", odometry {age:.0f} ms old", DIM)
    driver = snapshot.get(fields.DRIVER, Driver())
    drives = clean(driver.name) or "nobody"
    if driver.refused:
        refused = ", ".join(f"{clean(name)} {n}" for name, n in driver.refused.items())
        drives += styled(f", refused {refused}", WARNING)
    power = (("ATX", mode.power.atx), ("ESC", mode.power.esc))
    switches = (f"{name} {_switch(on, mode.power)}" for name, on in power)
    return (
        ("state", state_of(snapshot)),
        ("link", link),
        ("odometry", control.source.value if can.pwm else DASH),
        ("mode", mode_of(mode.panel, can)),
        ("driver", drives),
        ("command", "none" if command is None else _velocity(command.v, command.omega)),
        ("set-point", _velocity(control.v, control.omega)),
        ("power", "  ".join(switches) if can.power else DASH),
    )


def _switch(on: bool | None, power: Power) -> str:
    """Return on or off, with a question mark if it was requested and not confirmed."""
    if on is None:
        return DASH
    return styled(f"{'on' if on else 'off'}{'' if power.confirmed else '?'}", GOOD if on else WARNING)


def _velocity(v: float, omega: float) -> str:
    return f"{number(v, 2):>5} m/s {number(omega, 3):>6} rad/s"


def _batteries(snapshot: Snapshot) -> Kept:
    battery = snapshot.get(BATTERIES[0], fields.Battery())
    rows = (
        ("battery", _charge(battery)),
        ("battery 1", number(battery.battery1, 2, "V")),
        ("battery 2", _second(battery)),
        ("remaining", _left(battery)),
    )
    return table("battery", FIELDS, rows)


def _second(battery: fields.Battery) -> str:
    """Return the second pack's voltage; an input without a pack shows almost 0."""
    none = battery.battery2 is not None and battery.battery2 < NO_PACK
    return "no pack" if none else number(battery.battery2, 2, "V")


def _charge(battery: fields.Battery) -> str:
    """Return good, warning or bad."""
    state = battery.state
    return DASH if state is None else styled(state.value, _BATTERY_STYLES.get(state, GOOD))


def _left(battery: fields.Battery) -> str:
    """Return the remaining time."""
    return number(None if battery.remaining is None else battery.remaining / 60.0, 0, "min")


def _gains(snapshot: Snapshot) -> Kept:
    """Return linear gains as loaded, and the scheduled angular gains; a board does not report the latter."""
    gains = snapshot.get(fields.GAIN_TABLE, GainTable())
    pwm = snapshot.get(fields.CAPABILITIES, Capabilities()).pwm
    rows = (
        ("", *(styled(name, LABEL) for name in ("Kp", "Ki", "Kd"))),
        ("linear", *gain_cells(gains.linear if gains.loaded else None)),
        ("angular", *gain_cells(snapshot.get(SETPOINT, Control()).gains if pwm else None)),
    )
    loaded = "gains in force" if pwm else "gains (acknowledged)"
    return table(loaded if gains.loaded else "gains (not loaded)", (NAME_COLUMN, _NUMBER, _NUMBER, _NUMBER), rows)


def gain_cells(gains: Gains | None) -> list[str]:
    """Return Kp, Ki and Kd with three decimals each, as in the protocol; dashes for None."""
    return [number(gain, 3) for gain in gains or (None, None, None)]


def _events(events: Sequence[fields.Event]) -> Kept:
    """Return time in s and text of each event."""
    rows = tuple((f"{event.time:.1f}", clean(event.text)) for event in events)
    return table("events (s)", (Column(style=DIM, right=True), Column(fold=True)), rows, gap=1)


def _in_a_line(faults: Sequence[tuple[str, ...]], room: int) -> str:
    """Return the counters in at most `room` cells, and the number of counters left out."""
    told = ""
    for number_of, (name, count) in enumerate(faults):
        more = f"{told}  {name} {count}".strip()
        if len(more) > room - len("  and 99 more") and number_of:
            return f"{told}  and {len(faults) - number_of} more"
        told = more
    return told


def _faults(snapshot: Snapshot, room: int) -> tuple[tuple[str, ...], ...]:
    """Return the counters of faults that are not zero, in at most `room` rows."""
    counted = [(clean(name), n) for name, n in snapshot.get(FAULTS, {}).items() if n and name not in LIMITED]
    if len(counted) > room:
        hidden = counted[room - 1 :]
        counted = [*counted[: room - 1], (f"and {len(hidden)} more", sum(count for _, count in hidden))]
    return tuple((name, str(count)) for name, count in counted) or ((styled("none", GOOD), ""),)
