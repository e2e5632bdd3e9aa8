"""Faults of tasks: the scheduler makes the robot safe first, and then ends the run."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from scheduler_tasks import MS, Log, logging_task, virtual_clock

from txt1.errors import TaskFault
from txt1.kernel.loop import run
from txt1.kernel.scheduler import Scheduler
from txt1.kernel.ticks import Ticks


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
