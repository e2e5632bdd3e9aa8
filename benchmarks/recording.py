"""What recording costs: the speed of a simulation with and without it, and the share of a core on the real clock."""

from __future__ import annotations

import asyncio
import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

from benchmarks.rounds import interleave, spread, table, verdict
from txt1.config import load
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import Speed, run
from txt1.kernel.ticks import Ticks
from txt1.record.session import recording
from txt1.robot import REFRESH, Robot

SPEED_MIN: Final = 300.0
"""Simulated seconds per second while everything is recorded, at least."""
SHARE_MAX: Final = 0.01
"""Of a core, for recording on the real clock, at most."""
NO_WALLS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")


class Round(NamedTuple):
    """One round: wall and processor time of the process in s, controller cycles missed, bytes of the recording."""

    wall: float
    processor: float
    misses: int
    size: int


def main(*, quick: bool) -> None:
    """Print both."""
    rounds, simulated = (2, 60.0) if quick else (7, 300.0)
    contestants: dict[str, Callable[[], Round]] = {
        "without": partial(drive, False, simulated, "max"),
        "recorded": partial(drive, True, simulated, "max"),
    }
    for contestant in contestants.values():
        contestant()
    results = interleave(rounds, contestants)
    rows = []
    for name, each in results.items():
        speeds = [simulated / r.wall for r in each]
        limits = (f"{SPEED_MIN:.0f}", verdict(median(speeds) >= SPEED_MIN)) if name == "recorded" else ("", "")
        rows.append((name, spread(speeds, 0), f"{1000 * min(r.processor for r in each) / simulated:.2f}", *limits))
    table(
        f"Simulated seconds per second, driving, {rounds} interleaved rounds of {simulated:.0f} simulated s",
        ("", "median (smallest .. largest)", "least ms of processor per s", "limit", ""),
        rows,
    )
    rounds, duration = (1, 3.0) if quick else (5, 10.0)
    real = interleave(
        rounds, {"without": partial(drive, False, duration, None), "recorded": partial(drive, True, duration, None)}
    )
    shares = {name: min(r.processor for r in each) / duration for name, each in real.items()}
    cost = shares["recorded"] - shares["without"]
    misses = {name: sum(r.misses for r in each) for name, each in real.items()}
    size = median(r.size for r in real["recorded"]) / duration
    table(
        f"On the real clock, {rounds} interleaved rounds of {duration:.0f} s, the least processor time of each",
        ("", "share of a core", "controller cycles missed", "limit", ""),
        [
            ("without", f"{100 * shares['without']:.2f} %", str(misses["without"]), "", ""),
            ("recorded", f"{100 * shares['recorded']:.2f} %", str(misses["recorded"]), "", ""),
            (
                "the recording",
                f"{100 * cost:.2f} %",
                str(misses["recorded"] - misses["without"]),
                f"{100 * SHARE_MAX:.0f} %",
                verdict(cost <= SHARE_MAX),
            ),
        ],
    )
    print(f"\n  {size / 1000:.1f} kB on the disk per second")


def drive(recorded: bool, duration: float, speed: Speed) -> Round:
    """One round of a circle."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "run.mcap"
        round_ = run(_drive(path if recorded else None, duration, speed), speed=speed)
        return round_._replace(size=os.path.getsize(path) if recorded else 0)


async def _drive(path: Path | None, duration: float, speed: Speed) -> Round:
    config = load(None, NO_WALLS).config
    async with recording(path, config, speed, {}, print) as attach, Robot.open(config=config, attach=attach) as robot:
        await robot.load_gains()

        async def circle(ticks: Ticks) -> None:
            async for _ in ticks:
                robot.command(0.5, 0.5)

        robot.add_task("circle", REFRESH, circle)
        robot.runtime.scheduler.end_at(robot.now + duration)
        began, processor = stopwatch_ns(), time.process_time()
        await asyncio.wait({robot.runtime.scheduler.ended})
        misses = robot.runtime.statistics()["controller"].misses
        return Round((stopwatch_ns() - began) / NS_PER_S, time.process_time() - processor, misses, 0)
