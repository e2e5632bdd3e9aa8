"""Tasks for a scheduler under test, and its virtual clock."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from txt1.kernel.clock import VirtualClock
from txt1.kernel.loop import clock_of
from txt1.kernel.scheduler import Scheduler
from txt1.kernel.ticks import Ticks

MS = 1_000_000
Log = list[tuple[int, str]]


def virtual_clock() -> VirtualClock:
    clock = clock_of(asyncio.get_running_loop())
    assert isinstance(clock, VirtualClock)
    return clock


def no_fault(name: str, error: BaseException) -> None:
    raise AssertionError(f"task '{name}' failed") from error


async def run_until(scheduler: Scheduler, end: float) -> None:
    """Start its tasks, and wait until it has run for so many s."""
    scheduler.start()
    scheduler.end_at(end)
    await scheduler.ended


def logging_task(name: str, log: Log) -> Callable[[Ticks], Coroutine[Any, Any, None]]:
    async def task(ticks: Ticks) -> None:
        clock = virtual_clock()
        async for _ in ticks:
            log.append((clock.now_ns(), name))

    return task


async def idle(ticks: Ticks) -> None:
    async for _ in ticks:
        pass
