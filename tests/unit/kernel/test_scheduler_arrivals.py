"""Tasks that a scheduler runs on arrival, among those at fixed rates."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from scheduler_tasks import MS, Log, idle, logging_task, no_fault, run_until, virtual_clock

from txt1.kernel.loop import run
from txt1.kernel.scheduler import Scheduler
from txt1.kernel.ticks import Ticks


def test_a_burst_of_arrivals_is_one_tick() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)
        notify = scheduler.add_sporadic("serial", 4, logging_task("serial", log))
        scheduler.start()
        await asyncio.sleep(0.005)
        for _ in range(5):
            notify()
        assert log == [], "it runs when the loop comes to it, not inside notify"
        await asyncio.sleep(0.005)
        notify()
        await asyncio.sleep(0.005)
        statistics = scheduler.statistics()["serial"]
        assert (statistics.cycles, statistics.misses, statistics.lateness.max_ns) == (2, 0, 0)
        scheduler.stop()
        return log

    assert run(main(), speed="max") == [(5 * MS, "serial"), (10 * MS, "serial")]


def test_a_sporadic_task_has_no_period() -> None:
    async def main() -> None:
        periods: list[float | None] = []

        async def task(ticks: Ticks) -> None:
            periods.append(ticks.period)
            async for _ in ticks:
                pass

        scheduler = Scheduler(no_fault)
        scheduler.add_sporadic("serial", 4, task)
        await run_until(scheduler, 1.0)
        assert periods == [None]
        assert scheduler.statistics()["serial"].cycles == 0

    run(main(), speed="max")


def test_an_arrival_that_a_task_announces_is_served_at_once_by_priority() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)

        async def receiver(ticks: Ticks) -> None:
            async for now in ticks:
                log.append((virtual_clock().now_ns(), "receiver"))
                if now == 0.1:
                    urgent()
                    casual()
                    urgent()

        scheduler.add("receiver", 3, 0.1, receiver)
        scheduler.add("same", 3, 0.1, logging_task("same", log))
        scheduler.add("low", 1, 0.1, logging_task("low", log))
        casual = scheduler.add_sporadic("casual", 2, logging_task("casual", log))
        urgent = scheduler.add_sporadic("urgent", 4, logging_task("urgent", log))
        await run_until(scheduler, 0.2)
        return [entry for entry in log if entry[0] > 0]

    names = ["receiver", "urgent", "same", "casual", "low"]
    assert run(main(), speed="max") == [(100 * MS, name) for name in names]


def test_an_arrival_during_a_stall_is_late_by_the_rest_of_the_stall() -> None:
    async def main() -> None:
        clock = virtual_clock()
        scheduler = Scheduler(no_fault)

        async def slow(ticks: Ticks) -> None:
            async for _ in ticks:
                clock.spend(0.01)
                notify()
                clock.spend(0.007)

        scheduler.add("slow", 1, 1.0, slow)
        notify = scheduler.add_sporadic("serial", 4, idle)
        await run_until(scheduler, 0.5)
        assert scheduler.statistics()["serial"].lateness.max_ns == 7 * MS

    run(main(), speed="max")


def test_an_arrival_from_a_coroutine_does_not_disturb_the_deadlines() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)
        scheduler.add("periodic", 1, 0.02, logging_task("periodic", log))
        notify = scheduler.add_sporadic("serial", 4, logging_task("serial", log))
        scheduler.start()
        scheduler.end_at(0.1)
        for _ in range(12):
            await asyncio.sleep(0.007)
            notify()
        await scheduler.ended
        return log

    expected = [(k * 20 * MS, "periodic") for k in range(5)] + [(k * 7 * MS, "serial") for k in range(1, 13)]
    assert run(main(), speed="max") == sorted(expected)


def test_an_arrival_before_the_start_is_served_at_the_start() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)
        notify = scheduler.add_sporadic("serial", 4, logging_task("serial", log))
        await asyncio.sleep(1.0)
        notify()
        await asyncio.sleep(1.0)
        assert log == []
        scheduler.start()
        await asyncio.sleep(1.0)
        assert scheduler.statistics()["serial"].lateness.max_ns == 0
        scheduler.stop()
        return log

    assert run(main(), speed="max") == [(2000 * MS, "serial")]


def test_tasks_that_wake_one_another_for_ever_leave_the_loop_its_turn() -> None:
    async def main() -> int:
        scheduler = Scheduler(no_fault)
        wakes = 0

        def waking(other: str) -> Callable[[Ticks], Coroutine[Any, Any, None]]:
            async def task(ticks: Ticks) -> None:
                nonlocal wakes
                async for _ in ticks:
                    wakes += 1
                    notify[other]()

            return task

        notify = {
            name: scheduler.add_sporadic(name, 1, waking(other)) for name, other in (("ping", "pong"), ("pong", "ping"))
        }
        scheduler.start()
        notify["ping"]()
        for _ in range(5):
            await asyncio.sleep(0.0)
        assert scheduler.now == 0.0
        scheduler.stop()
        return wakes

    assert run(main(), speed="max") > 100
