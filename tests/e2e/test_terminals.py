"""The program in real terminals of several kinds, as a process of its own."""

import re
import signal
from pathlib import Path

import pexpect
import pytest

from rigs.terminals import Watched, start

RUN = ("run", "--seed", "1", "--drive", "0.3,0.5")  # a circle that meets no wall, however long it lasts


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
    states = 0
    # events have lines of their own
    while states < 2:
        child.expect(rb"[^\n]*\n")
        assert child.after.startswith(b"t=") and b"\x1b" not in child.after
        states += b" x=" in child.after
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
