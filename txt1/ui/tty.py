"""The terminal: its modes and their restoration, and the decoding of its bytes into keys.

A terminal sends an arrow as ESC [ C or, in its application mode, ESC O C, in one piece or in several. A lone ESC, any
other sequence and any unknown key is dropped. It never takes the next key along, because that may be the space bar, the
emergency stop.
"""

import os
import re
import select
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

IN: Final = 0
OUT: Final = 1

# alternate screen, no cursor, cleared
ENTER: Final = b"\x1b[?1049h\x1b[?25l\x1b[2J"
# the screen as it was, until ENTER
BEHIND: Final = b"\x1b[0m\x1b[?1049l"
LEAVE: Final = b"\x1b[0m\x1b[2J\x1b[H\x1b[?25h\x1b[?1049l"
"""Colours off, cleared (after a resize tmux would leave the text), cursor, the earlier screen."""

# the result of termios.tcgetattr
Modes = list[Any]


def drawable() -> bool:
    """Return whether input and output are a terminal that can be drawn on, as one with TERM=dumb cannot."""
    return sys.stdin.isatty() and sys.stdout.isatty() and os.environ.get("TERM") != "dumb"


def saved() -> Modes:
    """Return the present modes of the terminal; raises OSError if input or output is no terminal."""
    if not os.isatty(OUT):
        raise OSError("standard output is no terminal")
    try:
        return termios.tcgetattr(IN)
    except termios.error as error:
        raise OSError(*error.args) from error


@contextmanager
def full_screen() -> Iterator[None]:
    """Take over the terminal for the block; afterwards, whatever happened, it is as before.

    Keys are read one by one and without echo. Ctrl-C still interrupts; Ctrl-Z does not suspend (a robot would go on
    without its program) and Ctrl-S does not freeze the screen. Raises OSError: input or output is no terminal.
    """
    before, modes = saved(), saved()
    modes[0] &= ~termios.IXON
    modes[3] &= ~(termios.ICANON | termios.ECHO)
    modes[6][termios.VMIN], modes[6][termios.VTIME] = 1, 0
    # _POSIX_VDISABLE on Linux
    modes[6][termios.VSUSP] = b"\x00"
    try:
        # keys typed before anything was visible are no commands
        termios.tcflush(IN, termios.TCIFLUSH)
        termios.tcsetattr(IN, termios.TCSANOW, modes)
        write(ENTER)
        yield
    finally:
        put_back(before, drawn_on=True)


def put_back(modes: Modes, drawn_on: bool) -> None:
    """Restore the terminal, and discard unread keys.

    It never waits for a terminal that is gone or stalled. Unread keys must not reach the shell.
    """
    with suppress(OSError):
        if drawn_on and select.select([], [OUT], [], 0.1)[1]:
            os.write(OUT, LEAVE)
    with suppress(OSError, termios.error):
        termios.tcflush(IN, termios.TCIFLUSH)
        termios.tcsetattr(IN, termios.TCSANOW, modes)


def write(data: bytes) -> None:
    """Write everything, waiting for a slow terminal."""
    while data:
        data = data[os.write(OUT, data) :]


_ARROWS: Final = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
_PLAIN: Final = {
    **{bytes([code]): chr(code) for code in b"cmq?wasd+-ebrnxp"},
    # caps lock must not disable the keyboard
    **{bytes([code]): chr(code).lower() for code in b"CMQWASDEBRNXP"},
    b" ": "space",
    b"=": "+",
    b"_": "-",
    b"\x1a": "ctrl-z",
}

_PARAMETERS: Final = rb"[0-9;:<=>?]{0,16}"
_TOKEN: Final = re.compile(
    # a function key of the Linux console
    rb"\x1b\[\[[A-E]"
    rb"|\x1b\[" + _PARAMETERS + rb"([@-Z\\-~])"
    rb"|\x1bO([@-~])"
    rb"|(.)",
    re.DOTALL,
)
_UNFINISHED: Final = re.compile(rb"\x1b(O|\[\[|\[" + _PARAMETERS + rb")?\Z")


class KeyDecoder:
    """Decodes key presses."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[str]:
        """Return the names of the keys in `data`, in order; an unfinished sequence waits for the next call."""
        data = self._rest + data
        unfinished = _UNFINISHED.search(data)
        end = unfinished.start() if unfinished else len(data)
        self._rest = data[end:]
        tokens = (match.groups() for match in _TOKEN.finditer(data, 0, end))
        names = (_PLAIN.get(plain) if plain else _ARROWS.get(csi or ss3 or b"") for csi, ss3, plain in tokens)
        return [name for name in names if name is not None]
