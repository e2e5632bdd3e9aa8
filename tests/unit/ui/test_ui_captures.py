"""A capture of each screen in tests/golden/screens, to be looked at and kept: what is drawn is what is there.

    python tests/unit/ui/test_ui_captures.py    # renews them; then look at the difference

What is sent to a terminal is UTF-8 whatever LANG says, so LANG=C has no captures of its own; TERM=dumb, a pipe and no
terminal at all get the line a second that line.txt has. The .ansi files have colours: `cat` shows them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from rich.cells import cell_len
from ui_snapshots import TEAM, blind, full, mode

from txt1.fleet import console, selection
from txt1.fleet.members import FLEET
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.screens import installed
from txt1.ui.summary_line import status_line
from txt1.ui.terminal_process import drawn
from txt1.ui.viewer import Viewer

FOLDER = Path(__file__).parents[2] / "golden" / "screens"
COLOUR = re.compile(r"\x1b\[[\d;]*m")
TERMINALS = {  # file: columns, rows, environment
    "60x20.txt": (60, 20, {"NO_COLOR": "1"}),
    "80x24.txt": (80, 24, {"NO_COLOR": "1"}),
    "200x50.txt": (200, 50, {"NO_COLOR": "1"}),
    "80x24.ansi": (80, 24, {"TERM": "xterm-256color"}),
    "80x24-no-color.ansi": (80, 24, {"TERM": "xterm-256color", "NO_COLOR": "1"}),
}
READ = ("TERM", "NO_COLOR", "COLORTERM", "FORCE_COLOR", "COLUMNS", "LINES")  # by rich


def views() -> dict[str, tuple[Snapshot | None, Viewer]]:
    """What there is to be seen, by name: each screen, and those that tell that something is otherwise."""
    stopped = mode(full(), armed=False, stopped=True, reason="emergency stop")
    team = full(screen=list(installed()).index("FLEET")).replaced({FLEET: TEAM})
    return {
        **{name: (full(screen=index), Viewer()) for index, name in enumerate(installed())},
        "FLEET of four": (team, Viewer(selection.KEYS)),
        "FLEET on a console": (team, Viewer(console.KEYS)),
        "HELP": (full(), Viewer(help=True)),
        "STATUS, stopped": (stopped, Viewer()),
        "STATUS of a board that tells little": (blind(), Viewer()),
        "STATUS of a recording": (full(), Viewer({"SPACE": "pause", "q": "quit"})),
        "before the first snapshot": (None, Viewer()),
    }


def captured(file: str) -> str:
    """Every view on this kind of terminal; without its sequences, where the file is a text."""
    width, height, environment = TERMINALS[file]
    kept = {name: os.environ.pop(name) for name in READ if name in os.environ}
    os.environ.update(environment)
    try:
        frames = {name: drawn(*view, width, height) for name, view in views().items()}
    finally:
        for name in READ:
            os.environ.pop(name, None)
        os.environ.update(kept)
    text = "".join(f"--- {name}\n" + "".join(f"{line.rstrip()}\n" for line in frame) for name, frame in frames.items())
    return COLOUR.sub("", text) if file.endswith(".txt") else text


def line() -> str:
    """What TERM=dumb, a pipe and no terminal get every second."""
    return f"{status_line(full())}\n{status_line(mode(blind(), armed=False, reason='link lost'))}\n"


@pytest.mark.parametrize("file", TERMINALS)
def test_each_screen_is_as_it_was_looked_at(file: str) -> None:
    assert captured(file) == (FOLDER / file).read_text("utf-8"), f"renewed by: python {__file__}"


def test_the_line_of_a_terminal_that_can_do_nothing_is_as_it_was_looked_at() -> None:
    assert line() == (FOLDER / "line.txt").read_text("utf-8")
    assert line().isascii()


@pytest.mark.parametrize("file", TERMINALS)
def test_a_capture_fits_its_terminal_and_nothing_is_told_by_colour_alone(file: str) -> None:
    width, height, _ = TERMINALS[file]
    text = (FOLDER / file).read_text("utf-8")
    frames = COLOUR.sub("", text).split("--- ")[1:]
    assert len(frames) == len(views())
    for frame in frames:
        _, *lines = frame.rstrip("\n").split("\n")
        assert len(lines) <= height and all(cell_len(each) <= width for each in lines)
    size = f"{width}x{height}.txt"
    assert COLOUR.sub("", text).replace(" ", "") == (FOLDER / size).read_text("utf-8").replace(" ", "")


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name in TERMINALS:
        (FOLDER / name).write_text(captured(name), "utf-8")
    (FOLDER / "line.txt").write_text(line(), "utf-8")
