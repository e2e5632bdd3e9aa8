"""Draws a snapshot as a full screen of text: header, state of the robot, the chosen screen, keys.

Screens have names. The package's own come from a table and from additions, other packages' from their additions and the
entry-point group ``txt1.screens``::

    [project.entry-points."txt1.screens"]
    THERMOMETER = "mypackage.thermometer:screen"

where ``screen(snapshot, viewer, width, rows)`` returns a renderable of `rich` for this number of cells. The joystick
goes through all screens. They are imported in the drawing process only. A screen that fails shows its error.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from itertools import accumulate
from textwrap import wrap
from typing import Final, NamedTuple

from rich.align import Align
from rich.console import Console, ConsoleOptions, RenderableType
from rich.layout import Layout
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from txt1 import additions
from txt1.tasks.battery import BATTERIES
from txt1.tasks.fields import EVENTS, PAGE, TRAFFIC, Battery, Traffic
from txt1.tasks.mode import MODE, Mode
from txt1.tasks.panel import buzzer
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.status import notes_of, state_of
from txt1.ui.text import BAD, DASH, DIM, GOOD, NAME_COLUMN, Column, clean, printable, run_time, styled, table
from txt1.ui.viewer import DRIVING, Viewer

SCREENS: Final = {
    "STATUS": "txt1.ui.status:screen",
    "PWM": "txt1.ui.tables:pwm",
    "ENCODERS": "txt1.ui.tables:encoders",
    "PID GAINS": "txt1.ui.tables:gains",
    "MAP": "txt1.ui.map:screen",
    "SENSORS": "txt1.ui.tables:sensors",
    "TASKS": "txt1.ui.tables:tasks",
}
"""The package's own screens in the order of the joystick: the LCD's four, and further screens."""

GROUP: Final = "txt1.screens"
# s for which an event takes the place of the keys
NEWS_TIME: Final = 4.0

Render = Callable[[Snapshot, Viewer, int, int], RenderableType]
"""Draws a snapshot for a body of `columns` x `rows` cells."""


@cache
def installed() -> dict[str, EntryPoint]:
    """Return all screens by name, in the order of the joystick."""
    ours = {**_points(SCREENS), **_brought(additions.ours())}
    others = {**_brought(additions.strangers().found), **{point.name: point for point in entry_points(group=GROUP)}}
    return ours | {name: others[name] for name in sorted(others)}


def _brought(by: Mapping[str, additions.Addition]) -> dict[str, EntryPoint]:
    return {name: point for each in by.values() for name, point in _points(each.parts.get(GROUP, {})).items()}


def _points(places: Mapping[str, str]) -> dict[str, EntryPoint]:
    return {name: EntryPoint(name, where, GROUP) for name, where in places.items()}


def render(snapshot: Snapshot | None, viewer: Viewer, width: int, height: int) -> RenderableType:
    """Return the screen for a window of width x height cells; without a snapshot the robot has not reported yet."""
    if snapshot is None:
        waiting = Text("TXT-1: waiting for the robot", style="bold", justify="center")
        return Align.center(waiting, vertical="middle", height=height)
    names = list(installed())
    # the number chosen with the joystick
    name = names[snapshot.get(MODE, Mode()).panel.screen % len(names)]
    told = [line for each in notes_of(snapshot) for line in wrap(printable(each), max(1, width - 2))]
    # the body keeps at least a row
    warnings = [Text(f" {line}", "bold yellow", no_wrap=True) for line in told[: max(0, height - 4)]]
    news = _news(snapshot, width)
    below = news or [_keys(viewer, width)]
    rows = height - 2 - len(warnings) - len(below)
    body = _help(viewer, width, rows - 2) if viewer.help else _Screen(name, snapshot, viewer, width, max(1, rows))
    header, state = _header(snapshot, names, name, width), _state_line(snapshot, viewer)
    layout = Layout()
    above = (header, state, *warnings)
    layout.split_column(
        *(Layout(line, size=1) for line in above), Layout(body), *(Layout(line, size=1) for line in below)
    )
    return layout


class _Screen(NamedTuple):
    """Return the screen of this name, or its error: another package's screen must not take the robot's keys along."""

    name: str
    snapshot: Snapshot
    viewer: Viewer
    width: int
    rows: int

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[Segment]:
        try:
            draw: Render = installed()[self.name].load()
            return list(console.render(draw(self.snapshot, self.viewer, self.width, self.rows), options))
        except Exception as error:
            told = f"this screen failed: {type(error).__name__}: {clean(str(error))}"
            return console.render(table(self.name, (Column(fold=True),), ((styled(told, BAD),),)), options)


def _header(snapshot: Snapshot, names: list[str], current: str, width: int) -> RenderableType:
    """Return name, time of the run, and the screens' names as far as there is room, with the present screen marked."""
    left = Text.from_markup(f"[bold reverse] TXT-1 [/] {clean(snapshot.name)} {run_time(snapshot.time)}")
    if page := snapshot.get(PAGE):
        left.append(f" {printable(page)}", "underline")
    tabs = Text()
    if left.cell_len + sum(len(name) + 2 for name in names) > width:
        tabs.append(f"{names.index(current) + 1}/{len(names)} ", DIM)
        names = [current]
    for name in names:
        tabs.append(f"[{name}]" if name == current else f" {name} ", "bold black on cyan" if name == current else DIM)
    return _edges(left, tabs)


def _state_line(snapshot: Snapshot, viewer: Viewer) -> RenderableType:
    """Return whether the robot is armed, and the key that arms; buzzer, link and the two LEDs, which toggle
    with messages.
    """
    mode, traffic = snapshot.get(MODE, Mode()), snapshot.get(TRAFFIC, Traffic())
    alive = mode.link.alive
    sounds = buzzer(alive, snapshot.get(BATTERIES[0], Battery()).state, snapshot.time)
    link = styled("link alive", GOOD) if alive else styled("link lost", "red")
    rx, tx = (
        styled("●", "bright_green") if messages % 2 else styled("○", DIM)
        for messages in (traffic.received, traffic.transmitted)
    )
    lights = f"{link}  RX {rx}  TX {tx}"
    arms = "" if mode.armed or viewer.keys.get("m") != "arm" else f" {styled('m', 'bold')} arms"
    return _edges(state_of(snapshot) + arms, f"{'[bold black on yellow] BUZZER [/]' if sounds else ''}  {lights}")


def _news(snapshot: Snapshot, width: int) -> list[Text]:
    """Return what was told in the last `NEWS_TIME` s, such as the answer to a key, unless a row above says it."""
    events, notes = snapshot.get(EVENTS, ()), list(notes_of(snapshot))
    if not events or snapshot.time - events[-1].time > NEWS_TIME or any(note in events[-1].text for note in notes):
        return []
    return [
        Text(f" {line}", "bold cyan", no_wrap=True) for line in wrap(printable(events[-1].text), max(1, width - 2))[:2]
    ]


def _edges(left: str | Text, right: str | Text) -> Table:
    """Return a row: `left` at the left edge, cut where `right` at the right edge begins."""
    row = Table.grid(expand=True, padding=0)
    row.add_column(ratio=1, no_wrap=True)
    row.add_column(justify="right", no_wrap=True)
    row.add_row(left, right)
    return row


def _keys(viewer: Viewer, width: int) -> Text:
    line = Text(no_wrap=True, overflow="crop")
    for key, meaning in viewer.keys.items():
        if line.cell_len + len(key) + len(meaning) + 1 <= width:
            line.append(key, "bold").append(f" {meaning} ", DIM)
    return line


def _help(viewer: Viewer, width: int, room: int) -> RenderableType:
    """Return the keys, in at most `room` rows; if there are more, the last row says so."""
    driving = (
        ("SPACE", "EMERGENCY STOP: neutral at once, latched until m"),
        ("m", "arm; also the way back from an emergency stop"),
        ("w s", "drive forwards, backwards"),
        ("a d", "steer left, right; the wheel's side in reverse"),
        ("", "a key counts for 0.7 s, then fades in 0.3 s"),
        ("+ -", "speed of w and s, from 0.1 m/s up"),
        ("← →", "screen: " + ", ".join(installed())),
        ("↑ ↓", "scroll the table of gains"),
        ("c", "joystick centre: controller or manual mode"),
        ("e", "ESC on, off; a board: disarmed only, in 3.2 s"),
        ("?", "this help, and back"),
        ("p", "the text before these screens; a key comes back"),
        ("q", "quit: outputs neutral, terminal as it was"),
        ("", ""),
        (DASH, "a value that this hardware layer cannot know"),
        ("on?", "asked for, and confirmed by nobody"),
        ("BUZZER", "link lost; battery low: 2 s on, 2 s off; empty: 1 s"),
        ("RX TX", "toggle with every message received and sent"),
    )
    rows: tuple[tuple[str, str], ...] = tuple(viewer.keys.items())
    if viewer.keys.items() >= DRIVING.items():
        rows = (driving[0], *(row for row in rows if row[0] not in (*DRIVING, "p")), *driving[1:])
    taken = [max(1, len(wrap(text, max(1, width - 12)))) for _, text in rows]
    shown = sum(until <= room for until in accumulate(taken))
    if shown < len(rows):
        shown = sum(until < room for until in accumulate(taken))
        rows = (*rows[:shown], ("…", "and more, in a larger window"))
    return table("HELP", (NAME_COLUMN, Column(fold=True)), rows, border="cyan")
