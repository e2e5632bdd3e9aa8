"""The browser's event loops, turned by hand as a browser's worker turns them."""

import asyncio
import concurrent.futures
from math import inf

import pytest

from txt1 import Robot
from txt1.kernel import loop as loops
from txt1_browser.event_loops import BrowserRealTimeLoop, BrowserVirtualLoop
from txt1_browser.lacking import AtOnce


async def _drives() -> list[object]:
    async with Robot.open("sim", seed=7) as robot:
        await robot.load_gains()
        for _ in range(100):
            robot.program.command(0.5, 0.3)
            await asyncio.sleep(0.02)
        return [robot.now, robot.odometry, robot.faults]


def idle(loop: BrowserRealTimeLoop) -> float:
    """Turn until nothing is due, which a busy computer needs several turns for; return the s until there is."""
    while (pause := loop.turn()) == 0.0:
        pass
    return pause


def test_in_virtual_time_a_robot_drives_to_the_last_bit_as_on_a_desk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "ThreadPoolExecutor", AtOnce)
    with asyncio.Runner(loop_factory=BrowserVirtualLoop) as runner:
        driven = runner.run(_drives())
    monkeypatch.undo()
    assert driven == loops.run(_drives(), speed="max")


def test_a_turn_in_real_time_returns_when_the_next_is_due_and_never_waits() -> None:
    loop = BrowserRealTimeLoop()
    called: list[str] = []
    loop.call_later(3600.0, called.append, "later")
    loop.call_soon(called.append, "now")
    assert 3500.0 < idle(loop) <= 3600.0
    assert called == ["now"]
    loop.close()


def test_without_timers_nothing_is_due() -> None:
    loop = BrowserRealTimeLoop()
    assert idle(loop) == inf
    loop.close()


def test_a_job_for_a_thread_is_done_at_once_and_its_error_is_passed_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(concurrent.futures, "ThreadPoolExecutor", AtOnce)
    loop = BrowserRealTimeLoop()

    async def jobs() -> int:
        with pytest.raises(ZeroDivisionError):
            await asyncio.to_thread(lambda: 1 // 0)
        return await asyncio.to_thread(len, "four")

    task = loop.create_task(jobs())
    assert idle(loop) == inf
    assert task.result() == 4
    assert not caplog.text, "nothing goes wrong in passing it on"
    loop.close()
