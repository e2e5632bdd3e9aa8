"""Bytes from a terminal in, names of keys out; no I/O.

A terminal sends an arrow as ESC [ C or, in its application mode, ESC O C, in one piece or in several. A
lone ESC, any other sequence and whatever is not one of our keys is dropped, and never takes the key behind
it along: the space bar is the emergency stop.
"""

from __future__ import annotations

import re
from typing import Final

_ARROWS: Final = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
_PLAIN: Final = {
    **{bytes([code]): chr(code) for code in b"cmq?wasd+-"},
    **{bytes([code]): chr(code).lower() for code in b"CMQWASD"},  # caps lock must not disable the keyboard
    b" ": "space",
    b"=": "+",
    b"_": "-",
    b"\x1a": "ctrl-z",
}

_PARAMETERS: Final = rb"[0-9;:<=>?]{0,16}"
_TOKEN: Final = re.compile(
    rb"\x1b\[\[[A-E]"  # a function key of the Linux console
    rb"|\x1b\[" + _PARAMETERS + rb"([@-Z\\-~])"
    rb"|\x1bO([@-~])"
    rb"|(.)",
    re.DOTALL,
)
_UNFINISHED: Final = re.compile(rb"\x1b(O|\[\[|\[" + _PARAMETERS + rb")?\Z")


class Keys:
    """A decoder of key presses."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[str]:
        """The names of the keys in `data`, in order; an unfinished sequence waits for the next call."""
        data = self._rest + data
        unfinished = _UNFINISHED.search(data)
        end = unfinished.start() if unfinished else len(data)
        self._rest = data[end:]
        tokens = (match.groups() for match in _TOKEN.finditer(data, 0, end))
        names = (_PLAIN.get(plain) if plain else _ARROWS.get(csi or ss3 or b"") for csi, ss3, plain in tokens)
        return [name for name in names if name is not None]
