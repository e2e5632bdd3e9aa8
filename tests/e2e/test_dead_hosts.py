"""A host that is killed while it drives, and the device that is left alone: it stops by a time-out of its own.

Real time and real processes: the device is here, with its simulated vehicle; the host is killed.
"""

import asyncio
import signal
import subprocess
import sys
from collections.abc import Awaitable
from pathlib import Path

import pytest
from blockbuster import BlockBuster

from benchmarks import dead_hosts
from benchmarks.dead_hosts import (
    LOOK,
    NAMESPACE,
    Blow,
    device_without_host,
    guard_after,
    in_namespace,
    to_both,
    to_guard,
    to_host,
)
from tests.e2e.conftest import may_block
from tests.patience import LIMIT, TXT1, lateness
from txt1.kernel.loop import run

LATE = 0.15  # s from one look to the next, of the device as well


pytestmark = pytest.mark.usefixtures("patient")


@pytest.fixture(autouse=True)
def patient_hosts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dead_hosts, "PROGRAM", TXT1)
    monkeypatch.setattr(dead_hosts, "STARTS", LIMIT)


@pytest.fixture(autouse=True)
def made_before_anything_runs(blocking_calls_fail: BlockBuster) -> None:
    may_block(blocking_calls_fail, "benchmarks/dead_hosts.py", "device_without_host", "motor", "children", "guards")
    may_block(blocking_calls_fail, "txt1/link/pty.py", "listen_pty", "_let_go")


async def and_lateness(work: Awaitable[float]) -> tuple[float, float]:
    """A result, and how much too late this loop, in which the device runs, woke up at worst meanwhile, s."""
    worst, time = 0.0, asyncio.get_running_loop().time

    async def look() -> None:
        nonlocal worst
        while True:
            before = time()
            await asyncio.sleep(LOOK)
            worst = max(worst, time() - before - LOOK)

    looking = asyncio.ensure_future(look())
    try:
        return await work, worst
    finally:
        looking.cancel()


@pytest.mark.parametrize("hal", ["vesc", pytest.param("waveshare", marks=pytest.mark.long)])
def test_the_device_stops_by_itself(hal: str, tmp_path: Path) -> None:
    with lateness() as late:
        took, of_loop = run(and_lateness(device_without_host(hal, tmp_path)))
    slack = 5.0 * max(late(), of_loop)  # of host and device, and of the loop that looks
    told = f"outputs at rest {took:.3f} s after the kill; a thread was {late():.3f} s late, the loop {of_loop:.3f} s"
    assert 0.5 - 0.1 - slack <= took <= 0.5 + LATE + slack, told


@pytest.mark.parametrize(
    ("blow", "options"),
    [
        pytest.param(to_host(signal.SIGKILL), {}, id="killed", marks=pytest.mark.long),
        pytest.param(to_host(signal.SIGSTOP), {}, id="hangs", marks=pytest.mark.long),
        pytest.param(to_both(signal.SIGSTOP), {"watchdog": True}, id="hangs with its guard"),
        pytest.param(
            in_namespace(signal.SIGKILL, init=False),
            {"namespace": True},
            id="killed in a namespace",
            marks=pytest.mark.long,
        ),
    ],
)
def test_the_outputs_of_a_raspberry_pi_rest_whatever_happens_to_its_host(
    blow: Blow, options: dict[str, bool], tmp_path: Path
) -> None:
    if "namespace" in options and subprocess.run([*NAMESPACE, "true"], capture_output=True).returncode:
        pytest.skip("namespaces of one's own are not allowed here")
    with lateness() as late:
        took = run(guard_after(blow, tmp_path, **options))
    assert took <= 0.25 + LATE + 5.0 * late(), f"at rest {took:.3f} s later"


@pytest.mark.long
def test_the_outputs_of_a_raspberry_pi_rest_though_its_guard_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a patient host would wait for its guard
    monkeypatch.setattr(dead_hosts, "PROGRAM", (sys.executable, "-m", "txt1"))
    with lateness() as late:
        took = run(guard_after(to_guard(signal.SIGSTOP), tmp_path))
    assert took <= 0.25 + LATE + 5.0 * late(), f"at rest {took:.3f} s later"
