"""A simulation on a busy computer: its time waits, it stays armed, and what was missed is counted on the wall clock."""

import asyncio
import time
from collections.abc import Callable

import pytest

from txt1.hal.base import Hal
from txt1.hal.registry import create_sim
from txt1.hal.sim import SimHal
from txt1.kernel.clock import HOLD_NS, NS_PER_S, SimulationClock
from txt1.kernel.loop import run
from txt1.kernel.slowness import Slowness
from txt1.robot import Robot

STALL = 0.5  # s
CYCLE = 0.02  # s, of the controller


class Stranger(SimHal):
    """A layer of another package that says it is simulated, and proves nothing."""

    waits = False


def stalled(
    hal: Hal | None, settings: tuple[str, ...] = (), begin: Callable[..., tuple[bool, str, float, int]] = run
) -> tuple[bool, str, float, int]:
    """Whether a robot is armed after this process stood still, why not, the time that passed for it, what it missed."""

    async def main() -> tuple[bool, str, float, int]:
        async with Robot.open(hal, settings=settings) as robot:
            misses, before = robot.runtime.statistics()["controller"].misses, robot.now
            time.sleep(STALL)  # nothing else of this process gets a turn, as beside other programs
            passed = robot.now - before
            while robot.runtime.statistics()["controller"].misses == misses:
                await asyncio.sleep(CYCLE)
            await asyncio.sleep(0.1)
            return robot.armed, robot.reason, passed, robot.runtime.statistics()["controller"].misses - misses

    return begin(main())


@pytest.mark.parametrize("begin", [run, asyncio.run])
def test_simulated_time_waits_for_a_busy_computer_and_the_car_stays_armed(
    begin: Callable[..., tuple[bool, str, float, int]],
) -> None:
    armed, reason, passed, missed = stalled(None, begin=begin)
    assert armed, reason
    assert passed < STALL / 2.0, "its time stood still"
    assert missed >= (STALL - 2.0 * CYCLE) / CYCLE, "on the wall clock these cycles were missed"


def test_a_layer_that_proves_nothing_is_disarmed_as_hardware_is() -> None:
    from txt1.config import load

    config = load().config
    layer = create_sim(config)
    armed, reason, passed, _ = stalled(Stranger(layer.vehicle, alone=True))
    assert not armed and "the controller missed" in reason
    assert passed >= STALL, "hardware waits for nobody"


def test_one_scheduler_of_hardware_is_enough_for_time_to_pass() -> None:
    clock = SimulationClock()
    due = clock.now_ns()

    def past() -> int:
        return due

    clock.join(past)
    time.sleep(0.05)
    assert clock.now_ns() == due + HOLD_NS
    clock.join(None)
    before = clock.now_ns()
    time.sleep(0.05)
    assert clock.now_ns() - before >= 0.05 * NS_PER_S
    clock.leave(None)
    clock.leave(past)
    assert clock.now_ns() - before >= 0.05 * NS_PER_S, "it never goes back"


@pytest.mark.parametrize(("held", "told"), [(0.0, ""), (0.05, ""), (1.5, "25 %"), (2.0, "0 %")])
def test_slow_time_is_told_with_its_remedy_first(held: float, told: str) -> None:
    now, waited = 0, 0.0
    clock: Callable[[], int] = lambda: now  # noqa: E731
    slowness = Slowness(lambda: waited, clock)
    assert slowness() == ""
    now, waited = 2 * NS_PER_S, held
    assert told in slowness() and slowness().startswith("end other programs" if told else "")
    assert len(slowness()) <= 60
    now += 2 * NS_PER_S
    assert slowness() == "", "two seconds without a delay end it"
