"""Keys from a terminal's bytes."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.board import command as board
from txt1.fleet import console, selection
from txt1.record import player as replay
from txt1.ui.tty import KeyDecoder
from txt1.ui.viewer import DRIVING


@pytest.mark.parametrize(
    ("data", "names"),
    [
        (b"\x1b[A\x1b[B\x1b[C\x1b[D", ["up", "down", "right", "left"]),
        (b"\x1bOA\x1bOB\x1bOC\x1bOD", ["up", "down", "right", "left"]),
        (b"\x1b[1;5C", ["right"]),
        (b" cmq?wasd+-", ["space", "c", "m", "q", "?", "w", "a", "s", "d", "+", "-"]),
        (b"\x1a", ["ctrl-z"]),
        (b"WM=", ["w", "m", "+"]),
        (b"\x1b[5~\x1b[15~\x1bOP", []),
        ("äöü€🤖".encode(), []),
        (b"\xff\xfe\x80\x00\x01", []),
        (b"nxNX", ["n", "x", "n", "x"]),
        (b"tyz\r\n\t", []),
    ],
)
def test_names(data: bytes, names: list[str]) -> None:
    assert KeyDecoder().feed(data) == names


@pytest.mark.parametrize("before", [b"\x1b", b"\x1b[", b"\x1b[1;", b"\x1bO", b"\xe2\x82", b"\x1b\x1b", b"\x1b[[A"])
def test_nothing_swallows_the_emergency_stop(before: bytes) -> None:
    together, apart = KeyDecoder(), KeyDecoder()
    assert together.feed(before + b" ") == ["space"]
    assert apart.feed(before) + apart.feed(b" ") == ["space"]


@given(st.binary(max_size=200), st.data())
def test_how_the_bytes_are_cut_does_not_matter(data: bytes, draw: st.DataObject) -> None:
    whole = KeyDecoder().feed(data + b"q")
    cut = draw.draw(st.integers(0, len(data)))
    keys = KeyDecoder()
    assert keys.feed(data[:cut]) + keys.feed(data[cut:] + b"q") == whole


@pytest.mark.parametrize("shown", [DRIVING, board.SHOWN, replay.KEYS, selection.KEYS, console.KEYS, {"x": "stop all"}])
def test_every_key_that_a_footer_names_is_understood(shown: Mapping[str, str]) -> None:
    for key in shown:
        typed = [each for each in key.replace(" ", "") if each.isascii()]
        assert key.lower() == "space" or KeyDecoder().feed("".join(typed).encode()) == typed
