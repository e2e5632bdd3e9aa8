"""The robot's side of the terminal: what keys do, and that the terminal's end stops the robot."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest
from ui_snapshots import full
from ui_tty import Tty

from txt1.errors import CommandRefused, TerminalLost
from txt1.hal.base import Button
from txt1.ui import terminal as module
from txt1.ui.frames import decode
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

    def drive(self, seconds: float) -> None:
        """Hold w."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.tty.type(b"w")
            self.tty.read(0.05)

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
    running.tty.type(b"\x1b[Ccm w")
    running.until_log("command 0.50 0.00")
    head = running.lines()
    assert head[:5] == ["press RIGHT", "press CENTRE", "arm", "tell not today", "stop"]
    running.tty.until(lambda: "[PWM]" in running.tty.text())
    running.until_log("command 0.00 0.00")  # the hold ends by itself
    running.tty.type(b"q")
    running.until_log("reason quit")
    running.finish()
    assert running.process.returncode == 0
    assert running.tty.restored()
    assert "disarm terminal lost" not in running.lines()


def test_a_hung_or_killed_drawing_process_stops_the_robot(start) -> None:  # type: ignore[no-untyped-def]
    running = start()
    running.drive(0.2)
    running.until_log("command 0.50 0.00")
    child = running.child()

    # it hangs: no heartbeat, no command, whatever is typed
    os.kill(child, signal.SIGSTOP)
    time.sleep(0.2)  # what is on its way arrives
    silent = len(running.lines())
    running.drive(0.4)
    assert len(running.lines()) == silent

    # it goes on
    os.kill(child, signal.SIGCONT)
    running.drive(0.2)
    running.tty.until(lambda: len(running.lines()) > silent)

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


class Peer:
    """This test in the place of the drawing process."""

    def __init__(self, terminal: Terminal, robot: Mock, link: socket.socket) -> None:
        self.terminal, self.robot, self.link = terminal, robot, link

    async def beat(self, *keys: str, drawn: int = 0, times: int = 1) -> None:
        line = json.dumps({"keys": keys, "drawn": drawn}).encode() + b"\n"
        await self.send(line * times)

    async def send(self, data: bytes) -> None:
        self.link.sendall(data)
        for _ in range(20):
            await asyncio.sleep(0)

    def received(self) -> bytes:
        try:
            return self.link.recv(1 << 20)
        except BlockingIOError:
            return b""


@pytest.fixture
async def peer(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Peer]:
    ends: list[socket.socket] = []

    def start(fd: int, beat: float) -> Mock:
        ends.append(socket.socket(fileno=os.dup(fd)))
        ends[0].setblocking(False)
        return Mock()

    monkeypatch.setattr(module, "_start_drawing", start)
    monkeypatch.setattr(module, "_end_drawing", lambda child, saved: None)
    monkeypatch.setattr(module.modes, "saved", lambda *_: [])
    robot = Mock(snapshot=None, now=0.0)
    async with Terminal(robot) as terminal:
        yield Peer(terminal, robot, ends[0])
    ends[0].close()


async def test_a_snapshot_is_sent_only_when_the_last_one_arrived(peer: Peer) -> None:
    await peer.beat()
    assert peer.received() == b""
    peer.robot.snapshot = full(1.0)
    await peer.beat(drawn=0)
    assert decode(peer.received()).time == 1.0
    for second in range(2, 50):
        peer.robot.snapshot = full(float(second))
        await peer.beat(drawn=0)
    assert peer.received() == b""
    await peer.beat(drawn=1)
    assert decode(peer.received()).time == 49.0
    await peer.beat(drawn=2)
    assert peer.received() == b"", "the same snapshot is not sent twice"


async def test_a_viewer_that_reads_nothing_costs_the_robot_nothing(peer: Peer) -> None:
    peer.robot.snapshot = full(1.0)._replace(reason="x" * 3_000_000)
    await peer.beat(drawn=0)
    for _ in range(50):
        await peer.beat(drawn=0)
    assert len(peer.terminal._unsent) < 3_100_000
    data = b""
    while not data.endswith(b"\n"):
        data += peer.received()
        await peer.beat(drawn=0)
    assert decode(data) == peer.robot.snapshot


async def test_a_command_is_renewed_by_heartbeats_and_by_nothing_else(peer: Peer) -> None:
    await peer.beat("w")
    assert peer.robot.command.call_count == 1
    await asyncio.sleep(0.2)
    assert peer.robot.command.call_count == 1
    await peer.beat()
    assert peer.robot.command.call_count == 2


async def test_the_emergency_stop_lets_go_of_the_keys(peer: Peer) -> None:
    await peer.beat("w", "space")
    peer.robot.stop.assert_called_once_with()
    await peer.beat()
    peer.robot.command.assert_not_called()


async def test_a_key_pressed_while_stopped_does_not_drive_after_arming(peer: Peer) -> None:
    await peer.beat("space", "w")
    peer.robot.command.reset_mock()
    await peer.beat("m")
    peer.robot.arm.assert_called_once_with()
    await peer.beat()
    peer.robot.command.assert_not_called()


async def test_keys_from_before_a_standstill_stop_but_do_not_drive(peer: Peer) -> None:
    old = json.dumps({"keys": ["w", "m", "space"], "drawn": 0}).encode() + b"\n"
    beats = json.dumps({"keys": [], "drawn": 0}).encode() + b"\n"
    await peer.send(old + beats * 200)
    peer.robot.stop.assert_called_once_with()
    peer.robot.arm.assert_not_called()
    peer.robot.command.assert_not_called()


async def test_every_button_is_pressed(peer: Peer) -> None:
    await peer.beat("left", "right", "up", "down", "c")
    pressed = [call.args[0] for call in peer.robot.press.call_args_list]
    assert pressed == [Button.LEFT, Button.RIGHT, Button.UP, Button.DOWN, Button.CENTRE]


async def test_a_refusal_is_shown_once(peer: Peer) -> None:
    peer.robot.command.side_effect = CommandRefused("manual mode")
    await peer.beat("w")
    await peer.beat()
    peer.robot.tell.assert_called_once_with("manual mode")


async def test_a_bug_in_the_robot_reaches_the_user(peer: Peer) -> None:
    peer.robot.stop.side_effect = ZeroDivisionError("bug")
    await peer.beat("space")
    with pytest.raises(ZeroDivisionError, match="bug"):
        await peer.terminal.wait()


async def test_the_end_of_the_stream_disarms(peer: Peer) -> None:
    await peer.beat("w")
    peer.link.close()
    assert await asyncio.wait_for(peer.terminal.wait(), 5.0) == "lost"
    peer.robot.disarm.assert_called_once_with("terminal lost")
    assert peer.robot.command.call_count == 1


async def test_half_a_heartbeat_waits_for_its_other_half(peer: Peer) -> None:
    await peer.send(b'{"keys": ["spa')
    peer.robot.stop.assert_not_called()
    await peer.send(b'ce"], "drawn": 0}\n')
    peer.robot.stop.assert_called_once_with()
