"""The robot's side of the terminal: what keys do, and that the terminal's end stops the robot."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest
from ui_snapshots import full
from ui_tty import Tty

from tests.patience import S
from txt1.errors import CommandRefused, TerminalLost
from txt1.hal.base import Button
from txt1.sidecar import Request
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.terminal import Terminal

HERE = Path(__file__).parent
ROOT = HERE.parents[2]


class Running:
    """The fake robot with its terminal, on a real pty."""

    def __init__(self, log: Path, *arguments: str) -> None:
        self.tty = Tty()
        self.log = log
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "ui_fake_robot.py"), str(log), *arguments],
            stdin=self.tty.slave,
            stdout=self.tty.slave,
            start_new_session=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        self.tty.until(lambda: "set-point" in self.tty.text())

    def lines(self) -> list[str]:
        return self.log.read_text().splitlines()

    def until_log(self, line: str) -> None:
        self.tty.until(lambda: line in self.lines())

    def child(self) -> int:
        """The drawing process's id."""
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                parent = stat.read_text().rpartition(")")[2].split()[1]
            except OSError:  # it has just ended
                continue
            if int(parent) == self.process.pid:
                return int(stat.parent.name)
        raise AssertionError("no drawing process")

    def drive(self, until: Callable[[], object]) -> None:
        """Hold w until something is true."""
        self.tty.until(lambda: self.tty.type(b"w") or until())

    def rests(self) -> int:
        """Wait until nothing more is written down, and return how much there is."""
        lines, since = len(self.lines()), time.monotonic()

        def quiet() -> bool:
            nonlocal lines, since
            if len(self.lines()) > lines:
                lines, since = len(self.lines()), time.monotonic()
            return time.monotonic() > since + 0.4 * S

        self.tty.until(quiet)
        return lines

    def finish(self) -> None:
        self.tty.until(lambda: self.process.poll() is not None)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[object]:
    started: list[Running] = []

    def begin(*arguments: str) -> Running:
        started.append(Running(tmp_path / "log", *arguments))
        return started[-1]

    yield begin
    for running in started:
        running.process.kill()
        running.process.wait()
        running.tty.close()


def test_keys_reach_the_robot_and_q_leaves_the_terminal_as_it_was(start) -> None:  # type: ignore[no-untyped-def]
    running = start()
    running.tty.type(b"\x1b[Cc")
    # a key that the drawing process finds after it was held up arms nothing
    running.tty.until(lambda: running.tty.type(b"m") or "arm" in running.lines())
    running.tty.type(b" ")
    running.until_log("stop")
    running.drive(lambda: "command 0.50 0.00" in running.lines())
    head = running.lines()
    told = list(dict.fromkeys(line for line in head if line != "release"))
    assert told[:5] == ["press RIGHT", "press CENTRE", "arm", "tell not today", "stop"]
    running.tty.until(lambda: "[PWM]" in running.tty.text())
    running.until_log("release")  # the hold ends by itself
    running.tty.type(b"q")
    running.until_log("reason quit")
    running.finish()
    assert running.process.returncode == 0
    assert running.tty.restored()
    assert "disarm terminal lost" not in running.lines()


def test_a_hung_or_killed_drawing_process_stops_the_robot(start) -> None:  # type: ignore[no-untyped-def]
    running = start()
    running.drive(lambda: "command 0.50 0.00" in running.lines())
    child = running.child()

    # it hangs: no heartbeat, no command, whatever is typed
    os.kill(child, signal.SIGSTOP)
    silent = running.rests()
    ends = time.monotonic() + 0.4 * S
    running.drive(lambda: time.monotonic() > ends)
    assert len(running.lines()) == silent

    # it goes on
    os.kill(child, signal.SIGCONT)
    running.drive(lambda: len(running.lines()) > silent)

    # it dies
    os.kill(child, signal.SIGKILL)
    running.until_log("reason lost")
    running.finish()
    lines = running.lines()
    after = lines[lines.index("disarm terminal lost") :]
    assert not [line for line in after if line.startswith("command")]
    assert lines[-1] == "end"
    assert running.tty.restored()


def test_it_runs_in_virtual_time(start) -> None:  # type: ignore[no-untyped-def]
    running = start("20")
    running.tty.type(b"\x1b[C")
    running.tty.until(lambda: "[PWM]" in running.tty.text())
    os.kill(running.child(), signal.SIGTERM)
    running.until_log("reason lost")
    running.finish()
    assert running.tty.restored()


async def test_without_a_terminal_it_says_so() -> None:
    with pytest.raises(TerminalLost, match="--headless"):
        async with Terminal(Mock()):
            pass


@pytest.fixture
def robot() -> Mock:
    return Mock(snapshot=None, now=0.0)


@pytest.fixture
def terminal(robot: Mock) -> Terminal:
    return Terminal(robot, keys=robot)


def beat(terminal: Terminal, *keys: str, age: float = 0.01) -> None:
    """A heartbeat of the drawing process, with what was typed since the last."""
    terminal.request(Request("keys", {"keys": keys}, age))


def test_ten_snapshots_a_second_are_sent(terminal: Terminal, robot: Mock) -> None:
    sent = []
    for step in range(100):
        robot.now = 0.05 * step
        robot.snapshot = full(robot.now)
        line = terminal.telemetry()
        sent += [] if line is None else [Snapshot.decode(line).time]
    assert len(sent) == 50 and sent[-1] == pytest.approx(4.9, abs=0.06)


def test_a_command_is_renewed_by_heartbeats_and_by_nothing_else(terminal: Terminal, robot: Mock) -> None:
    beat(terminal, "w")
    assert robot.hold.call_count == 1
    beat(terminal)
    assert robot.hold.call_count == 2
    beat(terminal, age=0.6)
    assert robot.hold.call_count == 2, "from before a standstill"


def test_the_emergency_stop_lets_go_of_the_keys(terminal: Terminal, robot: Mock) -> None:
    beat(terminal, "w", "space")
    robot.stop.assert_called_once_with()
    beat(terminal)
    robot.hold.assert_not_called()


def test_a_key_pressed_while_stopped_does_not_drive_after_arming(terminal: Terminal, robot: Mock) -> None:
    beat(terminal, "space", "w")
    robot.hold.reset_mock()
    beat(terminal, "m")
    robot.arm.assert_called_once_with()
    beat(terminal)
    robot.hold.assert_not_called()


def test_keys_from_before_a_standstill_stop_but_do_not_drive(terminal: Terminal, robot: Mock) -> None:
    beat(terminal, "w", "m", "space", age=10.0)
    beat(terminal)
    robot.stop.assert_called_once_with()
    robot.arm.assert_not_called()
    robot.hold.assert_not_called()


def test_a_late_key_drives_a_simulation_whose_time_waits_for_the_computer(robot: Mock) -> None:
    robot.now = 3.0
    beat(Terminal(robot, keys=robot, waits=True), "w", age=10.0)
    robot.hold.assert_called_once_with(0.5, 0.0, 3.0)


def test_a_stop_of_all_from_before_a_standstill_is_a_stop_of_all(robot: Mock) -> None:
    beat(Terminal(robot, more={"x": robot.stop_all}), "x", age=10.0)
    robot.stop_all.assert_called_once_with()


def test_every_button_is_pressed(terminal: Terminal, robot: Mock) -> None:
    beat(terminal, "left", "right", "up", "down", "c")
    pressed = [call.args[0] for call in robot.press.call_args_list]
    assert pressed == [Button.LEFT, Button.RIGHT, Button.UP, Button.DOWN, Button.CENTRE]


def test_a_refusal_is_shown_once(terminal: Terminal, robot: Mock) -> None:
    robot.hold.side_effect = CommandRefused("manual mode")
    beat(terminal, "w")
    beat(terminal)
    robot.tell.assert_called_once_with("manual mode")


def test_ctrl_z_is_answered_and_suspends_nothing(terminal: Terminal, robot: Mock) -> None:
    beat(terminal, "ctrl-z")
    robot.tell.assert_called_once()
    assert "q quits" in robot.tell.call_args.args[0]


async def test_the_quit_key_ends_the_wait_and_drives_no_more(terminal: Terminal, robot: Mock) -> None:
    beat(terminal, "w", "q", "w")
    robot.hold.assert_not_called()
