"""Performs a command of ``txt1`` in a worker of its own, in virtual time, such as ``replay --verify FILE``."""

from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import TextIOBase
from typing import TextIO, cast

from txt1.cli import execute
from txt1.kernel import loop
from txt1_browser.event_loops import BrowserVirtualLoop


class _Lines(TextIOBase):
    """A file that tells each line."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell, self._begun = tell, ""

    def write(self, text: str) -> int:
        """Tell the lines that are complete."""
        *lines, self._begun = (self._begun + text).replace("\r", "\n").split("\n")
        for each in filter(str.strip, lines):
            self._tell(each)
        return len(text)


def perform(words: Sequence[str], tell: Callable[[str], None]) -> int:
    """Perform a command to its end, telling the lines that it prints; return its exit code."""
    # who makes a loop in virtual time gets one that opens no sockets
    loop.VirtualTimeLoop = BrowserVirtualLoop  # type: ignore[misc]
    lines = cast("TextIO", _Lines(tell))
    with redirect_stdout(lines), redirect_stderr(lines):
        return execute(list(words))
