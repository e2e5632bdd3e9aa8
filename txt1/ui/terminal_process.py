"""The process that owns the terminal: draws the newest snapshot it was sent and reports keys.

`txt1.ui.terminal` starts it. Its heartbeat keeps a command from the keyboard fresh: if this process hangs, dies, or
waits for a stalled connection, the heartbeat ceases and the robot stops. Nothing in this process can delay the robot.
"""

import os
import select
from collections.abc import Mapping
from contextlib import suppress
from io import StringIO
from itertools import zip_longest
from typing import Any, Final

from rich.console import Console

from txt1.kernel.clock import RealClock, nanoseconds
from txt1.sidecar import Connection
from txt1.telemetry.snapshot import Snapshot
from txt1.ui import tty
from txt1.ui.screens import installed, render
from txt1.ui.viewer import DRIVING, Viewer

# s between frames, unless a key asks for one
DRAW_INTERVAL: Final = 0.1
# s after which a key that waited while this process was delayed no longer drives or arms
STALE_KEY_AGE: Final = 0.5
STALE_KEYS: Final = frozenset("wasdm")

# the key that shows the text printed before the screens; any other key comes back to the screens
PRINTED: Final = "p"

# number of frames after which all lines are sent again, in case another program has written over them
REPAINT: Final = 20


def drawn(snapshot: Snapshot | None, viewer: Viewer, width: int, height: int) -> list[str]:
    """Return the lines of a frame with the colours that TERM and NO_COLOR allow."""
    console = Console(file=StringIO(), force_terminal=True, width=width, height=height, highlight=False)
    with console.capture() as capture:
        # it fits
        console.print(render(snapshot, viewer, width, height), end="", crop=False)
    return capture.get().split("\n")[:height]


class Painter:
    """Draws frames, and sends only lines that differ from the last frame."""

    def __init__(self) -> None:
        self._shown: list[str] = []
        self.size = (0, 0)
        self._frames = 0

    def paint(self, snapshot: Snapshot | None, viewer: Viewer) -> None:
        """Draw a frame."""
        size = width, height = window()
        lines = drawn(snapshot, viewer, width, height)
        output = "\x1b[0m\x1b[2J" if size != self.size else ""
        repaint = size != self.size or self._frames % REPAINT == 0
        for row, (line, shown) in enumerate(zip_longest(lines, self._shown), start=1):
            if line is not None and (repaint or line != shown):
                output += f"\x1b[{row};1H{line}"
        tty.write(output.encode("utf-8", "replace"))
        self._shown, self.size, self._frames = lines, size, self._frames + 1


def window() -> tuple[int, int]:
    """Return columns and rows of the window; 80 x 24 if the terminal does not know them."""
    size = os.get_terminal_size(tty.OUT)
    return size.columns or 80, size.lines or 24


def main(connection: Connection, keys: Mapping[str, str] | None = None, waits: bool = False) -> None:
    """Draw and report keys until the terminal goes away; `keys` are the keys to show.

    `waits`: a simulation, whose time waits for a busy computer, gets every key, however late.
    Raises EOFError when the robot's process has gone.
    """
    decoder, painter, viewer = tty.KeyDecoder(), Painter(), Viewer(keys or DRIVING)
    line: bytes | None = None
    snapshot: Snapshot | None = None
    waited_for: list[Any] = [tty.IN, connection]
    now = next_frame = RealClock().now_ns()
    # whether the text printed before the screens is shown in their place
    behind = False
    for screen in installed().values():
        # the help is drawn when the screen is shown
        with suppress(Exception):
            # not at that time: there is no heartbeat while something is loaded
            screen.load()
    with tty.full_screen():
        while True:
            ready, _, _ = select.select(waited_for, [], [], min(connection.due(), DRAW_INTERVAL))
            before, now = now, RealClock().now_ns()
            pressed: list[str] = []
            if tty.IN in ready:
                data = os.read(tty.IN, 4096)
                if not data:
                    return
                stale = STALE_KEYS if now - before > nanoseconds(STALE_KEY_AGE) and not waits else ()
                pressed = [key for key in decoder.feed(data) if key not in stale]
            # a key may be the emergency stop, so it does not wait for the next heartbeat
            if pressed or connection.due() <= 0.0:
                connection.request("keys", keys=[key for key in pressed if key != "?"])
            if pressed.count("?") % 2:
                viewer.help = not viewer.help
            was_behind = behind
            for key in pressed:
                behind = key == PRINTED and not behind
            if behind != was_behind:
                tty.write(tty.BEHIND if behind else tty.ENTER)
                # all lines are drawn again
                painter.size = (0, 0)
            if connection in ready:
                line = connection.newest() or line
            if not behind and (pressed or window() != painter.size or (now >= next_frame and line is not None)):
                if line is not None:
                    snapshot, line = Snapshot.decode(line), None
                    viewer.follow(snapshot)
                painter.paint(snapshot, viewer)
                next_frame = now + nanoseconds(DRAW_INTERVAL)
