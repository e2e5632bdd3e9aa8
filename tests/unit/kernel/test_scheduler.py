"""The scheduler: deadlines, priorities, misses and faults, in virtual time where every instant is exact."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from txt1.errors import TaskFault
from txt1.kernel.clock import VirtualClock
from txt1.kernel.loop import clock_of, run
from txt1.kernel.scheduler import TASKS_MAX, Scheduler
from txt1.kernel.ticks import Ticks

MS = 1_000_000
Log = list[tuple[int, str]]


def virtual_clock() -> VirtualClock:
    clock = clock_of(asyncio.get_running_loop())
    assert isinstance(clock, VirtualClock)
    return clock


def no_fault(name: str, error: BaseException) -> None:
    raise AssertionError(f"task '{name}' failed") from error


def logging_task(name: str, log: Log) -> Callable[[Ticks], Coroutine[Any, Any, None]]:
    async def task(ticks: Ticks) -> None:
        clock = virtual_clock()
        async for _ in ticks:
            log.append((clock.now_ns(), name))

    return task


async def idle(ticks: Ticks) -> None:
    async for _ in ticks:
        pass


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
        scheduler.start()
        scheduler.end_at(3600.0)
        await scheduler.ended
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
        scheduler.start()
        scheduler.end_at(10.0)
        await scheduler.ended
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
        scheduler.start()
        scheduler.end_at(5.0)
        await scheduler.ended
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
        scheduler.start()
        scheduler.end_at(0.15)
        await scheduler.ended
        return [entry for entry in log if entry[0] >= 100 * MS]

    assert run(main(), speed="max") == [
        (100 * MS, "high"),
        (100 * MS, "slow"),
        (125 * MS, "high"),  # due at 120 ms, overtakes those that were due at 100 ms
        (125 * MS, "medium"),
        (125 * MS, "low"),
        (140 * MS, "high"),
    ]


# -- stalls ------------------------------------------------------------------------------------------------------

Spec = tuple[str, int, int]  # name, priority, period in ms
TASKS: tuple[Spec, ...] = (
    ("controller", 4, 20),
    ("encoder", 3, 20),
    ("mode", 2, 1000),
    ("display", 2, 100),
    ("battery", 1, 1000),
    ("button", 1, 100),
)


def predicted(
    tasks: tuple[Spec, ...], staller: str, stall_at: int, stall: int, end: int
) -> dict[str, tuple[int, int, int]]:
    """Cycles, misses and greatest lateness (ms) of every task, slot by slot, in whole milliseconds.

    Only the staller takes time, in its cycle due at `stall_at`. A slot that lies wholly inside the stall is missed; so
    is one whose start is, unless the stall ends before the slot does.
    """
    rank = {name: (-priority, k) for k, (name, priority, _) in enumerate(tasks)}
    result = {}
    for name, _, period in tasks:
        cycles = misses = late = 0
        for due in range(0, end, period):
            before_staller = rank[name] <= rank[staller]
            waits = stall_at < due < stall_at + stall or (due == stall_at and not before_staller)
            start = stall_at + stall if waits else due
            if start >= due + period or start >= end:
                misses += 1
            else:
                cycles += 1
                late = max(late, start - due)
        result[name] = cycles, misses, late
    return result


def measured(
    tasks: tuple[Spec, ...], staller: str, stall_at: int, stall: int, end: int
) -> tuple[dict[str, tuple[int, int, int]], dict[str, list[tuple[float, int]]]]:
    """What the scheduler made of it, and every tick with the misses it was told of."""

    async def main() -> tuple[dict[str, tuple[int, int, int]], dict[str, list[tuple[float, int]]]]:
        clock = virtual_clock()
        scheduler = Scheduler(no_fault)
        seen: dict[str, list[tuple[float, int]]] = {name: [] for name, _, _ in tasks}

        def task(name: str, period: int) -> Callable[[Ticks], Coroutine[Any, Any, None]]:
            async def body(ticks: Ticks) -> None:
                k = 0
                async for now in ticks:
                    seen[name].append((now, ticks.missed))
                    k += ticks.missed
                    if name == staller and k * period == stall_at:
                        clock.spend(stall / 1000)
                    k += 1

            return body

        for name, priority, period in tasks:
            scheduler.add(name, priority, period / 1000, task(name, period))
        scheduler.start()
        scheduler.end_at(end / 1000)
        await scheduler.ended
        return {name: (s.cycles, s.misses, s.lateness.max_ns // MS) for name, s in scheduler.statistics().items()}, seen

    return run(main(), speed="max")


@pytest.mark.parametrize("stall", [5, 19, 20, 21, 30, 40, 45, 50, 99, 100, 130, 1000, 1730])
@pytest.mark.parametrize("stall_at", [500, 1000])
def test_a_stalled_display_costs_every_task_exactly_the_predicted_misses(stall: int, stall_at: int) -> None:
    result, seen = measured(TASKS, "display", stall_at, stall, 4000)
    assert result == predicted(TASKS, "display", stall_at, stall, 4000)
    for name, _, period in TASKS:
        cycles, misses, _ = result[name]
        assert cycles + misses == 4000 // period
        assert sum(missed for _, missed in seen[name]) == misses
        starts = [now for now, _ in seen[name]]
        assert len({int(1000 * now + 1e-6) // period for now in starts}) == len(starts), "a cycle was replayed"


def test_a_30_ms_stall_costs_the_50_hz_tasks_one_cycle_late_and_no_more() -> None:
    # the display starts at 1000 ms behind controller and encoder and ends at 1030 ms: the cycle due at 1020 ms starts
    # 10 ms late, inside its slot; nothing is missed
    result, _ = measured(TASKS, "display", 1000, 30, 2000)
    assert result["controller"] == result["encoder"] == (100, 0, 10)
    assert result["button"] == (20, 0, 30)
    assert result["battery"] == (2, 0, 30)
    # a stall of 45 ms ends in the slot due at 1040 ms: the one due at 1020 ms is missed, and never run
    result, seen = measured(TASKS, "display", 1000, 45, 2000)
    assert result["controller"] == result["encoder"] == (99, 1, 5)
    assert [now for now, missed in seen["controller"] if missed] == [1.045]
    assert result["button"] == (20, 0, 45)


def test_a_cycle_that_misses_its_slot_by_nothing_is_missed() -> None:
    assert measured(TASKS, "display", 1000, 40, 2000)[0]["controller"] == (99, 1, 0)
    assert measured(TASKS, "display", 1000, 39, 2000)[0]["controller"] == (100, 0, 19)


@pytest.mark.parametrize("stall", [30, 50, 99, 130, 500])
def test_cycles_that_the_end_of_the_run_cuts_off_are_missed_too(stall: int) -> None:
    result, _ = measured(TASKS, "display", 1900, stall, 2000)
    assert result == predicted(TASKS, "display", 1900, stall, 2000)
    for name, _, period in TASKS:
        assert sum(result[name][:2]) == 2000 // period


@given(
    stall=st.integers(0, 700),
    at=st.integers(0, 9),
    staller=st.sampled_from([0, 1, 2, 3]),
    priorities=st.lists(st.integers(1, 4), min_size=4, max_size=4),
)
@settings(max_examples=60, deadline=None)
def test_any_stall_in_any_task_costs_what_is_predicted(
    stall: int, at: int, staller: int, priorities: list[int]
) -> None:
    periods = (20, 50, 100, 500)
    tasks = tuple((f"t{k}", priorities[k], periods[k]) for k in range(4))
    name, _, period = tasks[staller]
    result, _ = measured(tasks, name, at * period, stall, 6000)
    assert result == predicted(tasks, name, at * period, stall, 6000)


def test_a_task_that_is_always_too_slow_misses_the_same_share_for_ever() -> None:
    async def main() -> tuple[int, int]:
        clock = virtual_clock()
        scheduler = Scheduler(no_fault)

        async def slow(ticks: Ticks) -> None:
            async for _ in ticks:
                clock.spend(0.03)

        scheduler.add("slow", 1, 0.02, slow)
        scheduler.start()
        scheduler.end_at(6.0)
        await scheduler.ended
        statistics = scheduler.statistics()["slow"]
        return statistics.cycles, statistics.misses

    # starts at 0, 30, 60, 90 ...: in the slots 0, 1, 3, 4, 6, 7 ...
    assert run(main(), speed="max") == (200, 100)


def test_an_overloaded_robot_still_listens() -> None:
    async def main() -> float:
        clock = virtual_clock()
        scheduler = Scheduler(no_fault)

        async def slow(ticks: Ticks) -> None:
            async for _ in ticks:
                clock.spend(0.03)

        scheduler.add("slow", 1, 0.02, slow)
        scheduler.start()
        scheduler.end_at(60.0)
        await asyncio.sleep(1.0)  # the coroutine that would stop it
        at = scheduler.now
        scheduler.stop()
        return at

    assert run(main(), speed="max") < 1.2


# -- tasks on arrival --------------------------------------------------------------------------------------------


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
        scheduler.start()
        scheduler.end_at(1.0)
        await scheduler.ended
        assert periods == [None]
        assert scheduler.statistics()["serial"].cycles == 0

    run(main(), speed="max")


def test_an_arrival_announced_by_another_task_is_served_at_the_same_instant_by_priority() -> None:
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
        scheduler.start()
        scheduler.end_at(0.2)
        await scheduler.ended
        return [entry for entry in log if entry[0] > 0]

    names = ["receiver", "urgent", "same", "casual", "low"]
    assert run(main(), speed="max") == [(100 * MS, name) for name in names]


def test_an_arrival_during_a_stall_is_late_by_what_was_left_of_it() -> None:
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
        scheduler.start()
        scheduler.end_at(0.5)
        await scheduler.ended
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
        scheduler.start()
        scheduler.end_at(0.1)
        await scheduler.ended
        return log

    assert run(main(), speed="max") == [(k * MS, "child") for k in (40, 60, 80)]


@given(
    st.lists(st.tuples(st.integers(-3, 5), st.sampled_from([20, 30, 50])), min_size=2, max_size=8),
    st.integers(0, 8),
    st.integers(0, 60),
)
def test_a_task_added_while_others_wait_or_are_late_falls_in_by_priority_and_disturbs_no_deadline(
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
        scheduler.start()
        scheduler.end_at(0.6)
        await scheduler.ended
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
        scheduler.start()
        scheduler.end_at(0.25)
        await scheduler.ended
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
def test_a_period_that_is_none_is_refused(period: float) -> None:
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
        scheduler.start()
        scheduler.end_at(0.5)
        await scheduler.ended
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
        scheduler.start()
        scheduler.end_at(0.1)
        await scheduler.ended
        with pytest.raises(TaskFault, match="task 'bad' failed: OSError: cannot save"):
            scheduler.stop()
        assert (faults, closed) == (["bad"], ["good"])

    run(main(), speed="max")


# -- faults ------------------------------------------------------------------------------------------------------


def run_faulty(
    task: Callable[[Ticks], Coroutine[Any, Any, None]],
) -> tuple[TaskFault, list[tuple[int, str]], list[BaseException]]:
    """The fault that `ended` holds, what ran (faults included), and what on_fault was given."""

    async def main() -> tuple[TaskFault, list[tuple[int, str]], list[BaseException]]:
        log: Log = []
        errors: list[BaseException] = []

        def on_fault(name: str, error: BaseException) -> None:
            log.append((virtual_clock().now_ns(), f"fault of {name}"))
            errors.append(error)
            notify()

        scheduler = Scheduler(on_fault)
        scheduler.add("high", 3, 0.02, logging_task("high", log))
        scheduler.add("faulty", 2, 0.04, task)
        scheduler.add("low", 1, 0.02, logging_task("low", log))
        notify = scheduler.add_sporadic("serial", 4, logging_task("serial", log))
        scheduler.start()
        scheduler.end_at(1.0)
        with pytest.raises(TaskFault) as caught:
            await scheduler.ended
        notify()
        await asyncio.sleep(1.0)
        scheduler.stop()
        return caught.value, log, errors

    return run(main(), speed="max")


class Boom(Exception):
    pass


@pytest.mark.parametrize("error", [Boom("at 40 ms"), asyncio.CancelledError("at 40 ms"), StopIteration("at 40 ms")])
def test_an_exception_in_a_step_makes_the_robot_safe_first_and_ends_the_run(error: BaseException) -> None:
    async def faulty(ticks: Ticks) -> None:
        async for now in ticks:
            if now == 0.04:
                raise error

    fault, log, errors = run_faulty(faulty)
    assert log == [
        (0, "high"),
        (0, "low"),
        (20 * MS, "high"),
        (20 * MS, "low"),
        (40 * MS, "high"),
        (40 * MS, "fault of faulty"),  # and neither low nor serial afterwards
    ]
    assert fault.task == "faulty"
    assert errors == [fault.__cause__]
    cause = fault.__cause__
    assert cause is error or (isinstance(cause, RuntimeError) and cause.__cause__ is error)
    assert "task 'faulty' failed" in str(fault)


def test_an_exception_before_the_first_tick_ends_the_run_before_it_begins() -> None:
    async def faulty(ticks: Ticks) -> None:
        raise Boom("no such device")

    fault, log, _ = run_faulty(faulty)
    assert log == [(0, "fault of faulty")]
    assert isinstance(fault.__cause__, Boom)


def test_no_task_prepares_itself_after_another_has_failed() -> None:
    async def main() -> list[str]:
        prepared: list[str] = []

        async def faulty(ticks: Ticks) -> None:
            raise Boom

        async def later(ticks: Ticks) -> None:
            prepared.append("later")
            async for _ in ticks:
                pass

        scheduler = Scheduler(lambda name, error: None)
        scheduler.add("faulty", 1, 0.02, faulty)
        scheduler.add("later", 1, 0.02, later)
        scheduler.start()
        with pytest.raises(TaskFault):
            await scheduler.ended
        scheduler.stop()
        return prepared

    assert run(main(), speed="max") == []


def test_a_task_that_returns_is_a_fault_that_says_so() -> None:
    async def faulty(ticks: Ticks) -> None:
        async for now in ticks:
            if now == 0.04:
                return

    fault, _, _ = run_faulty(faulty)
    assert "its loop over the ticks came to an end" in str(fault)


@pytest.mark.parametrize(
    "wait", [lambda: asyncio.sleep(0.001), lambda: asyncio.sleep(0), lambda: asyncio.Event().wait()]
)
def test_a_task_that_awaits_something_else_is_a_fault_that_says_what_to_do(
    wait: Callable[[], Coroutine[Any, Any, object]],
) -> None:
    async def faulty(ticks: Ticks) -> None:
        async for now in ticks:
            if now == 0.04:
                await wait()

    fault, log, _ = run_faulty(faulty)
    assert "awaited something other than its next tick" in str(fault)
    assert "start what waits as a coroutine of its own" in str(fault)
    assert log[-1] == (40 * MS, "fault of faulty")


def test_a_fault_surfaces_even_when_making_the_robot_safe_fails_too() -> None:
    async def main() -> None:
        logged: list[dict[str, Any]] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: logged.append(context))

        async def faulty(ticks: Ticks) -> None:
            async for _ in ticks:
                raise Boom

        def on_fault(name: str, error: BaseException) -> None:
            raise OSError("the port is gone")

        scheduler = Scheduler(on_fault)
        scheduler.add("faulty", 1, 0.02, faulty)
        scheduler.start()
        with pytest.raises(TaskFault, match="'faulty'"):
            await asyncio.wait_for(scheduler.ended, 1.0)
        assert isinstance(logged[0]["exception"], OSError)

    run(main(), speed="max")


def test_a_fault_surfaces_even_when_making_the_robot_safe_stops_the_scheduler() -> None:
    async def main() -> None:
        async def faulty(ticks: Ticks) -> None:
            async for _ in ticks:
                raise Boom

        scheduler = Scheduler(lambda name, error: scheduler.stop())
        scheduler.add("faulty", 1, 0.02, faulty)
        scheduler.start()
        with pytest.raises(TaskFault, match="'faulty'"):
            await scheduler.ended

    run(main(), speed="max")


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_a_request_to_exit_inside_a_step_makes_the_robot_safe_and_exits(error: type[BaseException]) -> None:
    log: Log = []

    async def main() -> None:
        async def exiting(ticks: Ticks) -> None:
            async for now in ticks:
                if now == 0.04:
                    raise error

        scheduler = Scheduler(lambda name, error: log.append((virtual_clock().now_ns(), f"fault of {name}")))
        scheduler.add("exiting", 2, 0.02, exiting)
        scheduler.add("other", 1, 0.02, logging_task("other", log))
        notify = scheduler.add_sporadic("serial", 3, logging_task("serial", log))
        scheduler.start()
        try:
            await scheduler.ended
        finally:
            notify()
            await asyncio.sleep(1.0)
            scheduler.stop()

    with pytest.raises(error):
        run(main(), speed="max")
    assert log == [(0, "other"), (20 * MS, "other"), (40 * MS, "fault of exiting")]


def test_run_times_are_measured_in_real_time() -> None:
    async def main() -> None:
        scheduler = Scheduler(no_fault)

        async def working(ticks: Ticks) -> None:
            async for _ in ticks:
                sum(range(20_000))

        scheduler.add("working", 1, 0.02, working)
        scheduler.add("idle", 1, 0.02, idle)
        scheduler.start()
        scheduler.end_at(2.0)
        await scheduler.ended
        busy, lazy = scheduler.statistics().values()
        assert busy.cycles == lazy.cycles == 100
        assert busy.run_time.count == lazy.run_time.count == 13  # the first of every eight
        assert 0.0 < lazy.run_time.percentiles().p50 < busy.run_time.percentiles().p50

    run(main(), speed="max")


def test_in_real_time_the_run_time_of_every_cycle_is_measured() -> None:
    async def main() -> None:
        scheduler = Scheduler(no_fault)
        scheduler.add("idle", 1, 0.002, idle)
        scheduler.start()
        scheduler.end_at(0.05)
        await scheduler.ended
        (idling,) = scheduler.statistics().values()
        assert idling.run_time.count == idling.cycles > 0

    run(main())
