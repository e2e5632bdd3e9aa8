"""Real time: never early, in order, and awake for input. No statement here depends on how fast the machine is."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from scheduler_tasks import run_until

from tests.patience import LIMIT, S, until
from txt1.kernel.clock import RealClock
from txt1.kernel.loop import RealTimeLoop, run
from txt1.kernel.scheduler import Scheduler
from txt1.kernel.ticks import Ticks

Runner = Callable[[Coroutine[Any, Any, Any]], Any]
BOTH = pytest.mark.parametrize("runner", [run, asyncio.run], ids=["RealTimeLoop", "plain asyncio"])


def no_fault(name: str, error: BaseException) -> None:
    raise AssertionError(f"task '{name}' failed") from error


def test_the_default_loop_is_the_real_one() -> None:
    async def main() -> bool:
        return isinstance(asyncio.get_running_loop(), RealTimeLoop)

    assert run(main())


@pytest.mark.parametrize("duration", [0.0001, 0.0015, 0.01])
def test_a_sleep_is_never_short(duration: float) -> None:
    async def main() -> None:
        for _ in range(5):
            before = RealClock().now_ns()
            await asyncio.sleep(duration)
            assert RealClock().now_ns() - before >= duration * 1e9 - 1

    run(main())


def test_input_ends_a_long_wait() -> None:
    async def main() -> bytes:
        reader, writer = os.pipe()
        got: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        asyncio.get_running_loop().add_reader(reader, lambda: got.done() or got.set_result(os.read(reader, 1)))
        timer = threading.Timer(0.02, os.write, (writer, b"x"))
        timer.start()
        try:
            return await asyncio.wait_for(got, LIMIT)
        finally:
            timer.join()
            asyncio.get_running_loop().remove_reader(reader)
            os.close(reader)
            os.close(writer)

    assert run(main()) == b"x"


def test_a_thread_s_result_ends_a_long_wait() -> None:
    async def main() -> int:
        return await asyncio.wait_for(asyncio.to_thread(lambda: 42), LIMIT)

    assert run(main()) == 42


@BOTH
def test_no_cycle_starts_before_it_is_due_and_none_twice(runner: Runner) -> None:
    async def main() -> None:
        starts: list[int] = []
        told: list[int] = []

        async def task(ticks: Ticks) -> None:
            slot = -1
            async for now in ticks:
                starts.append(RealClock().now_ns())
                told.append(round(now * 1e9))
                slot += 1 + ticks.missed
                assert slot == round(now * 1e9) // 5_000_000

        scheduler = Scheduler(no_fault)
        scheduler.add("task", 1, 0.005, task)
        origin = RealClock().now_ns()
        await run_until(scheduler, 0.1)
        statistics = scheduler.statistics()["task"]
        assert statistics.cycles == len(starts)
        assert statistics.cycles + statistics.misses == 20
        assert all(start >= origin + now for start, now in zip(starts, told, strict=True))
        assert statistics.lateness.max_ns < 5_000_000
        scheduler.stop()

    runner(main())


@BOTH
def test_tasks_due_together_run_by_priority(runner: Runner) -> None:
    async def main() -> None:
        order: list[tuple[int, str]] = []

        def task(name: str) -> Callable[[Ticks], Coroutine[Any, Any, None]]:
            async def body(ticks: Ticks) -> None:
                slot = -1
                async for _ in ticks:
                    slot += 1 + ticks.missed
                    order.append((slot, name))

            return body

        scheduler = Scheduler(no_fault)
        for name, priority in (("low", 1), ("high", 3), ("medium", 2)):
            scheduler.add(name, priority, 0.01, task(name))
        await run_until(scheduler, 0.05)
        for slot in range(5):
            ran = [name for at, name in order if at == slot]
            assert ran == [name for name in ("high", "medium", "low") if name in ran]
        assert len(order) + sum(s.misses for s in scheduler.statistics().values()) == 15

    runner(main())


@BOTH
def test_an_arrival_from_another_thread_is_served(runner: Runner) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        served = asyncio.Event()

        async def serial(ticks: Ticks) -> None:
            async for _ in ticks:
                served.set()

        scheduler = Scheduler(no_fault)
        notify = scheduler.add_sporadic("serial", 4, serial)
        scheduler.start()
        threading.Timer(0.01, loop.call_soon_threadsafe, (notify,)).start()
        await asyncio.wait_for(served.wait(), LIMIT)
        scheduler.stop()

    runner(main())


@BOTH
def test_an_overloaded_robot_still_listens(runner: Runner) -> None:
    async def main() -> None:
        async def slow(ticks: Ticks) -> None:
            async for _ in ticks:
                until = RealClock().now_ns() + 3_000_000
                while RealClock().now_ns() < until:
                    pass

        scheduler = Scheduler(no_fault)
        scheduler.add("slow", 1, 0.002, slow)
        scheduler.start()
        scheduler.end_at(20.0 * S)
        await asyncio.sleep(0.01)
        assert not scheduler.ended.done()
        scheduler.stop()

    runner(main())


class Suspended(RealClock):
    """A clock of a computer that sleeps when a test says so."""

    slept_ns = 0

    def suspended_ns(self) -> int:
        return self.slept_ns


def test_a_scheduler_is_told_that_the_computer_slept_before_any_task_runs() -> None:
    async def main() -> list[object]:
        loop, clock = asyncio.get_running_loop(), Suspended()
        assert isinstance(loop, RealTimeLoop)
        loop.clock = clock
        scheduler, seen = Scheduler(no_fault), list[object]()
        scheduler.on_sleep = seen.append

        def sleep() -> None:
            seen.append("asleep")
            clock.slept_ns += 3_600_000_000_000

        async def sleeper(ticks: Ticks) -> None:
            async for _ in ticks:
                seen.append("tick")
                clock.slept_ns += 1_000_000  # 1 ms: two clocks read
                if len(seen) == 2:
                    loop.call_soon(sleep)  # between two turns of the scheduler, where the computer is idle

        scheduler.add("sleeper", 0, 0.005, sleeper)
        scheduler.start()
        await until(lambda: "asleep" in seen and seen[-1] == "tick")
        scheduler.stop()
        return seen

    seen = run(main())
    assert seen[seen.index("asleep") + 1] == pytest.approx(3600.0, abs=0.5), "before another tick"
    assert seen.count("tick") == len(seen) - 2


def test_a_thread_has_the_interpreter_for_half_a_ms_while_the_loop_is_open() -> None:
    before = sys.getswitchinterval()

    async def interval() -> float:
        return sys.getswitchinterval()

    assert run(interval()) == pytest.approx(5e-4)
    assert sys.getswitchinterval() == before != pytest.approx(5e-4)


def test_time_asleep_is_read_to_a_millisecond() -> None:
    readings = [RealClock().suspended_ns() for _ in range(1000)]
    assert max(readings) - min(readings) < 1_000_000
