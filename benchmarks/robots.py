"""How many seconds of all robots' time together pass in one of ours when several drive in one world.

Each drives a circle of its own, 3 m from the next, in virtual time, commanded at 20 Hz; every one has all its tasks.
"""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from functools import partial
from statistics import median
from typing import Final

from benchmarks.rounds import interleave, spread, table, verdict
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.robot import REFRESH, Robot
from txt1.sim.world import World

COUNTS: Final = (1, 2, 5, 10)

LIMIT: Final = 60.0
"""Simulated seconds of the world per second with the most robots, at least."""

SHARE_LIMIT: Final = 1.2
"""A robot among the most costs at most so much more than one alone."""

APART: Final = 3.0
"""Metres between two robots."""


def main(*, quick: bool) -> None:
    """Print speed and cost per robot."""
    rounds, simulated = (2, 20.0) if quick else (7, 60.0)
    results = interleave(rounds, {str(count): partial(drive, count, simulated) for count in COUNTS})
    alone = median(results[str(COUNTS[0])])
    rows = []
    for count in COUNTS:
        walls = results[str(count)]
        speed, cost = simulated / median(walls), median(walls) / count / alone
        met = (speed >= LIMIT and cost <= SHARE_LIMIT) if count == COUNTS[-1] else True
        rows.append((str(count), spread([simulated / wall for wall in walls], 0), f"{cost:.2f} x", verdict(met)))
    table(
        f"Simulated seconds per second with several robots, {rounds} interleaved rounds of {simulated:.0f} simulated s "
        f"(at {COUNTS[-1]}: at least {LIMIT:.0f}, cost at most {SHARE_LIMIT} x)",
        ("robots", "median (smallest .. largest)", "cost per robot", ""),
        rows,
    )


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
