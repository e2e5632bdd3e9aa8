"""How many seconds of the robot's time pass in one of ours, where the time goes, and what a tick costs.

The whole system runs in virtual time: every task, both velocity loops, the safety gate, the vehicle, the batteries.
Driving means a circle, commanded at 20 Hz by a task of the user's, in a room without walls.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Final, NamedTuple

from benchmarks import ticking
from benchmarks.rounds import interleave, spread, table, verdict
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import run
from txt1.kernel.statistics import Histogram
from txt1.kernel.ticks import Ticks
from txt1.robot import REFRESH, Robot

LIMIT: Final = 500.0
"""Simulated seconds per second, at least."""

SIMULATED: Final = 300.0
"""Simulated seconds in a round."""

NO_WALLS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
SHARES: Final = 200


class Round(NamedTuple):
    """One round: wall time in s, and for every task its cycles and the wall time its steps took, s."""

    wall_s: float
    tasks: dict[str, tuple[int, float]]


def main(*, quick: bool) -> None:
    """Print speed, break-down by task, and costs per tick."""
    rounds, simulated = (2, 60.0) if quick else (7, SIMULATED)
    contestants = {name: partial(whole_system, name == "driving", simulated) for name in ("idle", "driving")}
    for contestant in contestants.values():
        contestant()  # the interpreter specialises the code it has run often
    results = interleave(rounds, contestants)
    rows = []
    for name, round_results in results.items():
        speeds = [simulated / r.wall_s for r in round_results]
        rows.append((name, spread(speeds, 0), f"{LIMIT:.0f}", verdict(median(speeds) >= LIMIT)))
    table(
        f"Simulated seconds per second, whole system, {rounds} interleaved rounds of {simulated:.0f} simulated s",
        ("", "median (smallest .. largest)", "limit", ""),
        rows,
    )
    for name, round_results in results.items():
        break_down(name, round_results, simulated)
    cost_per_tick(rounds, simulated)


def whole_system(driving: bool, simulated: float) -> Round:
    """One round of the robot, idle or driving, in virtual time."""
    return run(_whole_system(driving, simulated), speed="max")


async def _whole_system(driving: bool, simulated: float) -> Round:
    async with Robot.open(hal="sim", seed=1, settings=NO_WALLS) as robot:
        await robot.load_gains()

        async def circle(ticks: Ticks) -> None:
            async for _ in ticks:
                robot.command(0.5, 0.5)

        if driving:
            robot.add_task("circle", REFRESH, circle)
        robot.runtime.scheduler.end_at(robot.now + simulated)
        # What ran before, about a second of the robot's time, is in the tasks' statistics too: 0.3 % of them.
        began = stopwatch_ns()
        await asyncio.wait({robot.runtime.scheduler.ended})
        wall_s = (stopwatch_ns() - began) / NS_PER_S
        if driving and not (robot.armed and abs(robot.odometry.v - 0.5) < 0.1):
            raise SystemExit(f"simulation_speed: the robot was to drive a circle; {robot.odometry} {robot.reason}")
        return Round(
            wall_s,
            {
                name: (task.cycles, task.cycles * mean_ns(task.run_time) / NS_PER_S)
                for name, task in robot.runtime.statistics().items()
            },
        )


def mean_ns(durations: Histogram) -> float:
    """The mean of a histogram's durations: its percentiles, averaged."""
    return sum(durations.percentiles_ns(*((i + 0.5) / SHARES for i in range(SHARES)))) / SHARES


def break_down(name: str, results: list[Round], simulated: float) -> None:
    """Print where the time goes, per simulated second; the median over the rounds, task by task."""
    wall = median(r.wall_s for r in results) / simulated
    rows: list[tuple[str, ...]] = []
    in_tasks = 0.0
    cycles_in_all = 0
    for task, (cycles, _) in results[0].tasks.items():
        per_s = median(r.tasks[task][1] for r in results) / simulated
        in_tasks += per_s
        cycles_in_all += cycles
        rows.append((task, *_costs(cycles / simulated, per_s, wall)))
    rows.sort(key=lambda row: -float(row[2]))
    rows.append(("kernel: heap, jumps, statistics", *_costs(cycles_in_all / simulated, wall - in_tasks, wall)))
    rows.append(("all", *_costs(cycles_in_all / simulated, wall, wall)))
    table(
        f"Where the time goes, {name}, per simulated second (medians; a task's steps include one clock reading)",
        ("task", "ticks", "us", "us/tick", "share"),
        rows,
    )


def _costs(ticks: float, seconds: float, wall: float) -> tuple[str, ...]:
    return (
        f"{ticks:.0f}",
        f"{1e6 * seconds:.0f}",
        f"{1e6 * seconds / ticks:.2f}" if ticks else "-",
        f"{100 * seconds / wall:.0f} %",
    )


def cost_per_tick(rounds: int, simulated: float) -> None:
    """Print what a tick of an empty task costs here, and in two other ways."""
    contestants: dict[str, Callable[[], float]] = {
        "bare heap of coroutines": partial(ticking.bare_heap_us, simulated),
        "our Scheduler": partial(ticking.scheduler_us, simulated),
        "asyncio.sleep on our virtual loop": partial(ticking.asyncio_us, simulated),
    }
    results = interleave(rounds, contestants)
    bare = median(results["bare heap of coroutines"])
    table(
        f"Cost of an empty tick, us, six tasks at {'+'.join(map(str, ticking.RATES))} Hz",
        ("", "median (smallest .. largest)", "to the bare heap"),
        [(name, spread(costs), f"{median(costs) / bare:.1f} x") for name, costs in results.items()],
    )
