"""The Pico's line over Wi-Fi: the firmware in a process of its own, on a socket of this computer, in real time."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from rigs.ports import free_port
from tests.patience import TXT1
from txt1.cars.pico.installer import folder
from txt1.cars.pico.virtual_pico import interpreter
from txt1.errors import MissingExtra

FIRMWARE = """
import time
from txt1pico.core import Core
from txt1pico.wifi import Wireless
core, line = Core(), Wireless(b"a long secret", "127.0.0.1", %d)
print("ready")
while True:
    line.poll(core, 20)
    core.step(0, 0, 12000, 0, 0, 1)
    line.send(memoryview(core.transmitter.buffer)[: core.transmitter.length])
    core.transmitter.length = 0
    time.sleep_ms(20)
"""


@pytest.fixture
def port() -> Iterator[int]:
    """The port that the firmware listens on."""
    try:
        micropython = interpreter()
    except MissingExtra:
        pytest.skip("MicroPython's unix port is not installed")
    port = free_port()
    with subprocess.Popen([micropython, "-c", FIRMWARE % port], cwd=folder(), stdout=subprocess.PIPE) as firmware:
        assert firmware.stdout is not None and firmware.stdout.readline() == b"ready\n"
        yield port
        firmware.kill()


def doctor(port: int, secret: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """What `txt1 doctor` says of the line."""
    file = folder / "secret"
    file.write_text(f"{secret}\n")
    return subprocess.run(
        [
            *TXT1,
            "doctor",
            "--port",
            f"socket://127.0.0.1:{port}",
            "--duration",
            "5",
            "--set",
            f"serial.secret_file={file}",
        ],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.long
def test_a_host_with_the_secret_has_a_line_and_one_with_another_secret_has_none(port: int, tmp_path: Path) -> None:
    wrong = doctor(port, "another secret", tmp_path)
    assert wrong.returncode == 1 and "odometry" not in wrong.stdout
    right = doctor(port, "a long secret", tmp_path)
    assert "PID set   answered" in right.stdout and "odometry" in right.stdout, right.stdout + right.stderr
    assert "a long secret" not in right.stdout + right.stderr


def test_an_empty_secret_file_is_named(tmp_path: Path) -> None:
    done = doctor(1, "", tmp_path)
    assert done.returncode == 2 and "serial.secret_file" in done.stderr and "is empty" in done.stderr
