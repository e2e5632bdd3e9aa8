"""The whole robot with its terminal, run for a while in real time: ``python -m benchmarks.drawn_robot``.

`txt1 run` draws screens or prints its statistics, never both, so the punctuality benchmark starts this in a
pseudo-terminal instead. It is what `txt1 run --hal sim --log FILE` does, and at the end it writes one JSON object to a
file. What starts beside it, the drawing process above all, has `SETTLED` s to do so before cycles are counted, as the
peer has no such beginning; misses are counted from the beginning.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
from contextlib import AsyncExitStack
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from txt1.config import load
from txt1.driver import CommandSource
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.kit.app import real_time
from txt1.record.session import recording
from txt1.robot import Robot
from txt1.runtime import Runtime
from txt1.sidecar import SERVE_PRIORITY, TELEMETRY_PERIOD
from txt1.tasks import controller
from txt1.tasks.inputs import STEP
from txt1.telemetry.topics import Topic
from txt1.ui.terminal import Terminal

SETTLED: Final = 3.0  # s


def main() -> None:
    """Run the robot and write its report."""
    parser = argparse.ArgumentParser(prog="benchmarks.drawn_robot", description=__doc__)
    parser.add_argument("--duration", type=float, default=10.0, help="s")
    parser.add_argument("--report", type=Path, required=True, help="file for the JSON object")
    parser.add_argument("--log", type=Path, help="record to this file")
    parser.add_argument("--realtime", action="store_true", help="as of txt1 run")
    arguments = parser.parse_args()
    report = run(drawn(arguments.duration, arguments.log, arguments.realtime))
    arguments.report.write_text(json.dumps(report), encoding="utf-8")


async def drawn(duration: float, log: Path | None, with_rights: bool) -> dict[str, Any]:
    """The controller's lateness in `duration` s with the screens drawn; the robot is armed and drives in a circle."""
    config = load(None, ["hal=sim", "seed=1"]).config
    steps: list[tuple[int, float]] = []  # of all tasks by their numbers: when they began, s

    def take(topic: Topic[Any], value: tuple[int, float, int], time: float) -> None:
        steps.append(value[:2])

    async with recording(log, config, None, {}, print) as record, AsyncExitStack() as stack:

        def attach(runtime: Runtime) -> None:
            record(runtime)
            runtime.bus.subscribe(take, [STEP])

        robot = await stack.enter_async_context(Robot.open(config=config, attach=attach))
        if with_rights:
            stack.enter_context(real_time(robot))
        await robot.load_gains()
        terminal = await stack.enter_async_context(Terminal(robot))
        robot.add_task("screens", TELEMETRY_PERIOD, terminal.screens, SERVE_PRIORITY)
        robot.add_task("script", TELEMETRY_PERIOD, partial(circle, robot.source("script")))
        operator: asyncio.Future[Any] = asyncio.ensure_future(terminal.wait())
        await asyncio.wait({operator}, timeout=SETTLED)
        began, own, drawing = len(steps), _cpu_s(os.getpid()), _drawing()
        drawn_before = _cpu_s(drawing)
        await asyncio.wait({operator}, timeout=duration)
        if operator.done():
            raise SystemExit("the drawing process ended before the run did")
        operator.cancel()
        statistics = robot.runtime.statistics()
        number = list(statistics).index("controller")
        return {
            "late_s": [(now + 1e-9) % controller.CONTROL_PERIOD for task, now in steps[began:] if task == number],
            "misses": statistics["controller"].misses,
            "missed_at_s": missed_at([now for task, now in steps if task == number]),
            "robot_cpu_share": (_cpu_s(os.getpid()) - own) / duration,
            "drawing_cpu_share": (_cpu_s(drawing) - drawn_before) / duration,
        }


def missed_at(begun: list[float]) -> list[float]:
    """When cycles were missed, s: the ends of the gaps between those that have begun."""
    slots = [int((now + 1e-9) / controller.CONTROL_PERIOD) for now in begun]
    return [
        round(now, 2) for now, (before, after) in zip(begun[1:], pairwise(slots), strict=True) if after > before + 1
    ]


async def circle(wheel: CommandSource, ticks: Ticks) -> None:
    """Drive in a circle."""
    async for _ in ticks:
        wheel.command(0.4, 0.3)


def _drawing() -> int:
    """The id of the only process that this one has started."""
    children = [Path(each, "children").read_text(encoding="ascii") for each in Path("/proc/self/task").iterdir()]
    return int("".join(children))


def _cpu_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
