"""A snapshot as a full screen of text: header, state of the robot, one of the six screens, keys. Pure."""

from __future__ import annotations

from rich.align import Align
from rich.console import RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from txt1.tasks.fields import SCREENS, Snapshot
from txt1.ui import encoders, gains, pwm, status, tasks
from txt1.ui.map import draw_map
from txt1.ui.text import DIM, clean, field_table, run_time
from txt1.ui.viewer import Viewer

HEADER_ROWS = 2
FOOTER_ROWS = 1
BORDER = 2
"""Rows, and columns, that a panel's border takes."""

_KEYS = (
    ("←→", "screen"),
    ("↑↓", "gains"),
    ("c", "manual"),
    ("wasd", "drive"),
    ("+-", "speed"),
    ("SPACE", "stop"),
    ("m", "arm"),
    ("?", "help"),
    ("q", "quit"),
)


def render(snapshot: Snapshot | None, viewer: Viewer, width: int, height: int) -> RenderableType:
    """What to print on a window of width x height cells; None: the robot has not reported yet."""
    if snapshot is None:
        waiting = Text("TXT-1: waiting for the robot", style="bold", justify="center")
        return Align.center(waiting, vertical="middle", height=height)
    rows = max(1, height - HEADER_ROWS - FOOTER_ROWS)
    layout = Layout()
    layout.split_column(
        Layout(_header(snapshot), size=1),
        Layout(_state_line(snapshot), size=1),
        Layout(_help() if viewer.help else _screen(snapshot, viewer, width, rows)),
        Layout(_keys(), size=1),
    )
    return layout


def _screen(snapshot: Snapshot, viewer: Viewer, width: int, rows: int) -> RenderableType:
    """The current screen for a body of width x rows cells."""
    match SCREENS[snapshot.panel.screen % len(SCREENS)]:
        case "STATUS":
            return status.screen(snapshot, viewer, width, rows)
        case "PWM":
            return pwm.screen(snapshot, width, rows)
        case "ENCODERS":
            return encoders.screen(snapshot, viewer, width, rows)
        case "PID GAINS":
            return gains.screen(snapshot, rows)
        case "MAP":
            lines = draw_map(snapshot, viewer, width - BORDER, rows - BORDER)
            return Panel(Text("\n").join(lines), title="MAP", padding=0, border_style=DIM)
        case _:
            return tasks.screen(snapshot, width)


def _header(snapshot: Snapshot) -> RenderableType:
    """Name, HAL, time of the run, and the screens' names with the current one marked."""
    left = Text(no_wrap=True, overflow="crop").append(" TXT-1 ", "bold reverse")
    left.append(f" {clean(snapshot.hal)} {run_time(snapshot.time)}")
    tabs = Text(no_wrap=True)
    for index, name in enumerate(SCREENS):
        current = index == snapshot.panel.screen % len(SCREENS)
        tabs.append(f"[{name}]" if current else f" {name} ", "bold black on cyan" if current else DIM)
    return _edges(left, tabs)


def _state_line(snapshot: Snapshot) -> RenderableType:
    """Armed or not, large; buzzer, link and the two LEDs, which toggle with each message."""
    indicators = Text(no_wrap=True)
    if snapshot.buzzer:
        indicators.append(" BUZZER ", "bold black on yellow")
    indicators.append(
        "  link alive" if snapshot.link.alive else "  link lost", "green" if snapshot.link.alive else "red"
    )
    indicators.append("  RX ").append(*_led(snapshot.received)).append("  TX ").append(*_led(snapshot.transmitted))
    return _edges(status.state_of(snapshot), indicators)


def _led(count: int) -> tuple[str, str]:
    """An LED that toggles with every message, and its colour."""
    return ("●", "bright_green") if count % 2 else ("○", DIM)


def _edges(left: Text, right: Text) -> Table:
    """One row: `left` at the left edge, cut where `right` at the right edge begins."""
    row = Table.grid(expand=True, padding=0)
    row.add_column(ratio=1, no_wrap=True)
    row.add_column(justify="right", no_wrap=True)
    row.add_row(left, right)
    return row


def _keys() -> Text:
    """The keys in one row."""
    line = Text(no_wrap=True, overflow="crop")
    for key, meaning in _KEYS:
        line.append(key, "bold").append(f" {meaning} ", DIM)
    return line


def _help() -> RenderableType:
    """What every key does."""
    return Panel(
        field_table(
            ("SPACE", "EMERGENCY STOP: outputs neutral at once and latched, until m"),
            ("m", "arm: opens the safety gate; also the way back from an emergency stop"),
            ("w s", "drive forwards, backwards"),
            ("a d", "steer left, right while driving; the wheel's side also in reverse"),
            ("", "a key counts for 0.7 s after its last press, then fades in 0.3 s"),
            ("+ -", "speed of w and s, 0.1 to 1.5 m/s"),
            ("← →", "screen: " + ", ".join(SCREENS)),
            ("↑ ↓", "scroll the table of gains"),
            ("c", "joystick centre: controller or manual mode"),
            ("?", "this help, and back"),
            ("q", "quit: outputs neutral, terminal as it was"),
            ("", ""),
            ("–", "a value that this hardware layer cannot know"),
            ("BUZZER", "link lost or battery low"),
            ("RX TX", "toggle with every message received and sent"),
        ),
        title="HELP",
        border_style="cyan",
    )
