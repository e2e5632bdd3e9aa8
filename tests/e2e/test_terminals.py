"""The program in real terminals of several kinds, as a process of its own."""

import os
import re
import signal
from pathlib import Path

import pexpect
import pyte
import pytest

from tests.patience import LIMIT, TXT1

ROOT = Path(__file__).parents[2]
RUN = ("run", "--seed", "1", "--drive", "0.3,0.5")  # a circle that meets no wall, however long it lasts


def start(columns: int, rows: int, *words: str, **environment: str) -> "pexpect.spawn[bytes]":
    """A command on a terminal of that size."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("TXT1_", "LC_", "LANG"))}
    return pexpect.spawn(
        TXT1[0],
        [*TXT1[1:], *words],
        dimensions=(rows, columns),
        timeout=LIMIT,
        env=clean | {"PYTHONPATH": str(ROOT), "TERM": "xterm-256color"} | environment,
        cwd=str(ROOT),
    )


class Watched:
    """The screen that a command draws, and all that it was told."""

    def __init__(self, child: "pexpect.spawn[bytes]", columns: int, rows: int) -> None:
        self.child, self.screen, self.told = child, pyte.Screen(columns, rows), b""
        self._stream = pyte.ByteStream(self.screen)

    def until(self, *words: str) -> None:
        """Wait until all these words are on it."""
        while not all(word in "\n".join(self.screen.display) for word in words):
            self.told += (new := self.child.read_nonblocking(65536, timeout=LIMIT))
            self._stream.feed(new)


@pytest.mark.parametrize("environment", [{"NO_COLOR": "1", "LC_ALL": "C"}, pytest.param({}, marks=pytest.mark.long)])
def test_a_small_window_that_grows_shows_everything_again(environment: dict[str, str]) -> None:
    child = start(60, 20, *RUN, **environment)
    watched = Watched(child, 60, 20)
    watched.until("ARMED", "1/8 [STATUS]", "set-point")
    child.setwinsize(50, 200)
    watched.screen.resize(50, 200)
    watched.until("[STATUS] PWM", "set-point", "MAP ─")
    child.send(b"q")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0
    coloured = re.search(rb"\x1b\[(?:[\d;]*;)?(?:3[0-8]|9[0-7])(?:;[\d;]*)?m", watched.told)
    assert (coloured is None) == ("NO_COLOR" in environment)


def test_the_next_robot_of_a_fleet_is_a_key_away() -> None:
    child = start(80, 24, "fleet", "--robots", "2", "--seed", "1")
    watched = Watched(child, 80, 24)
    watched.until("TXT-1  txt01", "n next robot")
    child.send(b"n")
    watched.until("TXT-1  txt02")
    child.send(b"q")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0


def test_a_dumb_terminal_gets_a_line_a_second_and_no_sequences() -> None:
    child = start(80, 24, *RUN, TERM="dumb")
    for _ in range(2):
        child.expect(rb"[^\n]*\n")
        assert child.after.startswith(b"t=") and b" x=" in child.after and b"\x1b" not in child.after
    child.kill(signal.SIGINT)
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 130


@pytest.mark.long
def test_a_recording_on_a_dumb_terminal_is_told_in_lines(tmp_path: Path) -> None:
    log = str(tmp_path / "run.mcap")
    child = start(80, 24, *RUN, "--duration", "3", "--headless", "--speed", "max", "--log", log)
    child.expect(pexpect.EOF)
    child = start(80, 24, "replay", log, "--speed", "30", TERM="dumb")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0
    assert b"\x1b" not in child.before and child.before.startswith(b"t=")
