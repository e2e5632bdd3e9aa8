"""A day of the robot's time: all tasks, a board behind a line, and a recording; what it holds on to must not grow."""

import argparse
import asyncio
import gc
import os
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from torture import page
from torture.struck_robot import ENDLESS
from txt1.config import load
from txt1.errors import NotArmed
from txt1.kernel.clock import seconds, stopwatch_ns
from txt1.kernel.loop import run
from txt1.record.session import recording
from txt1.robot import Robot

EVERY: Final = 600.0  # s of the robot's time between two samples
WARM: Final = 0.2  # share of the run that is left out of the slope: buffers fill, caches warm up
MEMORY_SLOPE: Final = 0.5  # MB an hour that may be noise of the allocator


class Sample(NamedTuple):
    """Memory in MB, descriptors, threads and objects after so many hours."""

    hour: float
    memory: float
    descriptors: int
    threads: int
    objects: int


def sample(hour: float) -> Sample:
    """What the process holds on to now."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    memory = pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    objects = len(gc.get_objects())
    return Sample(hour, memory, len(os.listdir("/proc/self/fd")), threading.active_count(), objects)


async def soak(hours: float, folder: Path, minutes: float | None = None) -> list[Sample]:
    """Drive for so many hours of the robot's time, or so many real minutes; what was seen on the way."""
    settings = [*ENDLESS, "serial.port=virtual", "sim.battery.used_1=null", "serial.fault.drop=0.01"]
    config = load(None, settings, {}, {"hal": "serial", "seed": 1}).config
    samples = []
    until = inf if minutes is None else seconds(stopwatch_ns()) + 60.0 * minutes
    async with (
        recording(folder / "soak.mcap", config, "max", {}, lambda text: None) as attach,
        Robot.open(config=config, arm=True, attach=attach) as robot,
    ):
        await robot.load_gains()
        ends, due = 3600.0 * hours, 0.0
        while (now := robot.now) < ends and seconds(stopwatch_ns()) < until:
            if now >= due:
                samples.append(await asyncio.to_thread(sample, now / 3600.0))
                print(samples[-1], file=sys.stderr, flush=True)
                due += EVERY
            if not robot.armed:
                with suppress(NotArmed):
                    robot.arm()
            phase = int(now / 5.0) % 4
            robot.command((0.5, 0.3, -0.4, 0.0)[phase], (0.4, -0.3, 0.2, 0.0)[phase])
            await asyncio.sleep(0.05)
        samples.append(await asyncio.to_thread(sample, robot.now / 3600.0))
    return samples


def slope(samples: Sequence[Sample], values: Sequence[float]) -> float:
    """The growth an hour of the part that is warm."""
    cold = int(WARM * len(samples))
    hours = [each.hour for each in samples[cold:]]
    return float(np.polyfit(hours, values[cold:], 1)[0]) if len(hours) > 1 else 0.0


def main(words: Sequence[str] | None = None) -> int:
    """Soak; 1 if something grows."""
    parser = argparse.ArgumentParser(prog="python -m torture soak", description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0, help="of the robot's time")
    parser.add_argument("--minutes", type=float, help="end after so many real ones; what was done until then counts")
    parser.add_argument("--page", action="store_true", help="write the table into docs/results/reliability.md")
    options = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as folder:
        samples = run(soak(options.hours, Path(folder), options.minutes), speed="max")
    warm = samples[int(WARM * len(samples)) :]
    lines = [
        f"{samples[-1].hour:.1f} hours of the robot's time, {len(samples)} samples; growth of the last four fifths.",
        "",
        "| | after a fifth | at the end | growth an hour |",
        "|---|--:|--:|--:|",
    ]
    slopes = {}
    for name in ("memory", "descriptors", "threads", "objects"):
        values = [float(getattr(each, name)) for each in samples]
        slopes[name] = slope(samples, values)
        unit = " MB" if name == "memory" else ""
        first, last = (float(getattr(each, name)) for each in (warm[0], warm[-1]))
        lines.append(f"| {name}{unit} | {first:.1f} | {last:.1f} | {slopes[name]:+.3f} |")
    text = "\n".join(lines)
    print(text)
    if options.page:
        page.write("soak", text)
    grows = slopes["memory"] > MEMORY_SLOPE or abs(slopes["descriptors"]) > 0.1 or abs(slopes["threads"]) > 0.1
    return 1 if grows else 0


if __name__ == "__main__":
    sys.exit(main())
