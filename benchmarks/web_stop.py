"""The page's STOP while others flood: ``python -m benchmarks.web_stop``.

A robot with its page's server has a process of its own. An operator's page presses STOP again and again, in rounds
without other pages and in rounds beside two that send 10 000 messages a second each: every message that there is but
the stop, half of them with fields of any kind. What counts: the time from the press to the safety gate, with a 99th
percentile of at most 0.1 s in the flood. All pages run on the robot's own machine. 300 presses of each kind take some
five minutes.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, nullcontext, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from time import monotonic, sleep
from typing import Any, Final

import aiohttp

from benchmarks.rounds import table, verdict, write
from benchmarks.web_car import ENDLESS, PATIENCE
from rigs.live_browser import live
from txt1.web.requests import REQUESTS

FLOOD: Final = 10_000  # messages a second and page
PAGES: Final = 2  # that flood
PRESSES: Final = 25  # in a round
LIMIT: Final = 0.1  # s, of the 99th percentile in the flood
HEAD: Final = ("other pages", "presses", "p50, ms", "p99, ms", "worst, ms", "lost")
SOUND: Final[dict[str, dict[str, Any]]] = {
    "drive": {"v": 0.3, "omega": 0.0, "n": 1, "t": 1.0},
    "gains": {"linear": [6.0, 60.0, 0.0], "angular": [[1.0, 1.0, 1.0, 0.0]]},
    "limit": {"v": 0.5},
    "go": {"x": 1.0, "y": 1.0},
    "here": {"x": 0.0, "y": 0.0, "theta": 0.0},
}


# -- the robot, in a process of its own ----------------------------------------------------------------------------


@contextmanager
def robot() -> Iterator[tuple[Connection, str]]:
    """A robot that tells when its gate was told to stop, s of the monotonic clock; and its page's address."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_be, args=(there,))
    process.start()
    there.close()
    try:
        yield here, f"http://127.0.0.1:{here.recv()}/"
    finally:
        here.close()  # and it ends
        process.join(PATIENCE)


def _be(line: Connection) -> None:
    stops: list[float] = []
    with live(ENDLESS) as car:
        gate: Any = car.robot.runtime.gate
        stop = gate.stop

        def stopped() -> None:
            stop()
            stops.append(monotonic())

        gate.stop = stopped
        line.send(car.port)
        with suppress(EOFError):
            while line.recv():
                line.send(stops.copy())
                stops.clear()


# -- the pages -----------------------------------------------------------------------------------------------------


@asynccontextmanager
async def page(url: str) -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
    """A page that answers pings."""
    async with (
        aiohttp.ClientSession(headers={"Origin": url.rstrip("/")}) as client,
        client.ws_connect(f"{url}socket") as socket,
        asyncio.TaskGroup() as group,
    ):
        answering = group.create_task(_answer(socket))
        yield socket
        answering.cancel()


async def _answer(socket: aiohttp.ClientWebSocketResponse) -> None:
    async for message in socket:
        if message.data.startswith('{"page"'):
            ping = json.loads(message.data)["ping"]
            await socket.send_str(json.dumps({"do": "pong", "ping": ping, "t": monotonic()}))


async def flood(url: str, seed: int) -> None:
    """Send every message but the stop, and come again whenever this page is sent away."""
    rng, names = Random(seed), [name for name in REQUESTS if name != "stop"]
    wild: tuple[object, ...] = (None, True, -1, 1e300, 10**400, "", "x" * 300, [], {}, [[0.0] * 4] * 20)
    texts = [
        json.dumps(
            {"do": name, **(SOUND.get(name, {}) if k % 2 else {key: rng.choice(wild) for key in ("v", "x", "n")})}
        )
        for name in names
        for k in range(10)
    ]
    while True:
        with suppress(aiohttp.ClientError, ConnectionError, BaseExceptionGroup):
            async with page(url) as socket:
                began, sent = monotonic(), 0
                while not socket.closed:
                    for _ in range(100):
                        await socket.send_str(rng.choice(texts))
                    sent += 100
                    await asyncio.sleep(max(0.0, began + sent / FLOOD - monotonic()))
        await asyncio.sleep(0.05)


async def press(url: str, times: int) -> list[float]:
    """Press STOP so many times and arm in between; when it was pressed, s of the monotonic clock."""
    pressed = []
    async with page(url) as socket:
        await asyncio.sleep(1.0)
        for number in range(times):
            await socket.send_str(json.dumps({"do": "arm", "n": number, "t": monotonic()}))
            await asyncio.sleep(0.2)
            pressed.append(monotonic())
            await socket.send_str('{"do": "stop"}')
            await asyncio.sleep(0.2)
        await asyncio.sleep(1.0)
    return pressed


# -- the rounds ----------------------------------------------------------------------------------------------------


def a_round(line: Connection, url: str, flooded: bool) -> list[float | None]:
    """The time of each stop, s; None: the gate never heard it."""
    command = [sys.executable, "-m", "benchmarks.web_stop", "--flood", url]
    with subprocess.Popen(command) if flooded else nullcontext() as others:
        try:
            if flooded:
                sleep(2.0)  # they have begun
            line.send("from now on")
            line.recv()
            pressed = asyncio.run(press(url, PRESSES))
        finally:
            if others is not None:
                others.kill()
    line.send("stops")
    heard: list[float] = line.recv()
    # stops of one page are heard in their order
    waited = [time - began for began, time in zip(pressed, heard, strict=False)]
    return [*waited, *[None] * (len(pressed) - len(heard))]


def row(name: str, times: list[float | None]) -> tuple[str, ...]:
    """A line of the table."""
    heard = sorted(1e3 * each for each in times if each is not None)
    p50, p99, worst = (heard[int(share * (len(heard) - 1))] for share in (0.5, 0.99, 1.0))
    return name, str(len(times)), f"{p50:.1f}", f"{p99:.1f}", f"{worst:.1f}", str(len(times) - len(heard))


async def _flood(url: str) -> None:
    await asyncio.gather(*(flood(url, seed) for seed in range(PAGES)))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.web_stop", description=__doc__)
    parser.add_argument("--presses", type=int, default=300, help="of each kind")
    parser.add_argument("--page", action="store_true", help="write the table to docs/web.md")
    parser.add_argument("--flood", metavar="URL", help="be the pages that flood")
    arguments = parser.parse_args()
    if arguments.flood is not None:
        asyncio.run(_flood(arguments.flood))
        return
    load, quiet, flooded = os.getloadavg()[0], [], []
    with robot() as (line, url):
        for _ in range(max(1, arguments.presses // PRESSES)):
            quiet += a_round(line, url, False)
            flooded += a_round(line, url, True)
    rows = [row("none", quiet), row(f"{PAGES} flood with every message", flooded)]
    late = float(rows[1][3]) > 1e3 * LIMIT or None in flooded
    text = (
        f"At most {1e3 * LIMIT:.0f} ms p99 in the flood, and none lost: {verdict(not late)}. Load of the machine, "
        f"which has {os.cpu_count()} processors, before it: {load:.1f}."
    )
    table("from STOP on a page to the safety gate", HEAD, rows)
    print(f"\n{text}")
    if arguments.page:
        write(Path("docs/web.md"), "web_stop", HEAD, rows, text)


if __name__ == "__main__":
    main()
