"""A terminal for tests: a real pty whose other end is a screen that can be read."""

from __future__ import annotations

import os
import pty
import select
import termios
import time
from collections.abc import Callable
from typing import Any

import pyte

from tests.patience import LIMIT


class Tty:
    """A pty of 80 x 24 cells; `slave` is what a program gets as its standard input and output."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        self.output = b""
        self.screen = pyte.Screen(80, 24)
        self._stream = pyte.ByteStream(self.screen)
        self.resize(80, 24)
        self.before = self.modes()

    def modes(self) -> list[Any]:
        return termios.tcgetattr(self.slave)

    def resize(self, columns: int, rows: int) -> None:
        termios.tcsetwinsize(self.slave, (rows, columns))
        self.screen.resize(rows, columns)

    def type(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def read(self, wait: float = 0.02) -> None:
        """Take what the program has written so far."""
        while select.select([self.master], [], [], wait)[0]:
            data = os.read(self.master, 65536)
            self.output += data
            self._stream.feed(data)
            wait = 0.0

    def text(self) -> str:
        self.read()
        return "\n".join(self.screen.display)

    def until(self, condition: Callable[[], object], limit: float = LIMIT) -> None:
        """Wait for a condition, taking output meanwhile."""
        ends = time.monotonic() + limit
        while not condition():
            assert time.monotonic() < ends, "\n".join(self.screen.display) + repr(self.output[-300:])
            self.read()

    def restored(self) -> bool:
        """Whether the terminal is as it was: modes, normal screen, cursor."""
        self.read()
        left = b"\x1b[?1049l" in self.output.rpartition(b"\x1b[?1049h")[2]
        visible = b"\x1b[?25h" in self.output.rpartition(b"\x1b[?25l")[2]
        return left and visible and self.modes() == self.before

    def close(self) -> None:
        os.close(self.master)
        os.close(self.slave)
