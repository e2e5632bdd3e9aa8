"""How many seconds of all robots' time together pass in one of ours when several drive in one world.

Each drives a circle of its own, 3 m from the next, in virtual time, commanded at 20 Hz; every one has all its tasks.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
from contextlib import AsyncExitStack
from functools import partial
from math import inf
from statistics import median
from typing import Final

from benchmarks.rounds import interleave, spread, table, verdict
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.robot import REFRESH, Robot
from txt1.sim.world import World

COUNTS: Final = (1, 2, 5, 10, 20, 50)

LIMIT: Final = {10: 60.0}
"""Simulated seconds of the world per second with so many robots, at least."""

SHARE_LIMIT: Final = {10: 1.2, 50: 1.5}
"""A robot among so many costs at most so much more than one alone."""

APART: Final = 3.0
"""Metres between two robots."""


def main(*, quick: bool) -> None:
    """Print speed and cost per robot."""
    rounds, simulated = (2, 20.0) if quick else (7, 60.0)
    results = interleave(rounds, {str(count): partial(drive, count, simulated) for count in COUNTS})
    alone = median(results[str(COUNTS[0])])
    rows = []
    peak = {count: _peak(count) for count in COUNTS}
    for count in COUNTS:
        walls = results[str(count)]
        speed, cost = simulated / median(walls), median(walls) / count / alone
        met = speed >= LIMIT.get(count, 0.0) and cost <= SHARE_LIMIT.get(count, inf)
        memory = f"{(peak[count] - peak[COUNTS[0]]) / max(1, count - COUNTS[0]) / 1e3:.1f} MB" if count > 1 else ""
        rows.append(
            (str(count), spread([simulated / wall for wall in walls], 0), f"{cost:.2f} x", memory, verdict(met))
        )
    table(
        f"Simulated seconds per second with several robots, {rounds} interleaved rounds of {simulated:.0f} simulated s "
        "(at 10: at least 60, cost at most 1.2 x; at 50: cost at most 1.5 x)",
        ("robots", "median (smallest .. largest)", "cost per robot", "memory each", ""),
        rows,
    )


def _peak(count: int) -> int:
    """The most memory that a process with so many robots has taken, kB."""
    code = f"import benchmarks.robots as b; b.drive({count}, 2.0); print(open('/proc/self/status').read())"
    status = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    return int(status.partition("VmHWM:")[2].split()[0])


def drive(count: int, simulated: float) -> float:
    """Wall time, s, that so many robots take to drive for `simulated` s."""
    return run(_drive(count, simulated), speed="max")


async def _drive(count: int, simulated: float) -> float:
    world = World()
    async with AsyncExitStack() as stack:
        for number in range(count):
            start = f"sim.start=[{APART * number}, 0, 0]"
            robot = await stack.enter_async_context(
                Robot.open("sim", world=world, name=f"txt{number}", settings=[start])
            )
            await robot.load_gains()

            async def circle(ticks: Ticks, robot: Robot = robot) -> None:
                async for _ in ticks:
                    robot.command(0.5, 0.5)

            robot.add_task("circle", REFRESH, circle)
        await asyncio.sleep(0.5)
        began = stopwatch_ns()
        await asyncio.sleep(simulated)
        return (stopwatch_ns() - began) / NS_PER_S
