"""The terminal's modes: key by key instead of line by line, the alternate screen, and back again."""

from __future__ import annotations

import os
import select
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

IN: Final = 0
OUT: Final = 1

ENTER: Final = b"\x1b[?1049h\x1b[?25l\x1b[2J"
"""Alternate screen, no cursor, cleared."""

LEAVE: Final = b"\x1b[0m\x1b[2J\x1b[H\x1b[?25h\x1b[?1049l"
"""Colours off, cleared (after a resize tmux would leave the text behind), cursor, the screen as it was."""

Modes = list[Any]
"""What termios.tcgetattr returns."""


def saved(tty_in: int, tty_out: int) -> Modes:
    """The modes of a terminal as they are.

    Raises:
        OSError: one of the two is no terminal.

    """
    if not os.isatty(tty_out):
        raise OSError("standard output is no terminal")
    try:
        return termios.tcgetattr(tty_in)
    except termios.error as error:
        raise OSError(*error.args) from error


def key_by_key(modes: Modes) -> Modes:
    """The modes for reading keys: no line editing and no echo; Ctrl-C still interrupts.

    Ctrl-Z does not suspend (a robot would go on without its program) and Ctrl-S does not freeze the screen.
    """
    iflag, oflag, cflag, lflag, ispeed, ospeed, characters = modes
    characters = list(characters)
    characters[termios.VMIN], characters[termios.VTIME] = 1, 0
    characters[termios.VSUSP] = b"\x00"  # _POSIX_VDISABLE on Linux
    return [
        iflag & ~termios.IXON,
        oflag,
        cflag,
        lflag & ~(termios.ICANON | termios.ECHO),
        ispeed,
        ospeed,
        characters,
    ]


@contextmanager
def full_screen(tty_in: int, tty_out: int) -> Iterator[None]:
    """Within it the terminal is ours; behind it, whatever happened, it is as it was.

    Raises:
        OSError: one of the two is no terminal.

    """
    before = saved(tty_in, tty_out)
    try:
        # what was typed before there was anything to see is no command
        termios.tcflush(tty_in, termios.TCIFLUSH)
        termios.tcsetattr(tty_in, termios.TCSANOW, key_by_key(before))
        write(tty_out, ENTER)
        yield
    finally:
        leave_screen(tty_out)
        restore(tty_in, before)


def leave_screen(tty_out: int) -> None:
    """Back to the normal screen with its cursor; gives up on a terminal that is gone or stalled."""
    with suppress(OSError):
        if select.select([], [tty_out], [], 0.1)[1]:
            os.write(tty_out, LEAVE)


def restore(tty_in: int, modes: Modes) -> None:
    """Set the modes and drop unread keys, which were not meant for the shell; never waits for output."""
    with suppress(OSError, termios.error):
        termios.tcflush(tty_in, termios.TCIFLUSH)
        termios.tcsetattr(tty_in, termios.TCSANOW, modes)


def put_back(modes: Modes, killed: bool) -> None:
    """Put the terminal back behind a process that was drawing on it, also when it was killed over it."""
    if killed:
        leave_screen(OUT)
    restore(IN, modes)


def write(fd: int, data: bytes) -> None:
    """Write everything, waiting for a slow terminal."""
    while data:
        data = data[os.write(fd, data) :]
