"""The whole robot with its terminal, run for a while in real time: ``python -m benchmarks.drawn_robot``.

`txt1 run` draws screens or prints its statistics, never both, so the punctuality benchmark starts this in a
pseudo-terminal instead. It is what `txt1 run --hal sim` does, and at the end it writes one JSON object to a file.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import resource
from pathlib import Path
from typing import Any

from txt1.beside import PERIOD, PRIORITY
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.ui.terminal import Terminal


def main() -> None:
    """Run the robot and write its report."""
    parser = argparse.ArgumentParser(prog="benchmarks.drawn_robot", description=__doc__)
    parser.add_argument("--duration", type=float, default=10.0, help="s")
    parser.add_argument("--report", type=Path, required=True, help="file for the JSON object")
    arguments = parser.parse_args()
    report = run(drawn(arguments.duration))
    # the drawing process has been waited for by now
    report["drawing_cpu_s"] = _cpu_s(resource.RUSAGE_CHILDREN)
    arguments.report.write_text(json.dumps(report), encoding="utf-8")


async def drawn(duration: float) -> dict[str, Any]:
    """The controller's statistics after `duration` seconds with the screens drawn; the robot is armed and idle."""
    async with Robot.open(hal="sim", seed=1) as robot:
        await robot.load_gains()
        ended: asyncio.Future[Any] = robot.runtime.scheduler.ended
        robot.runtime.scheduler.end_at(robot.now + duration)
        began, cpu_s = robot.now, _cpu_s(resource.RUSAGE_SELF)
        async with Terminal(robot) as terminal:
            robot.add_task("screens", PERIOD, terminal.screens, PRIORITY)
            operator: asyncio.Future[Any] = asyncio.ensure_future(terminal.wait())
            await asyncio.wait({ended, operator}, return_when=asyncio.FIRST_COMPLETED)
            lost = operator.done()
            operator.cancel()
            cpu_s = _cpu_s(resource.RUSAGE_SELF) - cpu_s
            took = robot.now - began
        if lost:
            raise SystemExit("the drawing process ended before the run did")
        controller = robot.runtime.statistics()["controller"]
        p50, p99, _, longest = controller.lateness.percentiles()
        return {
            "cycles": controller.cycles,
            "misses": controller.misses,
            "p50_s": p50,
            "p99_s": p99,
            "max_s": longest,
            "robot_cpu_share": cpu_s / took,
            "duration_s": took,
        }


def _cpu_s(who: int) -> float:
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
