"""Many pages at once: ``python -m benchmarks.web_load``.

In interleaved rounds a robot runs with its page's server alone, and with 50 pages that watch, one that drives and one
that sends 10 000 messages a second, all in a process of their own. As pages take the processors of this machine, which
those of other computers would not, there are rounds with the same pages at a second robot, too. What counts: the 99th
percentile of the controller's lateness within the spread of the rounds without pages; and the time from a page's input
to the robot's set-point. 12 rounds of each kind take a quarter of an hour; they are kept in out/web_load.jsonl, so that
a command that was ended goes on where it was.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from time import monotonic, sleep
from typing import Any, Final

import aiohttp

from benchmarks.rounds import spread, table, write
from benchmarks.web_car import car

FLOOD: Final = 10_000  # messages a second
WATCHING: Final = 50  # pages
KEPT: Final = Path("out/web_load.jsonl")
KINDS: Final = {
    "none": "no page",
    "elsewhere": "all of these at another robot of this machine",
    "here": f"{WATCHING} watch, one drives, one floods",
}


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


async def clients(url: str, duration: float) -> None:
    """All of them for a while; what the driver sent goes to standard output."""
    sent: list[tuple[float, float]] = []
    with suppress(TimeoutError):
        async with asyncio.timeout(duration), asyncio.TaskGroup() as group:
            group.create_task(page(url, partial(drive, sent=sent)))
            await asyncio.sleep(0.5)
            for _ in range(WATCHING):
                group.create_task(page(url))
            group.create_task(flooding(url))
    print(json.dumps(sent))


# -- the rounds --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Round:
    """What came of one."""

    pages: str  # where they are
    cycles: int  # of the controller
    misses: int
    p99: float  # s, of the controller's lateness
    latencies: list[float]  # s, from a page's input to the set-point
    load: float  # of the machine, before it
    realtime: bool


def one(pages: str, duration: float, realtime: bool) -> Round:
    """Make a round."""
    load = os.getloadavg()[0]
    with car(realtime=realtime) as robot, car() if pages == "elsewhere" else nullcontext(robot) as visited:
        before = robot.look()
        sent = []
        if pages == "none":
            sleep(duration)
        else:
            command = [
                sys.executable,
                "-m",
                "benchmarks.web_load",
                "--clients",
                visited.url,
                "--duration",
                str(duration),
            ]
            sent = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)[:1000]
        found = robot.look()
        seen: dict[float, float] = {}
        for each in found.samples:
            seen.setdefault(each.v, each.time)
        latencies = [seen[v] - time for v, time in sent if v in seen and pages == "here"]
        cycles, misses = found.cycles - before.cycles, found.misses - before.misses
        return Round(pages, cycles, misses, found.lateness, latencies, load, realtime)


def kept(path: Path) -> list[Round]:
    """Return the rounds made so far."""
    return [Round(**json.loads(line)) for line in path.read_text().splitlines()] if path.exists() else []


def collect(wanted: int, duration: float, minutes: float, realtime: bool, path: Path) -> None:
    """Make the rounds that are missing, one of each kind in turn, and keep those together."""
    path.parent.mkdir(parents=True, exist_ok=True)
    ends = monotonic() + 60.0 * minutes
    while len(kept(path)) < len(KINDS) * wanted and monotonic() < ends:
        made = [one(pages, duration, realtime) for pages in KINDS]
        print(*(f"p99 {1e3 * each.p99:.2f} ms, {each.misses} cycles missed" for each in made), sep="; ", flush=True)
        with path.open("a") as file:
            file.writelines(json.dumps(asdict(each)) + "\n" for each in made)


def show(found: Sequence[Round]) -> tuple[list[tuple[str, ...]], str]:
    """Return the rows of the table, and the verdict in words."""
    kinds = {pages: some for pages in KINDS if (some := [each for each in found if each.pages == pages])}
    rows = [
        (
            KINDS[pages],
            str(len(some)),
            spread([1e3 * each.p99 for each in some], 3),
            f"{sum(each.misses for each in some)} of {sum(each.cycles for each in some)}",
        )
        for pages, some in kinds.items()
    ]
    beside = kinds["here"]
    middle = median(each.p99 for each in beside)
    within = {pages: "yes" if middle <= max(each.p99 for each in kinds[pages]) else "no" for pages in kinds}
    control = f" It stays within the spread of the control: {within['elsewhere']}." if "elsewhere" in kinds else ""
    latencies = sorted(1e3 * each for one in beside for each in one.latencies) or [0.0]
    p50, p99 = (latencies[int(share * (len(latencies) - 1))] for share in (0.5, 0.99))
    loads = sorted(each.load for each in found)
    text = (
        f"Median p99 with pages stays within the spread without: {within['none']}.{control} "
        f"From a page's input to the robot's set-point: {p50:.0f} ms (p50), {p99:.0f} ms (p99), {len(latencies)} "
        f"inputs. Load of the machine, which has {os.cpu_count()} processors, with these rounds: {loads[0]:.1f} to "
        f"{loads[-1]:.1f}. The robot ran with `--realtime` in {sum(each.realtime for each in found)} of {len(found)} "
        "rounds."
    )
    return rows, text


HEAD: Final = ("pages", "rounds", "p99 of the controller's lateness, ms", "cycles missed")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.web_load", description=__doc__)
    parser.add_argument("--rounds", type=int, default=12, help="of each kind; 0: show those there are")
    parser.add_argument("--duration", type=float, default=20.0, metavar="S", help="of a round")
    parser.add_argument("--minutes", type=float, default=60.0, help="begin nothing more after so many")
    parser.add_argument("--realtime", action="store_true", help="the robot goes before other programs (--realtime)")
    parser.add_argument("--kept", type=Path, default=KEPT, help="where the rounds are kept")
    parser.add_argument("--page", action="store_true", help="write the table to docs/web.md")
    parser.add_argument("--clients", metavar="URL", help="be the pages")
    arguments = parser.parse_args()
    if arguments.clients is not None:
        asyncio.run(clients(arguments.clients, arguments.duration))
        return
    collect(arguments.rounds, arguments.duration, arguments.minutes, arguments.realtime, arguments.kept)
    found = kept(arguments.kept)
    if not found:
        return
    rows, text = show(found)
    table("how late the controller's cycles start: median (least .. most)", HEAD, rows)
    print(f"\n{text}")
    if arguments.page:
        write(Path("docs/web.md"), "web_load", HEAD, rows, text)


if __name__ == "__main__":
    main()
