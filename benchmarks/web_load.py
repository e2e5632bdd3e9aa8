"""Many pages at once: ``python -m benchmarks.web_load``.

In interleaved rounds a robot runs with its page's server alone, and with 50 pages that watch, one that drives and one
that sends 10 000 messages a second, all in a process of their own. What counts: the 99th percentile of the controller's
lateness within the spread of the rounds without pages; and the time from a page's input to the robot's set-point.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import subprocess
import sys
from contextlib import suppress
from functools import partial
from time import monotonic, sleep
from typing import Any, Final, NamedTuple

import aiohttp

from benchmarks.rounds import interleave, spread, table, verdict
from tests.browser.live import live

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")
FLOOD: Final = 10_000  # messages a second


# -- the pages, in a process of their own ------------------------------------------------------------------------


async def page(url: str, work: Any = None) -> int:
    """A page that takes telemetry and answers pings; returns how many messages it took."""
    taken = 0
    headers = {"Origin": url.rstrip("/")}
    async with aiohttp.ClientSession(headers=headers) as client, client.ws_connect(f"{url}socket") as socket:
        task = None if work is None else asyncio.create_task(work(socket))
        async for message in socket:
            taken += 1
            if message.data.startswith('{"page"'):
                said = json.loads(message.data)
                await socket.send_str(json.dumps({"do": "pong", "ping": said["ping"], "t": monotonic()}))
        if task is not None:
            task.cancel()
    return taken


async def drive(socket: aiohttp.ClientWebSocketResponse, sent: list[tuple[float, float]]) -> None:
    """Command 25 times a second, each time another speed, and note when."""
    await asyncio.sleep(1.5)
    for number in range(10**9):
        v = 0.3 + 1e-4 * (number % 1000)
        time = monotonic()
        sent.append((v, time))
        await socket.send_str(json.dumps({"do": "drive", "v": v, "omega": 0.0, "n": number, "t": time}))
        await asyncio.sleep(0.04)


async def flood(socket: aiohttp.ClientWebSocketResponse) -> None:
    """Send as many messages as are asked for, as far as they are taken."""
    began, sent = monotonic(), 0
    with suppress(ConnectionError):
        while not socket.closed:
            for _ in range(100):
                await socket.send_str('{"do": "drive", "v": 1.0, "omega": 0.0, "n": 1, "t": 1.0}')
            sent += 100
            await asyncio.sleep(max(0.0, began + sent / FLOOD - monotonic()))


async def flooding(url: str) -> None:
    """Flood, and come again whenever it is sent away."""
    while True:
        with suppress(aiohttp.ClientError):
            await page(url, flood)
        await asyncio.sleep(0.05)


async def clients(url: str, duration: float, watching: int) -> None:
    """All of them for a while; what the driver sent goes to standard output."""
    sent: list[tuple[float, float]] = []
    with suppress(TimeoutError):
        async with asyncio.timeout(duration), asyncio.TaskGroup() as group:
            group.create_task(page(url, partial(drive, sent=sent)))
            await asyncio.sleep(0.5)
            for _ in range(watching):
                group.create_task(page(url))
            group.create_task(flooding(url))
    print(json.dumps(sent))


# -- the rounds --------------------------------------------------------------------------------------------------


class Round(NamedTuple):
    """What came of one: cycles missed, p99 of the controller's lateness in s, and s from input to set-point."""

    misses: int
    p99: float
    latencies: list[float]


def one(duration: float, watching: int | None) -> Round:
    """A round; None for no page at all."""
    with live(ENDLESS) as car:
        before = car.misses()
        latencies = []
        if watching is None:
            sleep(duration)
        else:
            command = [sys.executable, "-m", "benchmarks.web_load", "--clients", car.url, "--duration", str(duration),
                       "--watching", str(watching)]  # fmt: skip
            out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            seen: dict[float, float] = {}
            for each in car.samples:
                seen.setdefault(each.v, each.time)
            latencies = [seen[v] - time for v, time in json.loads(out)[:1000] if v in seen]
        p99 = car.call(lambda robot: robot.runtime.statistics()["controller"].lateness.percentiles().p99)
        return Round(car.misses() - before, p99, latencies)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.web_load", description=__doc__)
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--duration", type=float, default=20.0, metavar="S", help="of a round")
    parser.add_argument("--watching", type=int, default=50)
    parser.add_argument("--clients", metavar="URL", help="be the pages")
    arguments = parser.parse_args()
    if arguments.clients is not None:
        asyncio.run(clients(arguments.clients, arguments.duration, arguments.watching))
        return
    results = interleave(arguments.rounds, {
        "no page": lambda: one(arguments.duration, None),
        f"{arguments.watching} watch, one drives, one floods": lambda: one(arguments.duration, arguments.watching),
    })  # fmt: skip
    table(
        f"lateness of the controller, {arguments.rounds} rounds of {arguments.duration:g} s",
        ("pages", "cycles missed", "p99, µs"),
        [(name, str(sum(r.misses for r in rounds)), spread([1e6 * r.p99 for r in rounds], 0))
         for name, rounds in results.items()],
    )  # fmt: skip
    without, beside = results.values()
    latencies = sorted(1e3 * each for round in beside for each in round.latencies)
    median = sorted(r.p99 for r in beside)[len(beside) // 2]
    print(f"\nmedian p99 within the spread of the rounds without: {verdict(median <= max(r.p99 for r in without))}")
    if latencies:
        p50, p99 = (latencies[int(share * (len(latencies) - 1))] for share in (0.5, 0.99))
        print(f"from input to set-point: p50 {p50:.1f} ms, p99 {p99:.1f} ms, of {len(latencies)} inputs")


if __name__ == "__main__":
    main()
