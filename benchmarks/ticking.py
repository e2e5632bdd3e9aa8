"""Empty tasks at the robot's rates, in virtual time, driven in three ways: what a tick costs by itself."""

from __future__ import annotations

import asyncio
import types
from collections.abc import Coroutine, Generator
from heapq import heapify, heapreplace
from typing import Any, Final

from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import run
from txt1.kernel.scheduler import Scheduler
from txt1.kernel.ticks import Ticks

RATES: Final = (50, 50, 10, 10, 1, 1)
"""Hz, of the robot's periodic tasks on the board."""


def bare_heap_us(simulated: float) -> float:
    """Microseconds per tick of the least that can drive coroutines at their deadlines: a heap, and `send`.

    No clock, no statistics, no event loop, no missed cycles.
    """
    end_ns = round(simulated * NS_PER_S)
    heap: list[tuple[int, int, int, Coroutine[Any, Any, None]]] = []
    for rank, rate in enumerate(RATES):
        coroutine = _bare_task()
        coroutine.send(None)
        heap.append((0, rank, NS_PER_S // rate, coroutine))
    heapify(heap)
    ticks = 0
    began = stopwatch_ns()
    while True:
        due_ns, rank, period_ns, coroutine = heap[0]
        if due_ns >= end_ns:
            break
        heapreplace(heap, (due_ns + period_ns, rank, period_ns, coroutine))
        coroutine.send(due_ns / NS_PER_S)
        ticks += 1
    took = stopwatch_ns() - began
    for *_, coroutine in heap:
        coroutine.close()
    return took / ticks / 1e3


@types.coroutine
def _tick() -> Generator[None, float, float]:
    return (yield)


async def _bare_task() -> None:
    while True:
        await _tick()


def scheduler_us(simulated: float) -> float:
    """Microseconds per tick of our scheduler: clock, priorities, missed cycles, statistics, faults."""
    return run(_scheduler_us(simulated), speed="max")


async def _scheduler_us(simulated: float) -> float:
    scheduler = Scheduler(on_fault=lambda name, error: None)
    for rate in RATES:
        scheduler.add(f"task {len(scheduler.statistics())}", 0, 1.0 / rate, _empty_task)
    scheduler.end_at(simulated)
    began = stopwatch_ns()
    scheduler.start()
    await scheduler.ended
    took = stopwatch_ns() - began
    ticks = sum(task.cycles for task in scheduler.statistics().values())
    scheduler.stop()
    return took / ticks / 1e3


async def _empty_task(ticks: Ticks) -> None:
    async for _ in ticks:
        pass


def asyncio_us(simulated: float) -> float:
    """Microseconds per tick of asyncio tasks that sleep until their deadlines, on our virtual-time loop."""
    return run(_asyncio_us(simulated), speed="max")


async def _asyncio_us(simulated: float) -> float:
    began = stopwatch_ns()
    ticks = await asyncio.gather(*(_sleeper(1.0 / rate, round(simulated * rate)) for rate in RATES))
    return (stopwatch_ns() - began) / sum(ticks) / 1e3


async def _sleeper(period: float, ticks: int) -> int:
    loop = asyncio.get_running_loop()
    start = loop.time()
    for k in range(1, ticks + 1):
        await asyncio.sleep(start + k * period - loop.time())
    return ticks
