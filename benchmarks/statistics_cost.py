"""What the scheduler's statistics cost: a share of a tick that does nothing at all."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from statistics import median

from benchmarks import ticking
from benchmarks.rounds import interleave, spread, table
from txt1.kernel.clock import stopwatch_ns
from txt1.kernel.statistics import TaskStatistics


def main(*, quick: bool) -> None:
    """Print the cost of measuring one tick beside the cost of the tick itself."""
    rounds, simulated = (3, 60.0) if quick else (9, 300.0)
    ticks = round(simulated * sum(ticking.RATES))
    contestants: dict[str, Callable[[], float]] = {
        "empty tick on a bare heap": partial(ticking.bare_heap_us, simulated),
        "empty tick under our Scheduler": partial(ticking.scheduler_us, simulated),
        "statistics: clock readings": partial(clock_readings_us, ticks),
        "statistics: both histograms": partial(histograms_us, ticks),
    }
    results = interleave(rounds, contestants)
    bare, whole = (median(results[name]) for name in list(contestants)[:2])
    rows = [
        (name, spread(costs, 3), f"{100 * median(costs) / bare:.0f} %", f"{100 * median(costs) / whole:.0f} %")
        for name, costs in results.items()
    ]
    table(
        f"Cost of the statistics per tick, us, {rounds} interleaved rounds of {ticks} ticks",
        ("", "median (smallest .. largest)", "of the bare tick", "of the Scheduler's"),
        rows,
    )


def clock_readings_us(ticks: int) -> float:
    """Microseconds per tick for the two readings of the stopwatch, the empty loop taken off."""
    empty = _empty_loop_ns(ticks)
    began = stopwatch_ns()
    for _ in range(ticks):
        started = stopwatch_ns()
        stopwatch_ns() - started
    return (stopwatch_ns() - began - empty) / ticks / 1e3


def histograms_us(ticks: int) -> float:
    """Microseconds per tick for adding to the histograms of lateness (0 in virtual time) and run time."""
    task = TaskStatistics()
    add_lateness, add_run_time = task.lateness.add, task.run_time.add
    empty = _empty_loop_ns(ticks)
    began = stopwatch_ns()
    for tick in range(ticks):
        add_run_time(1000 + (tick & 0x3FFF))  # 1 to 17 us, as the robot's steps take
        add_lateness(0)
    return (stopwatch_ns() - began - empty) / ticks / 1e3


def _empty_loop_ns(ticks: int) -> int:
    began = stopwatch_ns()
    for _ in range(ticks):
        pass
    return stopwatch_ns() - began
