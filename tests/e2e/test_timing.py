"""The tasks keep their deadlines, and a step that stalls costs exactly the cycles it has to."""

import asyncio

import pytest

from txt1.hal.base import Indicators
from txt1.kernel.loop import clock_of
from txt1.robot import Robot

PERIODS = {
    "controller": 0.02, "encoder": 0.02, "driver": 0.05, "mode": 1.0, "display": 0.1, "odometry": 0.05,
    "battery": 1.0, "button": 0.1,
}  # fmt: skip
BEFORE_DISPLAY = ("controller", "encoder", "driver", "mode", "display")
"""What has run already at an instant at which the display task runs, by priority."""


def ms(seconds: float) -> int:
    return round(1000 * seconds)


def predicted_misses(name: str, stall: float) -> int:
    """Cycles of a task whose whole slot passes while a display step, started on time, takes `stall` seconds.

    All tasks are due when it starts. One that has run by then loses the slots after its present one that end before
    the stall does; one that has not loses its present slot too.
    """
    period, free = ms(PERIODS[name]), ms(stall)
    if name in BEFORE_DISPLAY:
        free -= period
    return max(free // period, 0)


@pytest.mark.parametrize("stall", [0.005, 0.019, 0.02, 0.03, 0.04, 0.05, 0.09, 0.13])
async def test_a_display_step_that_stalls_costs_the_predicted_misses_and_none_is_replayed(stall: float) -> None:
    clock = clock_of(asyncio.get_running_loop())
    async with Robot.open("sim", seed=1) as robot:
        indicate = robot.hal.indicate

        def stalling(indicators: Indicators) -> None:
            if 4.999 < robot.now < 5.001:  # the display's step at 5 s, when every task is due
                clock.spend(stall)  # type: ignore[attr-defined]
            indicate(indicators)

        robot.hal.indicate = stalling  # type: ignore[method-assign]
        robot.runtime.scheduler.end_at(10.0)
        await robot.runtime.scheduler.ended
        statistics = robot.runtime.statistics()
        for name, period in PERIODS.items():
            slots = round(10.0 / period)
            misses = predicted_misses(name, stall)
            assert (name, statistics[name].misses) == (name, misses)
            assert (name, statistics[name].cycles) == (name, slots - misses)
        late = ms(stall) % 20 if stall >= 0.02 else 0
        assert statistics["controller"].lateness.max_ns == late * 1_000_000


async def test_ten_minutes_without_a_stall_miss_nothing_and_drift_by_nothing() -> None:
    async with Robot.open("sim", seed=1) as robot:
        robot.runtime.scheduler.end_at(600.0)
        await robot.runtime.scheduler.ended
        for name, period in PERIODS.items():
            task = robot.runtime.statistics()[name]
            assert (task.cycles, task.misses, task.lateness.max_ns) == (round(600.0 / period), 0, 0)
