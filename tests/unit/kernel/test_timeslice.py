"""Turns on the processor: short ones for the loop's thread, ordinary ones for the processes that it starts."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from txt1.kernel import timeslice
from txt1.kernel.loop import run


def slice_ms(process: int | str) -> float:
    """The length of a thread's turns."""
    for line in Path(f"/proc/{process}/sched").read_text().splitlines():
        if line.startswith("se.slice"):
            return float(line.rpartition(":")[2]) / 1e6
    pytest.skip("this kernel does not tell")


@pytest.mark.skipif(not Path("/proc/self/sched").exists(), reason="this kernel does not tell")
def test_a_real_time_loop_takes_short_turns_and_a_process_it_starts_ordinary_ones() -> None:
    async def main() -> tuple[float, float, int]:
        child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
        timeslice.ordinary(child.pid, 10)
        found = slice_ms(os.getpid()), slice_ms(child.pid), os.getpriority(os.PRIO_PROCESS, child.pid)
        child.communicate(b"\n")
        return found

    before = os.getpriority(os.PRIO_PROCESS, 0)
    ours, its, niceness = run(main())
    assert niceness == max(10, before)
    assert os.getpriority(os.PRIO_PROCESS, 0) == before
    assert ours < its or its <= 0.1


@pytest.mark.skipif(not Path("/proc/self/sched").exists(), reason="this kernel does not tell")
def test_threads_that_a_real_time_loop_starts_take_ordinary_turns() -> None:
    async def main() -> tuple[float, float]:
        theirs = await asyncio.to_thread(lambda: slice_ms(f"self/task/{threading.get_native_id()}"))
        return slice_ms(f"self/task/{threading.get_native_id()}"), theirs

    ours, theirs = run(main())
    assert ours < theirs or theirs <= 0.1
