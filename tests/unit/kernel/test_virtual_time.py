"""Virtual time: exact, repeatable, and standing still while a thread computes."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from scheduler_tasks import run_until

from tests.patience import LIMIT
from txt1.kernel.clock import Clock, RealClock, VirtualClock
from txt1.kernel.loop import VirtualTimeLoop, clock_of, run
from txt1.kernel.scheduler import Scheduler
from txt1.kernel.ticks import Ticks

HOUR = 3600.0


def now_ns() -> int:
    return clock_of(asyncio.get_running_loop()).now_ns()


def virtual_loop() -> VirtualTimeLoop:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    return loop


async def idle(ticks: Ticks) -> None:
    async for _ in ticks:
        pass


# -- the clock ---------------------------------------------------------------------------------------------------


def test_a_virtual_clock_starts_at_zero_and_stands_still() -> None:
    clock = VirtualClock()
    assert (clock.now_ns(), clock.now_ns()) == (0, 0)


def test_a_virtual_clock_refuses_to_go_backwards() -> None:
    clock = VirtualClock()
    clock.advance_to(5)
    clock.advance_to(5)
    with pytest.raises(ValueError, match="backwards: it is 5 ns, asked for 4 ns"):
        clock.advance_to(4)
    with pytest.raises(ValueError, match="backwards"):
        clock.spend(-1e-9)
    assert clock.now_ns() == 5


def test_spending_moves_a_virtual_clock_by_whole_nanoseconds() -> None:
    clock = VirtualClock()
    for _ in range(10):
        clock.spend(0.1)
    assert clock.now_ns() == 1_000_000_000


def test_every_loop_has_the_clock_its_timers_follow() -> None:
    async def clock() -> Clock:
        return clock_of(asyncio.get_running_loop())

    assert isinstance(run(clock(), speed="max"), VirtualClock)
    assert isinstance(run(clock(), speed=1e6), VirtualClock)
    assert isinstance(run(clock()), RealClock)
    assert isinstance(asyncio.run(clock()), RealClock)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("inf"), float("nan")])
def test_an_impossible_speed_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="speed must be 'max', a positive number"):
        run(asyncio.sleep(0.0), speed=speed)


# -- asyncio in virtual time -------------------------------------------------------------------------------------


def test_sleeping_takes_exactly_as_long_as_asked() -> None:
    async def main() -> list[int]:
        instants = []
        for duration in (0.0, 1e-9, 0.02, 0.1, 1.0, HOUR, 48 * HOUR):
            await asyncio.sleep(duration)
            instants.append(now_ns())
        return instants

    expected, total = [], 0
    for ns in (0, 1, 20_000_000, 100_000_000, 10**9, 3600 * 10**9, 48 * 3600 * 10**9):
        total += ns
        expected.append(total)
    assert run(main(), speed="max") == expected


def test_many_short_sleeps_do_not_drift() -> None:
    async def main() -> int:
        for _ in range(5000):
            await asyncio.sleep(0.02)
        return now_ns()

    assert run(main(), speed="max") == 5000 * 20_000_000


def test_a_sleep_for_the_remaining_time_ends_also_between_two_nanoseconds() -> None:
    async def main() -> int:
        loop, turns = asyncio.get_running_loop(), 0
        for k in range(1, 100):
            while loop.time() < k / 30 and turns < 1000:
                await asyncio.sleep(k / 30 - loop.time())
                turns += 1
        return turns

    assert run(main(), speed="max") <= 2 * 99


def test_sleepers_wake_in_the_order_of_their_instants() -> None:
    async def main() -> list[tuple[str, int]]:
        woken: list[tuple[str, int]] = []

        async def sleeper(name: str, duration: float) -> None:
            await asyncio.sleep(duration)
            woken.append((name, now_ns()))

        await asyncio.gather(sleeper("c", 3.0), sleeper("a", 1.0), sleeper("b", 2.0))
        return woken

    assert run(main(), speed="max") == [("a", 10**9), ("b", 2 * 10**9), ("c", 3 * 10**9)]


def test_a_time_out_fires_exactly_when_it_is_due() -> None:
    async def main() -> tuple[int, int]:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.sleep(HOUR), 0.25)
        first = now_ns()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.5):
                await asyncio.Event().wait()
        return first, now_ns()

    assert run(main(), speed="max") == (250_000_000, 750_000_000)


def test_what_ends_in_time_does_not_time_out() -> None:
    async def main() -> int:
        await asyncio.wait_for(asyncio.sleep(0.249999999), 0.25)
        return now_ns()

    assert run(main(), speed="max") == 249_999_999


def test_an_hour_of_sleeping_takes_no_real_hour() -> None:
    async def main() -> float:
        start = time.monotonic()
        await asyncio.sleep(HOUR)
        return time.monotonic() - start

    assert run(main(), speed="max") < HOUR / 100


def test_two_runs_repeat_exactly() -> None:
    async def main() -> list[tuple[int, str, int]]:
        events: list[tuple[int, str, int]] = []
        queue: asyncio.Queue[int] = asyncio.Queue()

        async def producer(name: int, period: float) -> None:
            for _ in range(40):
                await asyncio.sleep(period)
                events.append((now_ns(), "put", name))
                queue.put_nowait(name)

        async def consumer() -> None:
            while True:
                got = await queue.get()
                events.append((now_ns(), "got", got))
                await asyncio.sleep(0.001 * (got + 1))

        async def task(ticks: Ticks) -> None:
            async for now in ticks:
                events.append((now_ns(), "tick", round(now * 1e9)))

        scheduler = Scheduler(lambda name, error: None)
        scheduler.add("task", 1, 0.02, task)
        scheduler.start()
        reader = asyncio.create_task(consumer())
        await asyncio.gather(*(producer(k, 0.01 + 0.005 * (k % 3)) for k in range(6)))
        reader.cancel()
        scheduler.stop()
        return events

    first = run(main(), speed="max")
    assert first == run(main(), speed="max")
    assert [at for at, _, _ in first] == sorted(at for at, _, _ in first)
    assert len(first) > 400


# -- threads -----------------------------------------------------------------------------------------------------


def test_time_stands_still_while_a_thread_computes() -> None:
    async def main() -> None:
        release = threading.Event()
        job = asyncio.create_task(asyncio.to_thread(release.wait, LIMIT))
        ticked: list[int] = []

        async def ticker() -> None:
            while True:
                await asyncio.sleep(0.02)
                ticked.append(now_ns())

        ticking = asyncio.create_task(ticker())
        threading.Timer(0.02, release.set).start()  # meanwhile the loop has nothing to do but jump
        assert await job is True
        assert (now_ns(), ticked) == (0, [])
        await asyncio.sleep(0.1)
        assert len(ticked) in (4, 5)
        ticking.cancel()

    run(main(), speed="max")


def test_the_scheduler_waits_for_a_thread_too() -> None:
    async def main() -> tuple[int, int]:
        scheduler = Scheduler(lambda name, error: None)
        scheduler.add("task", 1, 0.02, idle)
        scheduler.start()
        await asyncio.sleep(0.05)
        before = scheduler.statistics()["task"].cycles
        await asyncio.to_thread(time.sleep, 0.02)
        after, at = scheduler.statistics()["task"].cycles, now_ns()
        scheduler.stop()
        assert before == after
        return after, at

    assert run(main(), speed="max") == (3, 50_000_000)


def test_a_time_out_cannot_overtake_the_thread_it_waits_for() -> None:
    async def main() -> tuple[str, int]:
        def compute() -> str:
            time.sleep(0.02)
            return "result"

        result = await asyncio.wait_for(asyncio.to_thread(compute), 0.001)
        return result, now_ns()

    assert run(main(), speed="max") == ("result", 0)


def test_time_stands_still_for_a_thread_whose_waiter_was_cancelled() -> None:
    async def main() -> tuple[int, bool]:
        started, release = threading.Event(), threading.Event()

        def compute() -> None:
            started.set()
            release.wait(LIMIT)

        waiter = asyncio.create_task(asyncio.to_thread(compute))
        await asyncio.sleep(0)
        started.wait(LIMIT)
        waiter.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiter
        threading.Timer(0.02, release.set).start()
        await asyncio.sleep(0.001)
        return now_ns(), release.is_set()

    assert run(main(), speed="max") == (1_000_000, True), "it woke while the thread was still computing"


def test_a_job_cancelled_before_it_began_does_not_stop_time_for_ever() -> None:
    async def main() -> int:
        loop = asyncio.get_running_loop()
        release = threading.Event()
        with ThreadPoolExecutor(1) as one_thread:
            busy = loop.run_in_executor(one_thread, release.wait, LIMIT)
            queued = loop.run_in_executor(one_thread, release.wait, LIMIT)
            queued.cancel()
            release.set()
            await busy
            await asyncio.sleep(1.0)
        assert virtual_loop().jumps.threads_outstanding == 0
        return now_ns()

    assert run(main(), speed="max") == 10**9


def test_a_thread_that_raises_lets_time_go_on() -> None:
    async def main() -> int:
        with pytest.raises(ZeroDivisionError):
            await asyncio.to_thread(lambda: 1 / 0)
        await asyncio.sleep(1.0)
        return now_ns()

    assert run(main(), speed="max") == 10**9


def test_a_thread_s_result_is_delivered_before_time_moves_on() -> None:
    async def main() -> list[tuple[str, int]]:
        events: list[tuple[str, int]] = []

        async def sleeper() -> None:
            await asyncio.sleep(1e-9)
            events.append(("woke", now_ns()))

        sleeping = asyncio.create_task(sleeper())
        for k in range(20):
            await asyncio.to_thread(time.sleep, 0.0)
            events.append((f"result {k}", now_ns()))
        await sleeping
        return events

    assert run(main(), speed="max") == [(f"result {k}", 0) for k in range(20)] + [("woke", 1)]


def test_no_thread_survives_the_run() -> None:
    async def main() -> None:
        await asyncio.gather(*(asyncio.to_thread(time.sleep, 0.001) for _ in range(4)))
        assert any(thread.name.startswith("txt1") for thread in threading.enumerate())

    before = set(threading.enumerate())
    run(main(), speed="max")
    assert set(threading.enumerate()) == before


def test_the_run_ends_only_after_a_thread_whose_waiter_was_cancelled() -> None:
    finished = []

    async def main() -> None:
        started = threading.Event()

        def compute() -> None:
            started.set()
            time.sleep(0.02)
            finished.append(True)

        waiter = asyncio.create_task(asyncio.to_thread(compute))
        await asyncio.sleep(0)
        started.wait(LIMIT)
        waiter.cancel()

    run(main(), speed="max")
    assert finished == [True]


def test_a_job_in_the_caller_s_own_executor_may_outlive_the_loop(caplog: pytest.LogCaptureFixture) -> None:
    release = threading.Event()
    with ThreadPoolExecutor(1) as own:

        async def main() -> None:
            asyncio.get_running_loop().run_in_executor(own, release.wait, LIMIT).cancel()

        run(main(), speed="max")
        release.set()
    assert caplog.records == []


# -- input at full speed -----------------------------------------------------------------------------------------


def test_input_is_noticed_while_coroutines_jump() -> None:
    async def main() -> int:
        reader, writer = os.pipe()
        noticed = asyncio.Event()
        asyncio.get_running_loop().add_reader(reader, noticed.set)
        os.write(writer, b"x")
        turns = 0
        while not noticed.is_set() and turns < 10_000:
            await asyncio.sleep(0.02)
            turns += 1
        asyncio.get_running_loop().remove_reader(reader)
        os.close(reader)
        os.close(writer)
        return turns

    assert run(main(), speed="max") <= 200


@pytest.mark.parametrize("others", [0, 1, 2])
def test_input_is_noticed_while_nothing_but_the_scheduler_runs(others: int) -> None:
    async def main() -> float:
        reader, writer = os.pipe()
        scheduler = Scheduler(lambda name, error: None)
        scheduler.add("fast", 2, 0.02, idle)
        for k in range(others):
            scheduler.add(f"slow {k}", 1, 0.1 + 0.07 * k, idle)
        asyncio.get_running_loop().add_reader(reader, lambda: scheduler.end_at(scheduler.now))
        os.write(writer, b"x")
        await run_until(scheduler, HOUR)
        asyncio.get_running_loop().remove_reader(reader)
        os.close(reader)
        os.close(writer)
        return scheduler.now

    assert run(main(), speed="max") <= 200 * 0.02


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_a_run_at_full_speed(number: signal.Signals) -> None:
    async def main() -> float:
        loop = asyncio.get_running_loop()
        scheduler = Scheduler(lambda name, error: None)

        async def one_second_in(ticks: Ticks) -> None:
            async for now in ticks:
                if now == 1.0:
                    os.kill(os.getpid(), number)

        scheduler.add("a", 1, 0.02, one_second_in)
        loop.add_signal_handler(number, lambda: scheduler.end_at(scheduler.now))
        await run_until(scheduler, HOUR)
        loop.remove_signal_handler(number)
        return scheduler.now

    assert 1.0 < run(main(), speed="max") <= 1.0 + 200 * 0.02


def test_ctrl_c_interrupts_a_run_at_full_speed() -> None:
    async def main() -> None:
        scheduler = Scheduler(lambda name, error: None)

        async def press(ticks: Ticks) -> None:
            async for now in ticks:
                if now == 1.0:
                    signal.raise_signal(signal.SIGINT)

        scheduler.add("a", 1, 0.02, press)
        scheduler.start()
        scheduler.end_at(HOUR)
        try:
            await scheduler.ended
        finally:
            assert scheduler.now < 2.0
            scheduler.stop()

    with pytest.raises(KeyboardInterrupt):
        run(main(), speed="max")


def test_a_busy_coroutine_that_never_sleeps_lets_input_in() -> None:
    async def main() -> int:
        reader, writer = os.pipe()
        noticed = asyncio.Event()
        asyncio.get_running_loop().add_reader(reader, noticed.set)
        os.write(writer, b"x")
        turns = 0
        while not noticed.is_set() and turns < 10_000:
            await asyncio.sleep(0)
            turns += 1
        asyncio.get_running_loop().remove_reader(reader)
        os.close(reader)
        os.close(writer)
        assert now_ns() == 0
        return turns

    assert run(main(), speed="max") <= 200


# -- paced virtual time ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [5.0, 50.0, 500.0])
def test_paced_time_never_runs_ahead_of_real_time(speed: float) -> None:
    async def main() -> list[float]:
        start = virtual_loop().real_start_ns / 1e9
        leads = []
        for _ in range(10):
            await asyncio.sleep(0.002 * speed)
            # an upper limit to how much virtual time the real time so far allows
            leads.append(virtual_loop().time() - speed * (time.monotonic() - start))
        return leads

    assert max(run(main(), speed=speed)) < 1e-6 * speed


def test_paced_time_counts_from_the_making_of_the_loop() -> None:
    before = RealClock().now_ns()

    async def main() -> tuple[float, float]:
        await asyncio.sleep(2.0)
        return virtual_loop().time(), (RealClock().now_ns() - before) / 1e9 * 100.0

    virtual, allowed = run(main(), speed=100.0)
    assert virtual <= allowed


def test_paced_time_stays_exact() -> None:
    async def main() -> int:
        for _ in range(50):
            await asyncio.sleep(0.02)
        return now_ns()

    assert run(main(), speed=1e6) == 10**9


def test_input_during_a_paced_wait_finds_time_between_the_timers() -> None:
    async def main() -> None:
        loop = virtual_loop()
        sleeper = asyncio.create_task(asyncio.sleep(1000.0 * LIMIT))

        async def passed() -> int:
            seen: asyncio.Future[int] = loop.create_future()
            before = now_ns()
            threading.Timer(0.02, lambda: loop.call_soon_threadsafe(lambda: seen.set_result(now_ns()))).start()
            at = await seen
            assert before <= at <= 10 * (RealClock().now_ns() - loop.real_start_ns)
            return at - before

        # input that is there before the loop waits finds no time; a stall does that to some
        for _ in range(100):
            if await passed() > 0:
                break
        else:
            pytest.fail("no time has passed while input was awaited")
        assert not sleeper.done()
        sleeper.cancel()

    run(main(), speed=10.0)


def test_paced_time_passes_while_nothing_but_input_is_awaited() -> None:
    async def main() -> None:
        loop = virtual_loop()
        seen: asyncio.Future[None] = loop.create_future()
        threading.Timer(0.02, lambda: loop.call_soon_threadsafe(seen.set_result, None)).start()
        # the input may come before it is awaited, if this thread is held up in between
        before = RealClock().now_ns()
        await seen
        assert now_ns() >= 1000 * 20_000_000 - 1000 * (before - loop.real_start_ns)
        assert now_ns() <= 1000 * (RealClock().now_ns() - loop.real_start_ns)

    run(main(), speed=1000.0)


# -- jumping from within a callback ------------------------------------------------------------------------------


def test_a_callback_may_jump_only_when_nothing_else_comes_first() -> None:
    async def main() -> None:
        loop = virtual_loop()

        def jumps_to(ns: int) -> bool:
            loop.jumps.made = 0  # not this time the polling
            return loop.jumps.to(ns, loop.timers)

        assert jumps_to(10)
        assert now_ns() == 10
        due = loop.call_at(20e-9, lambda: None)
        assert not jumps_to(20), "a timer at the same instant goes first"
        assert not jumps_to(21)
        assert jumps_to(19)
        due.cancel()
        await asyncio.sleep(1e-9)
        loop.call_soon(lambda: None)
        assert not jumps_to(100), "a callback is ready"
        await asyncio.sleep(0)
        assert jumps_to(100)
        loop.jumps.threads_outstanding += 1
        assert not jumps_to(200), "a thread is computing"
        loop.jumps.threads_outstanding -= 1
        assert now_ns() == 100

    run(main(), speed="max")


def test_paced_time_is_not_jumped_by_a_callback() -> None:
    async def main() -> bool:
        loop = virtual_loop()
        return loop.jumps.to(10, loop.timers)

    assert run(main(), speed=1e6) is False


@pytest.mark.parametrize("in_thread", [False, True])
def test_a_timer_less_than_a_nanosecond_behind_another_comes_a_nanosecond_later(in_thread: bool) -> None:
    async def main() -> list[float]:
        loop, times = asyncio.get_running_loop(), list[float]()
        loop.call_at(1.0, lambda: times.append(loop.time()))
        loop.call_at(1.0 + 4e-10, lambda: times.append(loop.time()))
        if in_thread:
            await loop.run_in_executor(None, time.sleep, 0.001)
        await asyncio.sleep(2.0)
        return times

    assert run(main(), speed="max") == [1.0, 1.000000001]
