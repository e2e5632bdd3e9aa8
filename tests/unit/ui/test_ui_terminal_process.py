"""The drawing process on a real pty, with this test as the robot's process."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ui_snapshots import full
from ui_tty import Tty

from tests.patience import LIMIT
from txt1.telemetry.snapshot import Snapshot
from txt1.ui.terminal_process import STALE_KEY_AGE

ROOT = Path(__file__).parents[3]


class Drawing:
    """A running drawing process."""

    def __init__(self, **options: object) -> None:
        self.tty, self.options = Tty(), options
        self.link, theirs = socket.socketpair()
        self.link.settimeout(LIMIT)
        with theirs:
            self.process = subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "txt1.sidecar",
                    str(theirs.fileno()),
                    "txt1.ui.terminal_process:main",
                    "0.02",
                    json.dumps(options),
                ],
                stdin=self.tty.slave,
                stdout=self.tty.slave,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
                cwd=ROOT,
            )
        self._lines = self.link.makefile("rb")
        self.beat()

    def beat(self) -> dict[str, Any]:
        heartbeat: dict[str, Any] = json.loads(self._lines.readline())
        return heartbeat

    def show(self, snapshot: Snapshot) -> None:
        self.link.sendall(snapshot.encode())

    def keys(self, wanted: int) -> list[str]:
        """The next so many keys that are reported."""
        keys: list[str] = []
        while len(keys) < wanted:
            keys += self.beat()["keys"]
        return keys

    def hang_up(self) -> None:
        self._lines.close()
        self.link.close()

    def wait(self) -> int:
        """The exit code."""
        self.tty.until(lambda: self.process.poll() is not None)
        return int(self.process.returncode)


@pytest.fixture
def drawing(request: pytest.FixtureRequest) -> Iterator[Drawing]:
    running = Drawing(**getattr(request, "param", {}))
    yield running
    running.hang_up()
    running.process.kill()
    running.process.wait()
    running.tty.close()


def test_it_draws_reports_keys_and_acknowledges(drawing: Drawing) -> None:
    tty = drawing.tty
    tty.until(lambda: "waiting for the robot" in tty.text())
    assert tty.modes() != tty.before
    drawing.show(full(screen=0))
    tty.until(lambda: "set-point" in tty.text() and "ARMED" in tty.text())
    while drawing.beat()["received"] != 1:
        pass
    tty.type(b"\x1b[C\x1bOD\x1b\xc3\xa4 ")
    assert drawing.keys(3) == ["right", "left", "space"]
    tty.type(b"wasd+-mcq" * 50)
    assert drawing.keys(450) == list("wasd+-mcq") * 50

    # help is the viewer's business: the robot never hears of it
    tty.type(b"?")
    tty.until(lambda: "HELP" in tty.text())
    tty.type(b"?w")
    tty.until(lambda: "HELP" not in tty.text())
    assert drawing.keys(1) == ["w"]

    # only the newest of many snapshots matters
    for second in range(100, 200):
        drawing.show(full(float(second)))
    tty.until(lambda: "0:03:19.0" in tty.text())
    while drawing.beat()["received"] != 101:
        pass

    tty.resize(120, 40)
    tty.until(lambda: "quit" in tty.text().split("\n")[39])
    assert all(len(line) <= 120 for line in tty.text().split("\n"))

    # Ctrl-C is the robot's: here the process only has to survive it
    os.kill(drawing.process.pid, signal.SIGINT)
    tty.type(b"m")
    assert drawing.keys(1) == ["m"]

    drawing.hang_up()
    assert drawing.wait() == 0
    assert tty.restored()


@pytest.mark.parametrize("drawing", [{}, {"waits": True}], indirect=True, ids=["robot", "simulation"])
def test_a_key_typed_while_it_was_held_up_drives_a_simulation_alone(drawing: Drawing) -> None:
    os.kill(drawing.process.pid, signal.SIGSTOP)
    drawing.tty.type(b"w ")
    time.sleep(2.0 * STALE_KEY_AGE)
    os.kill(drawing.process.pid, signal.SIGCONT)
    assert drawing.keys(1) == (["w", "space"] if drawing.options else ["space"])


def test_p_shows_what_was_printed_before_the_screens_until_the_next_key(drawing: Drawing) -> None:
    tty, away = drawing.tty, b"\x1b[?1049l"
    drawing.show(full(screen=0))
    tty.until(lambda: "set-point" in tty.text())
    tty.type(b"p")
    assert drawing.keys(1) == ["p"]
    tty.until(lambda: tty.output.endswith(away))
    drawing.show(full(1.0))  # is not drawn: it would cover the text
    while drawing.beat()["received"] != 2:
        pass
    tty.read(0.2)
    assert tty.output.endswith(away)
    tty.type(b" ")  # stops the robot, as always, and brings the screens back
    assert drawing.keys(1) == ["space"]
    tty.until(lambda: b"set-point" in tty.output.rpartition(away)[2])


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_restores_the_terminal(drawing: Drawing, number: signal.Signals) -> None:
    drawing.tty.until(lambda: "waiting" in drawing.tty.text())
    drawing.process.send_signal(number)
    assert drawing.wait() == 128 + number
    assert drawing.tty.restored()


def test_a_line_that_is_no_snapshot_ends_it_with_the_terminal_restored(drawing: Drawing) -> None:
    drawing.tty.until(lambda: "waiting" in drawing.tty.text())
    drawing.link.sendall(b"[]\n")
    assert drawing.wait() == 1
    assert drawing.tty.restored()


def test_the_screens_load_nothing_that_would_hold_up_the_heartbeat() -> None:
    code = (
        "import sys; from txt1.ui import terminal_process, screens;"
        "[screen.load() for screen in screens.installed().values()];"
        "sys.exit(', '.join({'numpy', 'pydantic', 'mcap', 'matplotlib'} & sys.modules.keys()) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
