"""The process that owns the terminal: ``python -m txt1.ui.drawing --fd N --interval S``.

`txt1.ui.terminal` starts it. It draws the newest snapshot it was sent and reports keys. Its 20 Hz lines are
also the heartbeat that keeps a command from the keyboard fresh: if this process hangs, dies, or waits for a
stalled connection, the lines cease and the robot stops. Nothing here can hold up the robot, which only ever
sends a snapshot when the previous one has been received.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import signal
import socket
import sys
from io import StringIO
from types import FrameType
from typing import Final

from rich.console import Console

from txt1.kernel.clock import RealClock, nanoseconds, seconds
from txt1.tasks.fields import Snapshot
from txt1.ui import frames, modes
from txt1.ui.keys import Keys
from txt1.ui.screens import render
from txt1.ui.view import View

TTY_IN: Final = 0
TTY_OUT: Final = 1

DRAW_INTERVAL: Final = 0.1
"""s between frames, unless a key asks for one."""

STALE: Final = 0.5
"""s after which a key that waited while this process was held up no longer drives or arms."""

STALE_KEYS: Final = frozenset("wasdm")

REPAINT: Final = 20
"""Every so many frames all lines are sent again, over what other programs may have written."""


class Link:
    """The socket to the robot's process: snapshots in, heartbeats out.

    Attributes:
        received: snapshots that arrived.

    """

    def __init__(self, link: socket.socket) -> None:
        self.socket = link
        self.received = 0
        self._tail = b""

    def newest(self) -> bytes | None:
        """The last of the lines that have arrived, None if none is complete yet.

        Raises:
            EOFError: the robot's process is gone.

        """
        chunk = self.socket.recv(1 << 18)
        if not chunk:
            raise EOFError
        *lines, self._tail = (self._tail + chunk).split(b"\n")
        self.received += len(lines)
        return lines[-1] if lines else None

    def beat(self, keys: list[str]) -> None:
        """Report keys, and that this process is alive."""
        self.socket.sendall(json.dumps({"keys": keys, "drawn": self.received}).encode() + b"\n")


class Painter:
    """Draws frames, and sends only the lines that differ from the last one."""

    def __init__(self) -> None:
        self._shown: list[str] = []
        self._size = (0, 0)
        self._frames = 0

    def resized(self) -> bool:
        """Whether the window is no longer the one that was drawn."""
        return window() != self._size

    def paint(self, snapshot: Snapshot | None, view: View) -> None:
        """Draw one frame."""
        size = width, height = window()
        console = Console(file=StringIO(), force_terminal=True, width=width, height=height, highlight=False)
        with console.capture() as capture:
            console.print(render(snapshot, view, width, height), end="")
        lines = capture.get().split("\n")[:height]
        output = []
        if size != self._size or self._frames % REPAINT == 0 or len(lines) != len(self._shown):
            self._shown = [""] * len(lines)
            output.append("\x1b[0m\x1b[2J" if size != self._size else "")
        for row, (line, shown) in enumerate(zip(lines, self._shown, strict=True), start=1):
            if line != shown:
                output.append(f"\x1b[{row};1H{line}")
        modes.write(TTY_OUT, "".join(output).encode("utf-8", "replace"))
        self._shown, self._size, self._frames = lines, size, self._frames + 1


def window() -> tuple[int, int]:
    """Columns and rows of the window; 80 x 24 if the terminal does not know."""
    size = os.get_terminal_size(TTY_OUT)
    return size.columns or 80, size.lines or 24


def run(link: Link, interval: float) -> None:
    """Draw and report keys until the robot's process or the terminal goes away."""
    keys, view, painter = Keys(), View(), Painter()
    line: bytes | None = None
    snapshot: Snapshot | None = None
    now = next_beat = next_frame = RealClock().now_ns()
    while True:
        wait = max(0.0, min(interval, seconds(next_beat - now), DRAW_INTERVAL))
        ready, _, _ = select.select([TTY_IN, link.socket.fileno()], [], [], wait)
        before, now = now, RealClock().now_ns()
        pressed: list[str] = []
        if TTY_IN in ready:
            data = os.read(TTY_IN, 4096)
            if not data:
                return
            pressed = keys.feed(data)
            if now - before > nanoseconds(STALE):
                pressed = [key for key in pressed if key not in STALE_KEYS]
        if pressed or now >= next_beat:  # a key, maybe the emergency stop, does not wait for the next beat
            link.beat([key for key in pressed if key != "?"])
            next_beat = now + nanoseconds(interval)
        if pressed.count("?") % 2:
            view.help = not view.help
        if link.socket.fileno() in ready:
            line = link.newest() or line
        if pressed or painter.resized() or (now >= next_frame and line is not None):
            if line is not None:
                snapshot, line = frames.decode(line), None
                view.follow(snapshot)
            painter.paint(snapshot, view)
            next_frame = now + nanoseconds(DRAW_INTERVAL)


def end(signum: int, _: FrameType | None) -> None:
    """End this process by way of every `finally`; once is enough."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    sys.exit(128 + signum)


def main() -> None:
    """Run the process."""
    parser = argparse.ArgumentParser(prog="txt1.ui.drawing", description="Draws the robot's screens; started by txt1.")
    parser.add_argument("--fd", type=int, required=True, help="socket to the robot's process")
    parser.add_argument("--interval", type=float, default=0.05, help="s between heartbeats")
    arguments = parser.parse_args()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the robot's process, which then closes the socket
    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGHUP, end)
    with socket.socket(fileno=arguments.fd) as link, modes.full_screen(TTY_IN, TTY_OUT):
        try:
            run(Link(link), arguments.interval)
        except (EOFError, ConnectionError):
            return  # the robot's process ended, in whatever way


if __name__ == "__main__":
    main()
