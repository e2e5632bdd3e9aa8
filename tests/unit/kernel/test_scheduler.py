"""The scheduler: deadlines, priorities and the life of a task, in virtual time where every instant is exact."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable
from inspect import CORO_CLOSED, getcoroutinestate
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scheduler_tasks import MS, Log, idle, logging_task, no_fault, run_until, virtual_clock

from txt1.errors import TaskFault
from txt1.kernel.loop import run
from txt1.kernel.scheduler import TASKS_MAX, Scheduler
from txt1.kernel.ticks import Ticks

# -- deadlines ---------------------------------------------------------------------------------------------------


def test_cycle_k_starts_exactly_at_k_periods_for_an_hour() -> None:
    async def main() -> None:
        starts: dict[float, list[int]] = {0.02: [], 0.1: [], 1.0: [], 0.3: []}
        told: dict[float, list[float]] = {period: [] for period in starts}
        await asyncio.sleep(0.0123)  # the run's zero is when it starts, not the loop's
        scheduler = Scheduler(no_fault)
        origin = virtual_clock().now_ns()

        def task(period: float) -> Callable[[Ticks], Coroutine[Any, Any, None]]:
            async def body(ticks: Ticks) -> None:
                clock = virtual_clock()
                assert ticks.period == period
                async for now in ticks:
                    starts[period].append(clock.now_ns() - origin)
                    told[period].append(now)

            return body

        for period in starts:
            scheduler.add(f"every {period}", 1, period, task(period))
        await run_until(scheduler, 3600.0)
        for period, at in starts.items():
            ns = round(period * 1e9)
            assert at == [k * ns for k in range(3600 * 10**9 // ns)]
            assert told[period] == [k * ns / 1e9 for k in range(len(at))]
        for statistics in scheduler.statistics().values():
            assert statistics.misses == 0
            assert statistics.lateness.max_ns == 0
        scheduler.stop()

    run(main(), speed="max")


def test_a_minute_has_3000_cycles_at_50_hz_and_60_at_1_hz() -> None:
    async def main() -> dict[str, tuple[int, int]]:
        scheduler = Scheduler(no_fault)
        for name, period in (("controller", 0.02), ("display", 0.1), ("odometry", 0.05), ("mode", 1.0)):
            scheduler.add(name, 1, period, idle)
        scheduler.end_at(60.0)  # before or after the start is all one
        scheduler.start()
        await scheduler.ended
        assert scheduler.now == 60.0
        await asyncio.sleep(5.0)
        return {name: (s.cycles, s.misses) for name, s in scheduler.statistics().items()}

    assert run(main(), speed="max") == {
        "controller": (3000, 0),
        "display": (600, 0),
        "odometry": (1200, 0),
        "mode": (60, 0),
    }


def test_without_an_end_the_run_goes_on_while_the_program_waits() -> None:
    async def main() -> int:
        scheduler = Scheduler(no_fault)
        scheduler.add("a", 1, 0.02, idle)
        scheduler.start()
        await asyncio.sleep(10.0)
        assert not scheduler.ended.done()
        scheduler.stop()
        assert scheduler.ended.done()
        cycles = scheduler.statistics()["a"].cycles
        await asyncio.sleep(10.0)
        assert scheduler.statistics()["a"].cycles == cycles
        return cycles

    assert run(main(), speed="max") in (500, 501)


def test_the_end_may_come_while_a_step_runs() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)

        async def ender(ticks: Ticks) -> None:
            async for now in ticks:
                if now == 0.1:
                    scheduler.end_at(now)

        scheduler.add("ender", 2, 0.02, ender)
        scheduler.add("other", 1, 0.02, logging_task("other", log))
        scheduler.start()
        await scheduler.ended
        return log

    assert run(main(), speed="max") == [(k * 20 * MS, "other") for k in range(5)]


def test_no_cycle_runs_before_a_coroutine_that_is_due_earlier() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)
        scheduler.add("task", 1, 0.02, logging_task("task", log))

        async def user(period: float) -> None:
            while True:
                await asyncio.sleep(period)
                log.append((virtual_clock().now_ns(), "user"))

        users = [asyncio.create_task(user(period)) for period in (0.02, 0.013, 0.005)]
        await asyncio.sleep(0)
        await run_until(scheduler, 10.0)
        for task in users:
            task.cancel()
        return log

    log = run(main(), speed="max")
    assert [at for at, _ in log] == sorted(at for at, _ in log)
    assert sum(name == "task" for _, name in log) == 500
    users = [at for at, name in log if name == "user" and at < 10_000 * MS]
    assert users == sorted([k * p * MS for p in (20, 13, 5) for k in range(1, 10_000 // p + 1) if k * p < 10_000])


# -- priorities --------------------------------------------------------------------------------------------------


def test_tasks_due_together_run_by_priority_then_in_order_of_addition() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)
        for name, priority, period in (
            ("button", 1, 0.1),
            ("mode", 2, 1.0),
            ("controller", 4, 0.02),
            ("display", 2, 0.1),
            ("encoder", 3, 0.02),
            ("battery", 1, 1.0),
        ):
            scheduler.add(name, priority, period, logging_task(name, log))
        await run_until(scheduler, 5.0)
        return log

    log = run(main(), speed="max")
    order = ["controller", "encoder", "mode", "display", "button", "battery"]
    for instant in range(0, 5000, 20):
        ran = [name for at, name in log if at == instant * MS]
        periods = {"controller": 20, "encoder": 20, "mode": 1000, "display": 100, "button": 100, "battery": 1000}
        assert ran == [name for name in order if instant % periods[name] == 0]


def test_an_overdue_task_of_high_priority_goes_before_the_others() -> None:
    async def main() -> Log:
        log: Log = []
        clock = virtual_clock()
        scheduler = Scheduler(no_fault)

        async def slow(ticks: Ticks) -> None:
            async for now in ticks:
                log.append((clock.now_ns(), "slow"))
                if now == 0.1:
                    clock.spend(0.025)

        scheduler.add("low", 1, 0.1, logging_task("low", log))
        scheduler.add("slow", 3, 0.1, slow)
        scheduler.add("medium", 2, 0.1, logging_task("medium", log))
        scheduler.add("high", 4, 0.02, logging_task("high", log))
        await run_until(scheduler, 0.15)
        return [entry for entry in log if entry[0] >= 100 * MS]

    assert run(main(), speed="max") == [
        (100 * MS, "high"),
        (100 * MS, "slow"),
        (125 * MS, "high"),  # due at 120 ms, overtakes those that were due at 100 ms
        (125 * MS, "medium"),
        (125 * MS, "low"),
        (140 * MS, "high"),
    ]


# -- adding ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("at", "first"), [(0.0, 0), (0.05, 100), (0.1, 100), (0.1000001, 200), (0.99, 1000)])
def test_a_task_added_in_mid_run_starts_with_the_next_multiple_of_its_period(at: float, first: int) -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)
        await asyncio.sleep(0.0333)
        origin = virtual_clock().now_ns()
        scheduler.start()
        await asyncio.sleep(at)
        scheduler.add("late", 1, 0.1, logging_task("late", log))
        scheduler.end_at(1.25)
        await scheduler.ended
        assert scheduler.statistics()["late"].misses == 0
        return [((when - origin) // MS, name) for when, name in log]

    assert run(main(), speed="max") == [(due, "late") for due in range(first, 1250, 100)]


def test_a_task_may_add_another_one() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)

        async def adder(ticks: Ticks) -> None:
            async for now in ticks:
                if now == 0.04:
                    scheduler.add("child", 5, 0.02, logging_task("child", log))

        scheduler.add("adder", 1, 0.02, adder)
        await run_until(scheduler, 0.1)
        return log

    assert run(main(), speed="max") == [(k * MS, "child") for k in (40, 60, 80)]


@given(
    st.lists(st.tuples(st.integers(-3, 5), st.sampled_from([20, 30, 50])), min_size=2, max_size=8),
    st.integers(0, 8),
    st.integers(0, 60),
)
def test_a_task_added_later_falls_in_by_priority_and_disturbs_no_deadline(
    specs: list[tuple[int, int]], early: int, stall: int
) -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)

        def add(numbers: range) -> None:
            for number in numbers:
                priority, period = specs[number]
                scheduler.add(str(number), priority, period / 1000, logging_task(str(number), log))

        async def adder(ticks: Ticks) -> None:
            async for now in ticks:
                if now == 0.3:
                    virtual_clock().spend(stall / 1000)  # what was due meanwhile is ready, and waits for its turn
                    add(range(early, len(specs)))

        add(range(min(early, len(specs))))
        scheduler.add("adder", 6, 0.1, adder)
        await run_until(scheduler, 0.6)
        return log

    log = run(main(), speed="max")

    def punctual(instants: Iterable[int]) -> list[int]:
        return [at for at in instants if not 300 * MS <= at <= (300 + stall) * MS]

    for number, (_, period) in enumerate(specs):
        due = range(0 if number < early else -(-(300 + stall) // period) * period * MS, 600 * MS, period * MS)
        assert punctual(at for at, name in log if name == str(number)) == punctual(due)
    order = [(at, -specs[int(name)][0], int(name)) for at, name in log]
    assert order == sorted(order)


def test_a_task_may_add_another_one_before_its_own_first_tick() -> None:
    async def main() -> Log:
        log: Log = []
        scheduler = Scheduler(no_fault)

        async def parent(ticks: Ticks) -> None:
            scheduler.add("child", 1, 0.1, logging_task("child", log))
            async for _ in ticks:
                pass

        scheduler.add("parent", 1, 0.1, parent)
        await run_until(scheduler, 0.25)
        return log

    assert run(main(), speed="max") == [(k * MS, "child") for k in (0, 100, 200)]


def test_there_is_room_for_a_thousand_tasks_and_no_more() -> None:
    async def main() -> None:
        scheduler = Scheduler(no_fault)
        for number in range(TASKS_MAX):
            scheduler.add(str(number), 1, 1.0, idle)
        with pytest.raises(ValueError, match=f"task 'one more': there are {TASKS_MAX} tasks already"):
            scheduler.add("one more", 1, 1.0, idle)
        scheduler.stop()

    run(main(), speed="max")


def test_a_name_is_given_only_once() -> None:
    async def main() -> None:
        scheduler = Scheduler(no_fault)
        scheduler.add("a", 1, 0.02, idle)
        with pytest.raises(ValueError, match="there is a task 'a' already"):
            scheduler.add("a", 2, 0.1, idle)
        with pytest.raises(ValueError, match="there is a task 'a' already"):
            scheduler.add_sporadic("a", 2, idle)
        assert list(scheduler.statistics()) == ["a"]
        scheduler.stop()

    run(main(), speed="max")


@pytest.mark.parametrize("period", [0.0, -0.02, 1e-12, float("nan"), float("inf")])
def test_a_period_that_is_not_positive_and_finite_is_refused(period: float) -> None:
    async def main() -> None:
        scheduler = Scheduler(no_fault)
        with pytest.raises(ValueError, match="task 'a': period must be positive"):
            scheduler.add("a", 1, period, idle)
        assert scheduler.statistics() == {}

    run(main(), speed="max")


def test_statistics_are_listed_in_the_order_of_addition() -> None:
    async def main() -> list[str]:
        scheduler = Scheduler(no_fault)
        for name, priority in (("low", 1), ("high", 4), ("medium", 2)):
            scheduler.add(name, priority, 0.02, idle)
        scheduler.stop()
        return list(scheduler.statistics())

    assert run(main(), speed="max") == ["low", "high", "medium"]


# -- the life of a task ------------------------------------------------------------------------------------------


def test_a_task_prepares_itself_before_the_first_tick_of_any_task() -> None:
    async def main() -> list[str]:
        order: list[str] = []

        def task(name: str) -> Callable[[Ticks], Coroutine[Any, Any, None]]:
            async def body(ticks: Ticks) -> None:
                order.append(f"{name} prepares")
                async for _ in ticks:
                    order.append(f"{name} ticks")

            return body

        scheduler = Scheduler(no_fault)
        scheduler.add("a", 1, 1.0, task("a"))
        scheduler.add("b", 2, 1.0, task("b"))
        assert order == []
        await run_until(scheduler, 0.5)
        return order

    assert run(main(), speed="max") == ["a prepares", "b prepares", "b ticks", "a ticks"]


def test_stopping_runs_the_finally_clauses_of_every_task() -> None:
    async def main() -> list[str]:
        closed: list[str] = []

        def task(name: str) -> Callable[[Ticks], Coroutine[Any, Any, None]]:
            async def body(ticks: Ticks) -> None:
                try:
                    async for _ in ticks:
                        pass
                finally:
                    closed.append(name)

            return body

        scheduler = Scheduler(no_fault)
        scheduler.add("a", 1, 0.02, task("a"))
        scheduler.add_sporadic("b", 2, task("b"))
        scheduler.start()
        await asyncio.sleep(0.1)
        assert closed == []
        scheduler.stop()
        scheduler.stop()
        return closed

    assert run(main(), speed="max") == ["a", "b"]


def test_a_finally_clause_that_raises_does_not_keep_the_others_from_running() -> None:
    async def main() -> None:
        faults: list[str] = []
        closed: list[str] = []

        async def bad(ticks: Ticks) -> None:
            try:
                async for _ in ticks:
                    pass
            finally:
                raise OSError("cannot save")

        async def good(ticks: Ticks) -> None:
            try:
                async for _ in ticks:
                    pass
            finally:
                closed.append("good")

        scheduler = Scheduler(lambda name, error: faults.append(name))
        scheduler.add("bad", 2, 0.02, bad)
        scheduler.add("good", 1, 0.02, good)
        await run_until(scheduler, 0.1)
        with pytest.raises(TaskFault, match="task 'bad' failed: OSError: cannot save"):
            scheduler.stop()
        assert (faults, closed) == (["bad"], ["good"])

    run(main(), speed="max")


# -- run times ---------------------------------------------------------------------------------------------------


def test_run_times_are_measured_in_real_time() -> None:
    async def main() -> None:
        scheduler = Scheduler(no_fault)

        async def working(ticks: Ticks) -> None:
            async for _ in ticks:
                sum(range(20_000))

        scheduler.add("working", 1, 0.02, working)
        scheduler.add("idle", 1, 0.02, idle)
        await run_until(scheduler, 2.0)
        busy, lazy = scheduler.statistics().values()
        assert busy.cycles == lazy.cycles == 100
        assert busy.run_time.count == lazy.run_time.count == 13  # the first of every eight
        assert 0.0 < lazy.run_time.percentiles().p50 < busy.run_time.percentiles().p50

    run(main(), speed="max")


def test_in_real_time_the_run_time_of_every_cycle_is_measured() -> None:
    async def main() -> None:
        scheduler = Scheduler(no_fault)
        scheduler.add("idle", 1, 0.002, idle)
        await run_until(scheduler, 0.05)
        (idling,) = scheduler.statistics().values()
        assert idling.run_time.count == idling.cycles > 0

    run(main())


def test_a_task_that_is_added_after_the_end_is_closed_and_never_runs() -> None:
    ran: list[float] = []

    async def body(ticks: Ticks) -> None:
        async for now in ticks:
            ran.append(now)

    async def main() -> Coroutine[Any, Any, None]:
        scheduler = Scheduler(no_fault)
        scheduler.start()
        scheduler.stop()
        made: list[Coroutine[Any, Any, None]] = []

        def task(ticks: Ticks) -> Coroutine[Any, Any, None]:
            made.append(body(ticks))
            return made[0]

        scheduler.add("late", 1, 0.02, task)
        await asyncio.sleep(1.0)
        return made[0]

    late = run(main(), speed="max")
    assert getcoroutinestate(late) == CORO_CLOSED
    assert ran == []
