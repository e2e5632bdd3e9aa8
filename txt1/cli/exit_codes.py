"""The exit codes of every command.

0 all went as asked, or the reader of the output had enough of it; 1 a fault of the hardware, a task, the terminal or a
damaged file; 2 a mistake in the command line or the configuration, or a file that is not there; 3 the safety gate
disarmed the robot; 128 + n ended by signal n (SIGHUP 129, Ctrl-C 130, SIGTERM 143), outputs neutral.
"""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

OK: Final = 0
FAULT: Final = 1
USAGE: Final = 2
DISARMED: Final = 3

SIGNALS: Final = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
"""They end every command."""

EPILOG: Final = (
    "Exit codes: 0 as asked, 1 fault, 2 mistake in command line or configuration or a file that is not there, "
    "3 the safety gate disarmed the robot, 129/130/143 ended by SIGHUP/SIGINT/SIGTERM."
)


@contextmanager
def signals_to(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Within the block the signals that end a command go to `handler` alone."""
    before = {each: signal.signal(each, handler) for each in SIGNALS}
    try:
        yield
    finally:
        for each, former in before.items():
            signal.signal(each, former)
