"""The page's STOP while others flood: ``python -m benchmarks.web_stop``.

A robot with its page's server, by TLS and with a token, has a process of its own, on one core. An operator's page
presses STOP again and again. Meanwhile four connections from the same address flood as fast as another core can: by
each kind of frame, with the visitors' or the operator's token, by GETs, by wrong tokens, by handshakes, by connections.
A connection that is closed comes again at once. What counts: the time from the press to the safety gate. All of it runs
a second time beside four busy loops. It takes some ten minutes.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import socket
import ssl
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import monotonic, time
from typing import Any, Final, Literal, NamedTuple

import aiohttp

from benchmarks.rounds import table, verdict, write
from benchmarks.web_car import ENDLESS, PATIENCE
from rigs.live_browser import live
from txt1.bridges.registry import HEARTBEAT_SILENCE
from txt1.web.auth import Auth, Role, visitors_token
from txt1.web.certificate import own_certificate
from txt1.web.requests import REQUESTS

TOKEN: Final = "the-token-of-the-robot-of-web-stop"
CONNECTIONS: Final = 4  # that flood
BUSY: Final = 4  # busy loops, on all cores
FIRST: Final = -10  # niceness of the operator's page
PRESSES: Final = 50  # of each kind
PAUSES: Final = (0.06, 0.16)  # s between two presses
ROOM: Final = 1 << 16  # bytes of a flood that are sent at once
P99: Final = 0.1  # s, in a flood
WORST: Final = 0.3  # s
WORST_BUSY: Final = 1.0  # s, beside busy loops, too
TIMES: Final = ("p50, ms", "p99, ms", "worst, ms", "lost")
HEAD: Final = ("four connections send", "presses", *TIMES, "presses beside busy loops", *TIMES)


# -- what floods ---------------------------------------------------------------------------------------------------


def frame(opcode: int, content: bytes, last: bool = True) -> bytes:
    """A frame as a browser sends it, with a mask of zeros."""
    size = len(content)
    long = bytes([0x80 | size]) if size < 126 else b"\xfe" + size.to_bytes(2, "big")
    return bytes([opcode | (0x80 if last else 0)]) + long + b"\0\0\0\0" + content


def messages(rng: Random) -> bytes:
    """Every message but the stop, half of them with fields of any kind."""
    wild: tuple[object, ...] = (None, True, -1, 1e300, 10**400, "", "x" * 300, [], {}, [[0.0] * 4] * 20)
    sound: dict[str, dict[str, Any]] = {
        "drive": {"v": 0.3, "omega": 0.0, "n": 1, "t": 1.0},
        "gains": {"linear": [6.0, 60.0, 0.0], "angular": [[1.0, 1.0, 1.0, 0.0]]},
        "limit": {"speed": 0.5},
        "go": {"points": [[1.0, 1.0]], "n": 2, "t": 1.0},
    }
    names = [name for name in REQUESTS if name != "stop"]
    texts = [
        json.dumps(
            {"do": name, **(sound.get(name, {}) if k % 2 else {key: rng.choice(wild) for key in ("v", "x", "n")})}
        )
        for name in names
        for k in range(10)
    ]
    rng.shuffle(texts)
    return b"".join(frame(1, text.encode()) for text in texts)


class Flood(NamedTuple):
    """What a connection sends: by whom, first, and then again and again; or it only comes and goes."""

    who: Role | Literal["stranger"]
    again: bytes = b""
    first: bytes = b""
    handshake: bool = True


def floods(port: int) -> dict[str, Flood]:
    """All kinds."""
    host = f"127.0.0.1:{port}"
    get = f"GET /style.css HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()
    form = b"token=wrong"
    post = (
        f"POST /sign-in HTTP/1.1\r\nHost: {host}\r\nOrigin: https://{host}\r\n"
        f"Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {len(form)}\r\n\r\n"
    ).encode() + form
    kinds: dict[str, Flood] = {}
    roles: tuple[Role, Role] = ("visitor", "operator")
    for who in roles:
        kinds |= {
            f"messages, the {who}'s": Flood(who, messages(Random(1))),
            f"pings, the {who}'s": Flood(who, frame(9, b"")),
            f"pongs, the {who}'s": Flood(who, frame(10, b"x" * 100)),
            f"empty fragments, the {who}'s": Flood(who, frame(0, b"", last=False), frame(1, b"{", last=False)),
            f"messages of 8 kB, the {who}'s": Flood(who, frame(1, b'"stop"' + b"x" * 8000)),
        }
    return kinds | {
        "GETs": Flood("stranger", get),
        "wrong tokens": Flood("stranger", post),
        "handshakes": Flood("stranger"),
        "connections": Flood("stranger", handshake=False),
    }


def upgrade(port: int, role: Role) -> bytes:
    """A page's request for its socket."""
    host, door = f"127.0.0.1:{port}", Auth(TOKEN, "https", port)
    signed = door.sign_in({"operator": TOKEN, "visitor": visitors_token(TOKEN)}[role], time())
    assert signed is not None
    return (
        f"GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: https://{host}\r\nConnection: Upgrade\r\n"
        f"Cookie: {door.cookie}={signed[1]}\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    ).encode()


def trusting() -> ssl.SSLContext:
    """TLS that trusts anybody."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


def flood(port: int, kind: str) -> None:
    """Flood by one connection after the other, for ever."""
    what, context = floods(port)[kind], trusting()
    piece = what.again * max(1, ROOM // len(what.again)) if what.again else b""
    while True:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), 5.0) as plain:
            if not what.handshake:
                continue
            with context.wrap_socket(plain) as raw:
                if what.who != "stranger":
                    raw.sendall(upgrade(port, what.who))
                    if not raw.recv(12).startswith(b"HTTP/1.1 101"):
                        continue
                raw.sendall(what.first)
                while piece:
                    raw.sendall(piece)


def on_core(number: int) -> None:
    """Run on one core alone from now on, as do later children; on a computer with a single core there is no choice."""
    os.sched_setaffinity(0, {number % (os.cpu_count() or 1)})


def _flood(port: int, kind: str) -> None:
    on_core(1)
    threads = [threading.Thread(target=flood, args=(port, kind), daemon=True) for _ in range(CONNECTIONS)]
    os.setpriority(os.PRIO_PROCESS, 0, 0)
    for each in threads:
        each.start()
    print("begun", flush=True)
    threads[0].join()


def _spin() -> None:
    os.sched_setaffinity(0, range(os.cpu_count() or 1))
    os.setpriority(os.PRIO_PROCESS, 0, 0)
    while True:
        pass


@contextmanager
def processes(count: int, *words: str) -> Iterator[list[subprocess.Popen[bytes]]]:
    """So many processes of this benchmark until the block is left."""
    with ExitStack() as stack:
        begun = []
        for _ in range(count):
            command = [sys.executable, "-m", "benchmarks.web_stop", *words]
            begun.append(stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE)))
            stack.callback(begun[-1].kill)
        yield begun


# -- the robot, in a process of its own ----------------------------------------------------------------------------


class Car(NamedTuple):
    """The robot from outside."""

    line: Connection
    port: int

    def ask(self, what: Literal["stops", "restarts"]) -> Any:
        """When the gate was told to stop since the last look, s of the monotonic clock; or restarts of the server."""
        self.line.send(what)
        return self.line.recv()


@contextmanager
def car(folder: Path) -> Iterator[Car]:
    """A robot on a core of its own."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_be, args=(there, folder))
    process.start()
    there.close()
    try:
        yield Car(here, here.recv())
    finally:
        here.close()  # and it ends
        process.join(PATIENCE)


def _be(line: Connection, folder: Path) -> None:
    on_core(0)
    stops: list[float] = []
    token = folder / "token"
    token.write_text(TOKEN)
    token.chmod(0o600)
    certificate, key = own_certificate(folder, "127.0.0.1")
    given = {"token": str(token), "certificate": str(certificate), "key": str(key)}
    with live(ENDLESS, folder=folder, silence=HEARTBEAT_SILENCE, **given) as robot:
        gate: Any = robot.robot.runtime.gate
        stop: Callable[[], None] = gate.stop

        def stopped() -> None:
            stop()
            stops.append(monotonic())

        gate.stop = stopped
        line.send(robot.port)
        with suppress(EOFError):
            while True:
                if line.recv() == "stops":
                    line.send(stops.copy())
                    stops.clear()
                else:
                    line.send(robot.restarts)


# -- the operator's page -------------------------------------------------------------------------------------------


@asynccontextmanager
async def page(port: int) -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
    """A page that answers pings."""
    url = f"https://127.0.0.1:{port}"
    cookies = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(
        url, headers={"Origin": url}, cookie_jar=cookies, connector=aiohttp.TCPConnector(ssl=trusting())
    ) as client:
        async with asyncio.timeout(PATIENCE):
            while True:
                with suppress(aiohttp.ClientError, OSError):
                    await client.post("/sign-in", data={"token": TOKEN})
                    socket = await client.ws_connect("/socket")
                    break
                await asyncio.sleep(0.2)
        answering = asyncio.create_task(_answer(socket))
        yield socket
        answering.cancel()
        await socket.close()


async def _answer(socket: aiohttp.ClientWebSocketResponse) -> None:
    async for message in socket:
        if message.data.startswith('{"page"'):
            ping = json.loads(message.data)["ping"]
            await socket.send_str(json.dumps({"do": "pong", "ping": ping, "t": monotonic()}))


async def press(port: int, times: int, kind: str) -> list[float]:
    """Press STOP so many times while others flood; when it was pressed, s of the monotonic clock."""
    pressed, rng = [], Random(kind)
    async with page(port) as socket:
        with processes(1 if kind else 0, "--flood", str(port), kind) as begun:
            for each in begun:
                assert each.stdout is not None
                await asyncio.to_thread(each.stdout.readline)
            await asyncio.sleep(0.5)
            for _ in range(times):
                pressed.append(monotonic())
                await socket.send_str('{"do": "stop"}')
                await asyncio.sleep(rng.uniform(*PAUSES))
            await asyncio.sleep(1.0)
    return pressed


# -- the rounds ----------------------------------------------------------------------------------------------------


def a_round(robot: Car, kind: str, presses: int) -> list[float | None]:
    """The time until the robot was stopped after each press, s; None: it was not.

    Presses that reach the server at once are one stop, so each press waits for the first stop after it.
    """
    robot.ask("stops")
    pressed = asyncio.run(press(robot.port, presses, kind))
    heard: list[float] = robot.ask("stops")
    return [next((when - began for when in heard if when >= began), None) for began in pressed]


def cells(times: list[float | None]) -> tuple[str, ...]:
    """Median, 99th percentile and worst in ms, and how many were lost."""
    heard = sorted(1e3 * each for each in times if each is not None) or [float("nan")]
    p50, p99, worst = (heard[int(share * (len(heard) - 1))] for share in (0.5, 0.99, 1.0))
    return f"{p50:.1f}", f"{p99:.1f}", f"{worst:.1f}", str(times.count(None))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.web_stop", description=__doc__)
    parser.add_argument("--presses", type=int, default=PRESSES, help="of each kind")
    parser.add_argument("--kind", help="only kinds with this in their name")
    parser.add_argument("--page", action="store_true", help="write the table to docs/web.md")
    parser.add_argument("--flood", nargs=2, metavar=("PORT", "KIND"), help="be the connections that flood")
    parser.add_argument("--spin", action="store_true", help="be a busy loop")
    arguments = parser.parse_args()
    if arguments.flood is not None:
        _flood(int(arguments.flood[0]), arguments.flood[1])
    if arguments.spin:
        _spin()
    load, rows = os.getloadavg()[0], []
    alone: list[float | None] = []
    beside: list[float | None] = []
    with TemporaryDirectory() as folder, car(Path(folder)) as robot:
        on_core(1)
        # the floods on its core are not to delay the operator's page
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, FIRST)
        for kind in ("", *(kind for kind in floods(0) if (arguments.kind or "") in kind)):
            one = a_round(robot, kind, arguments.presses)
            with processes(BUSY, "--spin"):
                other = a_round(robot, kind, arguments.presses)
            alone, beside = alone + one, beside + other
            rows.append((kind or "nothing", str(len(one)), *cells(one), str(len(other)), *cells(other)))
            print(*rows[-1], sep="  ", flush=True)
        restarts = robot.ask("restarts")
    rows.append(("all", str(len(alone)), *cells(alone), str(len(beside)), *cells(beside)))
    met = float(rows[-1][3]) <= 1e3 * P99 and float(rows[-1][4]) <= 1e3 * WORST and None not in alone
    met_busy = float(rows[-1][9]) <= 1e3 * WORST_BUSY and None not in beside
    text = (
        f"At most {1e3 * P99:.0f} ms p99 and {1e3 * WORST:.0f} ms worst, none lost: {verdict(met)}; beside {BUSY} busy "
        f"loops at most {1e3 * WORST_BUSY:.0f} ms, none lost: {verdict(met_busy)}. The server was started again "
        f"{restarts} times. Server and robot had one core, the floods another. Load of the machine, which has "
        f"{os.cpu_count()} processors, before it: {load:.1f}."
    )
    table("from STOP on a page to the safety gate", HEAD, rows)
    print(f"\n{text}")
    if arguments.page:
        write(Path("docs/web.md"), "web_stop", HEAD, [rows[0], rows[-1]], text)


if __name__ == "__main__":
    main()
