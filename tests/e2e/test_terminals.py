"""The program in real terminals of several kinds, as a process of its own."""

import os
import re
import sys
from pathlib import Path

import pexpect
import pyte
import pytest

ROOT = Path(__file__).parents[2]
RUN = ["-m", "txt1", "run", "--seed", "1", "--drive", "0.3,0.2"]


def start(columns: int, rows: int, duration: float, **environment: str) -> "pexpect.spawn[bytes]":
    """The program on a terminal of that size."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("TXT1_", "LC_", "LANG"))}
    return pexpect.spawn(
        sys.executable, [*RUN, "--duration", str(duration)], dimensions=(rows, columns), timeout=20.0,
        env=clean | {"PYTHONPATH": str(ROOT), "TERM": "xterm-256color"} | environment, cwd=str(ROOT),
    )  # fmt: skip


@pytest.mark.parametrize("environment", [{"NO_COLOR": "1", "LC_ALL": "C"}, pytest.param({}, marks=pytest.mark.long)])
def test_a_small_window_that_grows_shows_everything_again(environment: dict[str, str]) -> None:
    screen, told = pyte.Screen(60, 20), b""
    stream = pyte.ByteStream(screen)
    child = start(60, 20, 4.0, **environment)

    def until(*words: str) -> None:
        nonlocal told
        while not all(word in "\n".join(screen.display) for word in words):
            told += (new := child.read_nonblocking(65536, timeout=20.0))
            stream.feed(new)

    until("ARMED", "1/8 [STATUS]", "set-point")
    child.setwinsize(50, 200)
    screen.resize(50, 200)
    until("[STATUS] PWM", "set-point", "MAP ─")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus in (0, 3)  # disarmed, where the machine is too busy for 50 Hz
    coloured = re.search(rb"\x1b\[(?:[\d;]*;)?(?:3[0-8]|9[0-7])(?:;[\d;]*)?m", told)
    assert (coloured is None) == ("NO_COLOR" in environment)


def test_a_dumb_terminal_gets_a_line_a_second_and_no_sequences() -> None:
    child = start(80, 24, 1.5, TERM="dumb")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus in (0, 3)  # disarmed, where the machine is too busy for 50 Hz
    lines = child.before.decode().splitlines()
    assert len(lines) >= 2
    assert lines[0].startswith("t=") and " x=" in lines[0]
