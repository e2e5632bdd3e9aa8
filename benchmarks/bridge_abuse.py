"""Bridges that misbehave, beside a robot in real time: ``python -m benchmarks.bridge_abuse``.

In interleaved rounds the robot runs with and without five bridges that hang, write 100 000 messages a second, are
stopped (SIGSTOP), are killed and started again, and leak 1 GB. What counts: no controller cycle missed, and a 99th
percentile of its lateness within the spread of the rounds without. Then, one bridge at a time, how long its last
command lives. For a quiet machine; 12 rounds of 60 s take 24 minutes.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import time
from collections import Counter
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from functools import partial
from typing import Any, Final, NamedTuple

from benchmarks.rounds import interleave, spread, table, verdict
from txt1.bridges.registry import BRIDGES, bridge
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.robot import Robot
from txt1.sidecar import Connection, Restart, Sidecar

ABUSES: Final = ("hang", "flood", "stop", "kill", "leak")
STALE: Final = 0.25 + 0.02
"""s: the safety gate's time-out and one tick."""
AGAIN: Final = 5.0
"""s between two kills."""


# -- the bridges -----------------------------------------------------------------------------------------------


def drive(connection: Connection) -> None:
    """Command 20 times a second: what is stopped or killed."""
    while True:
        connection.receive(0.05)
        connection.request("drive", v=0.5, omega=0.0)


def hang(connection: Connection) -> None:
    """Command for a second, then hang."""
    until = time.monotonic() + 1.0
    while time.monotonic() < until:
        connection.receive(0.05)
        connection.request("drive", v=0.5, omega=0.0)
    time.sleep(3600.0)


def flood(connection: Connection, rate: float = 1e5) -> None:
    """Write `rate` messages a second, as far as the line takes them."""
    began, sent = time.monotonic(), 0
    while True:
        line = b'{"time": %d, "request": "drive", "v": 0.5, "omega": 0.0}\n' % time.monotonic_ns()
        os.write(connection.fileno(), line * 100)
        sent += 100
        time.sleep(max(0.0, began + sent / rate - time.monotonic()))


def leak(connection: Connection, total: int = 1 << 30) -> None:
    """Take 1 GB within 20 s and keep it; at the limit the process fails, and begins anew."""
    kept = []
    while True:
        connection.receive(0.05)
        connection.request("drive", v=0.5, omega=0.0)
        if len(kept) < 400:
            kept.append(b"x" * (total // 400))


# -- a round ---------------------------------------------------------------------------------------------------


class Round(NamedTuple):
    """What came of one: the controller's misses, the percentiles of its lateness in s, messages read and dropped."""

    misses: int
    p50: float
    p99: float
    longest: float
    counts: Counter[str]


async def abused(duration: float, abuses: tuple[str, ...]) -> Round:
    """Run the robot for `duration` s beside these bridges; it is armed and drives as far as they let it."""
    counts: Counter[str] = Counter()
    async with Robot.open(hal="sim", seed=1) as robot, AsyncExitStack() as stack:
        await robot.load_gains()
        at_work: dict[str, Sidecar] = {}
        for name in abuses:
            started = bridge(robot, name, restart=Restart(5, 0.5), silence=10.0)
            at_work[name] = await stack.enter_async_context(started)
        until, again = robot.now + duration, robot.now
        while robot.now < until:
            await asyncio.sleep(0.5)
            if robot.now >= again:
                again = robot.now + AGAIN
                for name, number in (("stop", signal.SIGSTOP), ("kill", signal.SIGKILL)):
                    if name in at_work and at_work[name].pid is not None:
                        os.kill(at_work[name].pid or 0, number)
        for beside in at_work.values():
            counts += beside.counts
        controller = robot.runtime.statistics()["controller"]
        p50, p99, _, longest = controller.lateness.percentiles()
        return Round(controller.misses, p50, p99, longest, counts)


# -- time to stale ---------------------------------------------------------------------------------------------


async def time_to_stale(abuse: str) -> float:
    """S from a bridge's end, or its last command, until the set-point is zero."""
    async with Robot.open(hal="sim", seed=1) as robot:
        await robot.load_gains()
        stale: asyncio.Future[float] = asyncio.get_running_loop().create_future()
        driven = 0.0

        async def watch(ticks: Ticks) -> None:
            nonlocal driven
            async for now in ticks:
                if robot.runtime.state.control.v:
                    driven = driven or now
                elif driven and not stale.done():
                    stale.set_result(now)

        robot.add_task("watch", 0.02, watch, -10)
        async with bridge(robot, abuse, restart=Restart(), silence=None) as beside:
            while not driven:
                await asyncio.sleep(0.01)
            if abuse == "hang":
                while robot.now < driven + 0.9:
                    await asyncio.sleep(0.01)
                last = robot.now
                while not beside.counts["silent"]:
                    last = robot.runtime.state.command.time if robot.runtime.state.command else last
                    await asyncio.sleep(0.005)
                return await stale - last
            await asyncio.sleep(0.5)
            since = robot.now
            os.kill(beside.pid or 0, signal.SIGSTOP if abuse == "stop" else signal.SIGKILL)
            return await stale - since


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.bridge_abuse", description=__doc__)
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--duration", type=float, default=60.0, metavar="S", help="of a round")
    parser.add_argument("--abuse", choices=ABUSES, action="append", help="only this one; may be given again")
    arguments = parser.parse_args()
    abuses = tuple(arguments.abuse or ABUSES)
    for name in ABUSES:
        function = "drive" if name in ("stop", "kill") else name
        BRIDGES.ours[name] = f"benchmarks.bridge_abuse:{function}"

    def contestant(names: tuple[str, ...]) -> Callable[[], Round]:
        work: Callable[[], Coroutine[Any, Any, Round]] = partial(abused, arguments.duration, names)
        return lambda: run(work())

    results = interleave(arguments.rounds, {"without": contestant(()), ", ".join(abuses): contestant(abuses)})
    table(
        f"lateness of the controller in µs, {arguments.rounds} rounds of {arguments.duration:g} s",
        ("beside it", "missed", "p50", "p99", "longest"),
        [
            (
                name,
                str(sum(each.misses for each in rounds)),
                *(
                    spread([1e6 * share for share in shares], 0)
                    for shares in zip(*((each.p50, each.p99, each.longest) for each in rounds), strict=True)
                ),
            )
            for name, rounds in results.items()
        ],
    )
    without, beside = results.values()
    within = sorted(each.p99 for each in beside)[len(beside) // 2] <= max(each.p99 for each in without)
    total: Counter[str] = Counter()
    for each in beside:
        total += each.counts
    print(f"\nno cycle missed: {verdict(not any(each.misses for each in beside))}")
    print(f"median p99 within the spread of the rounds without: {verdict(within)}")
    print(", ".join(f"{name} {count}" for name, count in sorted(total.items())))
    for name in ("hang", "stop", "kill"):
        took = [run(time_to_stale(name)) for _ in range(3)]
        print(f"time to stale, {name}: {spread(took, 3)} s, at most {STALE:g}: {verdict(max(took) <= STALE + 0.002)}")


if __name__ == "__main__":
    main()
