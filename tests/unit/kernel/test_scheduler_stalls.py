"""What a step that takes too long costs the other tasks of a scheduler: exactly so many cycles."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scheduler_tasks import MS, no_fault, run_until, virtual_clock

from tests.examples import examples
from txt1.kernel.loop import run
from txt1.kernel.scheduler import Scheduler
from txt1.kernel.ticks import Ticks

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
        await run_until(scheduler, end / 1000)
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
@settings(max_examples=examples(60))
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
        await run_until(scheduler, 6.0)
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
