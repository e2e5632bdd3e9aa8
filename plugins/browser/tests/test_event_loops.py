"""The browser's event loops, turned by hand as a browser's worker turns them."""

import asyncio
from math import inf

import pytest

from txt1 import Robot
from txt1.kernel import loop as loops
from txt1.kernel.loop import VirtualTimeLoop
from txt1_browser.event_loops import BrowserLoop, BrowserRealTimeLoop, BrowserVirtualLoop


async def _drives() -> list[object]:
    async with Robot.open("sim", seed=7) as robot:
        await robot.load_gains()
        for _ in range(100):
            robot.program.command(0.5, 0.3)
            await asyncio.sleep(0.02)
        return [robot.now, robot.odometry, robot.faults]


def turned(loop: BrowserLoop) -> list[object]:
    task = loop.create_task(_drives())
    while not task.done():
        assert loop.turn() < inf or task.done()
    loop.close()
    return task.result()


def test_in_virtual_time_a_robot_drives_to_the_last_bit_as_on_a_desk() -> None:
    assert turned(BrowserVirtualLoop()) == loops.run(_drives(), speed="max")


def test_a_loop_in_virtual_time_is_taken_for_one() -> None:
    loop = BrowserVirtualLoop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.close()


def test_a_turn_in_real_time_returns_when_the_next_is_due_and_never_waits() -> None:
    loop = BrowserRealTimeLoop()
    called: list[str] = []
    loop.call_later(3600.0, called.append, "later")
    loop.call_soon(called.append, "now")
    assert 3500.0 < loop.turn() <= 3600.0
    assert called == ["now"]
    loop.close()


def test_without_timers_nothing_is_due() -> None:
    loop = BrowserRealTimeLoop()
    assert loop.turn() == inf
    loop.close()


def test_a_job_for_a_thread_is_done_at_once_and_its_error_is_passed_on() -> None:
    loop = BrowserRealTimeLoop()

    async def jobs() -> int:
        with pytest.raises(ZeroDivisionError):
            await asyncio.to_thread(lambda: 1 // 0)
        return await asyncio.to_thread(len, "four")

    task = loop.create_task(jobs())
    loop.turn()
    assert task.result() == 4
    loop.close()
