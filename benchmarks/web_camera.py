"""The page's STOP beside viewers of a camera, on a poor network: ``python -m benchmarks.web_camera``.

A robot with its page and a camera of 640 x 480 pixels at 20 Hz is on one side of a poor network (`rigs.poor_network`,
which needs root): 2 Mbit/s, 5 % loss, and 100 ms there and back. On the other side an operator's page presses STOP
again and again. Meanwhile nobody looks at the camera, or four viewers look and answer, or four look and never answer,
or four never even read their sockets. What counts: the time from the press to the safety gate, and to the confirmation
on the page. It takes some four minutes; with --presses 12 one.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any, Final

import aiohttp
import numpy as np

from benchmarks.rounds import table, write
from benchmarks.web_car import ENDLESS, PATIENCE
from benchmarks.web_stop import TOKEN, cells, on_core, trusting, upgrade
from rigs.live_browser import live
from rigs.poor_network import HERE, NAMESPACE, poor_network
from txt1.bridges.registry import HEARTBEAT_SILENCE
from txt1.sensors.base import Reading
from txt1.sensors.camera import jpeg
from txt1.sensors.readings import Image, image_topic
from txt1.web.camera_server import HEAD, SEEN, VIEWERS
from txt1.web.certificate import own_certificate

# bits a second, share of lost packets, s; in each direction
LINK: Final = (2e6, 0.05, 0.05)
# a good one
GOOD: Final = (100e6, 0.0, 0.005)
PRESSES: Final = 100
# s between two presses
PAUSES: Final = (0.2, 0.4)
# of static/link.js: connections for stops alone, s after which a stop is sent again, and how often it is sent
CHANNELS: Final = 2
AGAIN: Final = 0.03
COPIES: Final = 10
KINDS: Final = ("nobody", "4 that answer", "4 that do not answer", "4 that do not read")
HEADINGS: Final = (
    "viewers", "presses", "to the gate: p50, ms", "p99, ms", "worst, ms", "lost",
    "to the confirmation: p50, ms", "p99, ms", "worst, ms", "lost", "pictures a second and viewer", "age p50, ms",
)  # fmt: skip


# -- the robot, in a process of its own ----------------------------------------------------------------------------


class Filmed:
    """A camera that shows a room with the noise of a sensor, 20 pictures again and again, as large as a real one's."""

    period, simulated = 0.05, False

    def __init__(self) -> None:
        self.topic = image_topic("camera")
        rng = np.random.default_rng(1)
        y, x = np.mgrid[0:480, 0:640]
        room = 90 + 60 * np.sin(x / 40) + 40 * np.sin(y / 30) + 30 * ((x // 60 + y // 60) % 2)
        noisy = (np.clip(room + rng.normal(0.0, 4.0, room.shape), 0, 255).astype(np.uint8) for _ in range(20))
        self.pictures = [Image(640, 480, jpeg(np.repeat(each[:, :, None], 3, 2))) for each in noisy]
        self._last, self._next = -1.0, 0

    async def open(self) -> None:
        """Begin."""
        self._last = -1.0

    async def close(self) -> None:
        """End."""

    def read(self, now: float) -> Reading[Image] | None:
        """The next picture."""
        if now < self._last + 0.9 * self.period:
            return None
        self._last, self._next = now, self._next + 1
        return Reading(now, self.pictures[self._next % len(self.pictures)])


def create(_: Any) -> Filmed:
    """Make the driver."""
    return Filmed()


def _be(line: Connection, folder: Path) -> None:
    from txt1.sensors.registry import DRIVERS

    on_core(0)
    DRIVERS.table["filmed"] = create  # type: ignore[index]
    stops: list[float] = []
    token = folder / "token"
    token.write_text(TOKEN)
    token.chmod(0o600)
    certificate, key = own_certificate(folder, HERE)
    given = {"host": "0.0.0.0", "token": str(token), "certificate": str(certificate), "key": str(key)}
    settings = (*ENDLESS, "sensors.camera.driver=filmed")
    with live(settings, folder=folder, silence=HEARTBEAT_SILENCE, **given) as robot:
        gate: Any = robot.robot.runtime.gate
        stop: Callable[[], None] = gate.stop

        def stopped() -> None:
            stop()
            stops.append(monotonic())

        gate.stop = stopped
        line.send((robot.port, robot.camera))
        with suppress(EOFError):
            while True:
                line.recv()
                line.send(stops.copy())
                stops.clear()


@contextmanager
def car(folder: Path) -> Iterator[tuple[int, int, Callable[[], list[float]]]]:
    """The robot on a core of its own: the ports of its page and its cameras, and when its gate was told to stop."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_be, args=(there, folder))
    process.start()
    there.close()

    def stops() -> list[float]:
        here.send("stops")
        heard: list[float] = here.recv()
        return heard

    try:
        yield (*here.recv(), stops)
    finally:
        here.close()  # and it ends
        process.join(PATIENCE)


# -- the far side --------------------------------------------------------------------------------------------------


async def operator(port: int, camera: int, kind: str, presses: int) -> None:
    """Press STOP so often, and print when it was pressed and confirmed, and what the viewers saw."""
    url = f"https://{HERE}:{port}"
    cookies = aiohttp.CookieJar(unsafe=True)
    connector = aiohttp.TCPConnector(ssl=trusting())
    async with aiohttp.ClientSession(headers={"Origin": url}, cookie_jar=cookies, connector=connector) as client:
        while True:
            with suppress(aiohttp.ClientError, OSError):
                await client.post(f"{url}/sign-in", data={"token": TOKEN})
                page = await client.ws_connect(f"{url}/socket")
                channels = [await client.ws_connect(f"{url}/stop") for _ in range(CHANNELS)]
                break
        confirmed: dict[int, float] = {}
        tasks = [asyncio.create_task(hear(each, confirmed)) for each in (page, *channels)]
        ages: list[float] = []
        idle: list[socket.socket] = []
        number = 0 if kind == KINDS[0] else VIEWERS
        address = f"https://{HERE}:{camera}/camera/camera"
        for _ in range(number):
            if kind == KINDS[3]:
                idle.append(await asyncio.to_thread(deaf, port, camera))
            else:
                look = await client.ws_connect(address)
                tasks.append(asyncio.create_task(view(look, ages, kind == KINDS[1])))
        await asyncio.sleep(3.0)
        ages.clear()
        pressed, rng, began = [], Random(1), monotonic()
        for count in range(presses):
            pressed.append(monotonic())
            tasks.append(asyncio.create_task(stop((page, *channels), count, confirmed)))
            await asyncio.sleep(rng.uniform(*PAUSES))
        lasted, seen = monotonic() - began, list(ages)
        await asyncio.sleep(3.0)
        for task in tasks:
            task.cancel()
        rate = len(seen) / lasted / max(number, 1)
        print(json.dumps([pressed, [confirmed.get(count) for count in range(presses)], rate, seen]), flush=True)
        os._exit(0)


async def stop(
    connections: Sequence[aiohttp.ClientWebSocketResponse], number: int, confirmed: dict[int, float]
) -> None:
    """Send a stop as static/link.js does: on all connections, and again until it is confirmed."""
    for _ in range(COPIES):
        for each in connections:
            await each.send_str(json.dumps({"do": "stop", "stop": number}))
        await asyncio.sleep(AGAIN)
        if number in confirmed:
            return


async def hear(connection: aiohttp.ClientWebSocketResponse, confirmed: dict[int, float]) -> None:
    """Answer pings, and note confirmations."""
    async for message in connection:
        told = json.loads(message.data)
        if "ping" in told:
            await connection.send_str(json.dumps({"do": "pong", "ping": told["ping"], "t": monotonic()}))
        elif "stop" in told:
            confirmed.setdefault(told["stop"], monotonic())


async def view(look: aiohttp.ClientWebSocketResponse, ages: list[float], answers: bool) -> None:
    """Look at the camera; note the age of each picture, as both sides have the same clock here."""
    async for message in look:
        exposed, *_ = HEAD.unpack(message.data[: HEAD.size])
        ages.append(monotonic() - exposed)
        if answers:
            await look.send_str(SEEN)


def deaf(port: int, camera: int) -> socket.socket:
    """A viewer that shakes hands, and then reads nothing."""
    plain = socket.create_connection((HERE, camera), 30.0)
    raw = trusting().wrap_socket(plain)
    words = upgrade(port, "operator").replace(b"/socket", b"/camera/camera")
    here, page, pictures = b"127.0.0.1:%d" % port, f"{HERE}:{port}".encode(), f"{HERE}:{camera}".encode()
    words = words.replace(b"Host: " + here, b"Host: " + pictures).replace(b"https://" + here, b"https://" + page)
    raw.sendall(words)
    assert raw.recv(12).startswith(b"HTTP/1.1 101")
    return raw


# -- the rounds ----------------------------------------------------------------------------------------------------


def a_round(ports: Sequence[int], stops: Callable[[], list[float]], kind: str, presses: int) -> tuple[str, ...]:
    """A row of the table."""
    stops()
    words = [sys.executable, "-m", "benchmarks.web_camera", "--operator", *map(str, ports), kind, str(presses)]
    far = subprocess.run(["ip", "netns", "exec", NAMESPACE, *words], stdout=subprocess.PIPE, check=True)
    pressed, confirmed, rate, ages = json.loads(far.stdout)
    heard = stops()
    to_gate = [next((when - began for when in heard if when >= began), None) for began in pressed]
    to_page = [None if when is None else when - began for began, when in zip(pressed, confirmed, strict=True)]
    age = f"{1e3 * float(np.median(ages)):.0f}" if ages else "–"
    shown = f"{rate:.1f}" if ages else "–"
    return kind, str(len(pressed)), *cells(to_gate), *cells(to_page), shown, age


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.web_camera", description=__doc__)
    parser.add_argument("--presses", type=int, default=PRESSES, help="of each kind")
    parser.add_argument("--kind", help="only kinds with this in their name")
    parser.add_argument("--page", action="store_true", help="write the table to docs/web.md")
    parser.add_argument("--good", action="store_true", help="a network of 100 Mbit/s that loses nothing")
    parser.add_argument("--operator", nargs=4, metavar=("PORT", "CAMERA", "KIND", "PRESSES"), help="be the far side")
    arguments = parser.parse_args()
    if arguments.operator is not None:
        port, camera, kind, presses = arguments.operator
        on_core(1)
        asyncio.run(operator(int(port), int(camera), kind, int(presses)))
    if os.geteuid() or not shutil.which("ip"):
        sys.exit("benchmarks.web_camera: it makes a network of its own: run it as root, with iproute2")
    load, rows, link = os.getloadavg()[0], [], GOOD if arguments.good else LINK
    with ExitStack() as stack:
        stack.enter_context(poor_network(*link))
        folder = Path(stack.enter_context(TemporaryDirectory()))
        *ports, stops = stack.enter_context(car(folder))
        for kind in (each for each in KINDS if (arguments.kind or "") in each):
            rows.append(a_round(ports, stops, kind, arguments.presses))
            print(*rows[-1], sep="  ", flush=True)
    text = (
        f"{link[0] / 1e6:g} Mbit/s, {100.0 * link[1]:g} % loss and {2e3 * link[2]:g} ms there and back. "
        f"Load of the machine, which has {os.cpu_count()} processors, before it: {load:.1f}."
    )
    table("from STOP on a page to the safety gate, beside viewers", HEADINGS, rows)
    print(f"\n{text}")
    if arguments.page and not arguments.good:
        write(Path("docs/web.md"), "web_camera", HEADINGS, rows, text)


if __name__ == "__main__":
    main()
