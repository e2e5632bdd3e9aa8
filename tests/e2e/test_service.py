"""A robot as a service: the unit, what the service manager is told, and no arming by itself."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import may_block
from tests.patience import LIMIT, S
from txt1.cli import execute, service
from txt1.cli.service import quoted, run_options
from txt1.cli.service_manager import served, tell
from txt1.robot import Robot

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def a_line_is_written_only_where_it_fits(blocking_calls_fail: BlockBuster) -> None:
    may_block(blocking_calls_fail, "txt1/kit/app.py", "_put")


@pytest.fixture
def unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a user's unit goes; there is no systemctl."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setattr("shutil.which", lambda name: None)
    return tmp_path / "systemd" / "user" / "txt1.service"


def test_a_unit_is_written_and_taken_away(unit: Path, capsys: Capture) -> None:
    assert execute(["service", "install", "--user", "run", "--hal", "sim", "--set", "hal_options.note=big robot"]) == 0
    lines = unit.read_text().splitlines()
    command = f'ExecStart={sys.executable} -m txt1 run --hal sim --set "hal_options.note=big robot" --headless --no-arm'
    assert command in lines
    assert {"Type=notify", "WatchdogSec=2", "Restart=on-failure", "StandardOutput=journal"} <= set(lines)
    assert "systemctl --user daemon-reload && systemctl --user enable --now txt1" in capsys.readouterr().err
    assert execute(["service", "remove", "--user"]) == 0
    assert not unit.exists()
    assert execute(["service", "remove", "--user"]) == 2


def test_a_service_records_to_a_new_file_each_time(unit: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["run", "--hal", "sim", "--log", "drive-{time}.mcap"]
    assert execute(["service", "install", "--user", *words]) == 0
    assert "--log drive-{time}.mcap" in unit.read_text()
    assert execute([*words, "--headless", "--speed", "max", "--duration", "0.1"]) == 0
    (file,) = tmp_path.glob("*.mcap")
    assert re.fullmatch(r"drive-\d{8}-\d{6}\.mcap", file.name)


@pytest.mark.parametrize("user", ["", "daemon"])
def test_systemd_finds_nothing_wrong_with_the_unit(user: str, tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not installed")
    written = tmp_path / "txt1.service"
    words = run_options(["--realtime", "--set", 'hal_options.x=a "b" $c 100%'])
    written.write_text(service.unit("txt1", words, user=user))
    done = subprocess.run(
        [analyze, "verify", "--man=no", "--recursive-errors=no", str(written)], capture_output=True, text=True
    )
    if "Permission denied" in done.stderr:  # where systemd has never run, it may not make its folder in /run
        pytest.skip(f"systemd-analyze does not run for this user here: {done.stderr.strip()}")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_service_kills_no_guard_and_has_no_more_rights_than_it_needs() -> None:
    mine, the_computers = (set(service.unit("txt1", [], user=user).splitlines()) for user in ("", "daemon"))
    both = {"KillMode=process", "NoNewPrivileges=yes", "SystemCallFilter=@system-service", "UMask=0077"}
    assert both <= mine and both <= the_computers
    sandbox = {"User=daemon", "CapabilityBoundingSet=", "ProtectSystem=strict", "PrivateTmp=yes", "DevicePolicy=closed"}
    assert sandbox <= the_computers and not sandbox & mine
    assert f"ReadWritePaths={Path.cwd()}" in the_computers
    assert "DeviceAllow=char-i2c rw" in the_computers
    # numba writes and runs memory, --realtime wants priority, and the car's devices are the computer's
    refused = {"MemoryDenyWriteExecute=yes", "RestrictRealtime=yes", "PrivateDevices=yes"}
    assert not refused & the_computers


@pytest.mark.parametrize(("words", "sudo", "user"), [(["--as", "daemon"], "", "daemon"), ([], "daemon", "daemon")])
def test_a_service_of_the_computers_is_a_users(
    words: list[str], sudo: str, user: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setattr(service, "unit_path", lambda name, system: tmp_path / name)
    monkeypatch.setenv("SUDO_USER", sudo)
    assert execute(["service", "install", "--system", *words]) == 0
    assert f"User={user}" in (tmp_path / "txt1").read_text().splitlines()


@pytest.mark.parametrize(
    ("words", "told"), [(["--as", "root"], "does not run as root"), (["--as", "nobody-like-that"], "there is no user")]
)
def test_a_service_of_roots_is_refused(words: list[str], told: str, capsys: Capture) -> None:
    assert execute(["service", "install", "--system", *words]) == 2
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--user", "run", "--arm"], "never arms"),
        (["--user", "--system"], "choose one"),
        (["--user", "run", "--nonsense"], "--nonsense"),
        (["--user", "run", "--log", "drive.mcap"], "put {time} into its name"),
        (["--user", "--name", "../x"], "no name of a unit"),
    ],
)
def test_a_unit_that_would_arm_or_could_not_run_is_refused(
    unit: Path, words: list[str], told: str, capsys: Capture
) -> None:
    assert execute(["service", "install", *words]) == 2
    assert told in capsys.readouterr().err
    assert not unit.exists()


def test_somebody_elses_unit_is_left_alone(unit: Path, capsys: Capture) -> None:
    unit.parent.mkdir(parents=True)
    unit.write_text("[Service]\n")
    assert execute(["service", "install", "--user"]) == 2
    assert execute(["service", "remove", "--user"]) == 2
    assert unit.read_text() == "[Service]\n"
    assert "not of our making" in capsys.readouterr().err


def test_words_are_quoted_as_systemd_reads_them() -> None:
    assert quoted("--drive=0.5,0.3") == "--drive=0.5,0.3"
    assert quoted('a "b"') == '"a \\"b\\""'
    assert quoted("50%") == "50%%"
    assert quoted("$HOME") == "$$HOME"
    assert quoted("") == '""'


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    """The service manager's socket."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.settimeout(LIMIT)
        yield listening


def test_the_service_manager_hears_of_readiness_the_watchdog_and_the_end(
    manager: socket.socket, tmp_path: Path
) -> None:
    environment = os.environ | {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "400000"}
    began = time.monotonic()
    robot = subprocess.Popen(
        [sys.executable, "-m", "txt1", "run", "--hal", "sim", "--headless", "--no-arm"],
        env=environment,
        stdout=subprocess.PIPE,
    )
    try:
        assert manager.recv(1000) == b"READY=1"
        first = manager.recv(1000)
        assert first == b"WATCHDOG=1\nSTATUS=disarmed: not armed yet"
        assert {manager.recv(1000) for _ in range(12)} == {b"WATCHDOG=1"}
        assert time.monotonic() - began > 1.0  # twelve times 0.1 s, the first of them maybe late

        robot.send_signal(signal.SIGSTOP)  # the controller stalls
        os.waitid(os.P_PID, robot.pid, os.WSTOPPED)
        manager.settimeout(0.3 * S)
        with pytest.raises(TimeoutError):
            while True:
                manager.recv(1000)  # what was sent before
        robot.send_signal(signal.SIGCONT)
        manager.settimeout(LIMIT)
        assert manager.recv(1000) == b"WATCHDOG=1"

        robot.terminate()
        while (last := manager.recv(1000)) == b"WATCHDOG=1":
            pass
        assert last == b"STOPPING=1"
        assert robot.wait() == 143
    finally:
        robot.kill()
        robot.communicate()


def test_the_watchdog_of_another_process_is_not_fed(
    manager: socket.socket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    monkeypatch.setenv("WATCHDOG_PID", "1")  # of another process
    assert execute(["run", "--hal", "sim", "--json", "--duration", "2", "--speed", "max", "--no-arm"]) == 0
    assert manager.recv(1000) == b"READY=1"
    assert manager.recv(1000) == b"STATUS=disarmed: not armed yet"
    assert manager.recv(1000) == b"STOPPING=1"


def read(manager: socket.socket) -> list[bytes]:
    """What has been sent so far."""
    told = []
    manager.setblocking(False)
    with suppress(BlockingIOError):
        while True:
            told.append(manager.recv(1000))
    return told


async def test_the_watchdog_goes_hungry_while_the_controller_makes_no_cycle(
    manager: socket.socket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "2000000")
    async with Robot.open("sim", seed=1) as robot:
        with served(robot.runtime):
            await asyncio.sleep(1.1)
            assert read(manager)[-1] == b"WATCHDOG=1"
            stuck = robot.runtime.statistics()["controller"].cycles
            monkeypatch.setattr(robot.runtime, "statistics", lambda: {"controller": SimpleNamespace(cycles=stuck)})
            await asyncio.sleep(1.1)
            assert read(manager) == [b"WATCHDOG=1"]  # for the cycles since the one before
            await asyncio.sleep(1.1)
            assert read(manager) == []


def test_a_service_manager_that_has_gone_is_no_fault(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for address in ("", "@txt1-nobody-is-here", str(tmp_path / "nobody"), "nonsense"):
        monkeypatch.setenv("NOTIFY_SOCKET", address)
        tell("READY=1")


def test_in_the_journal_the_event_log_takes_the_place_of_a_line_a_second(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    output = os.fstat(1)
    monkeypatch.setenv("JOURNAL_STREAM", f"{output.st_dev}:{output.st_ino}")
    assert execute(["run", "--hal", "sim", "--headless", "--speed", "max", "--duration", "3"]) == 0
    assert capfd.readouterr().out.splitlines() == ["armed", "disarmed: the run has ended"]
