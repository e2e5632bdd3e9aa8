"""Pages and fleets come up beside other work, with little more processor time than on a quiet computer."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from rigs.ports import free_port
from tests.patience import LIMIT, TXT1, wait_until
from txt1.kernel.clock import process_time

BUSY = 8

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(sys.platform != "linux", reason="it reads the processor time of another process"),
]


@contextmanager
def busy_loops(number: int) -> Iterator[None]:
    with ExitStack() as stack:
        for _ in range(number):
            loop = stack.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            stack.callback(loop.kill)
        yield


def children(process: int) -> list[int]:
    """The ids of the processes that a process has started."""
    told = (each.read_text() for each in Path(f"/proc/{process}/task").glob("*/children"))
    return [int(child) for line in told for child in line.split()]


def answers(port: int) -> bool:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=LIMIT):
            return True
    except (urllib.error.URLError, OSError):
        return False


def page_start() -> tuple[float, list[str]]:
    """The processor time, s, that the page's process takes until the page answers, and what the robot printed."""
    port, lines = free_port(), list[str]()
    words = [*TXT1, "run", "--headless", "--web", f"127.0.0.1:{port}"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as run:
        try:
            assert run.stdout is not None
            reading = threading.Thread(target=lines.extend, args=(run.stdout,), daemon=True)
            reading.start()
            wait_until(lambda: answers(port), 10.0 * LIMIT)
            took = sum(process_time(child) or 0.0 for child in children(run.pid))
        finally:
            run.terminate()
        run.wait(LIMIT)
        reading.join()
    return took, lines


def test_a_page_comes_up_beside_eight_busy_loops_at_its_first_start() -> None:
    alone, _ = page_start()
    with busy_loops(BUSY):
        beside, lines = page_start()
    assert not [line for line in lines if "started again" in line]
    assert beside < 3.0 * alone


def test_a_fleet_comes_up_beside_eight_busy_loops_at_its_first_start() -> None:
    fleet = ("--fleet-name", f"busy_{os.getpid()}")
    lines: list[str] = []
    robots: list[subprocess.Popen[str]] = []
    with busy_loops(BUSY), ExitStack() as stack:
        for name in ("a", "b"):
            words = [*TXT1, "run", "--headless", "--fleet", "--name", name, *fleet]
            run = stack.enter_context(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
            stack.callback(run.kill)
            robots.append(run)
            assert run.stdout is not None
            threading.Thread(target=lines.extend, args=(run.stdout,), daemon=True).start()

        def stop_of_all() -> str:
            assert [run.poll() for run in robots] == [None, None]
            asked = subprocess.run(
                [*TXT1, "fleet", "--join", "--stop", *fleet], capture_output=True, text=True, timeout=10.0 * LIMIT
            )
            return asked.stdout + asked.stderr

        wait_until(lambda: "stands: a, b" in stop_of_all(), 10.0 * LIMIT)
    assert not [line for line in lines if "started again" in line]
