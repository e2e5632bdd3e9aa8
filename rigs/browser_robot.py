"""The page without a server, and a board at its serial port: what tests and measurements of plugins/browser share.

`navigator.serial` is a script that joins its port to `txt1 board` (web_serial.js): a browser's own chooser cannot be
operated by a program, and there is no hardware here.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from statistics import median
from time import monotonic, sleep
from typing import Any, Final

from rigs.patience import LIMIT, TXT1, S
from rigs.ports import free_port
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role
from txt1.protocol.messages import EncoderOdometry, Velocity

STATE: Final = "document.getElementById('state').textContent"
ARMED: Final = f"{STATE} === 'armed'"
START: Final = 6 * LIMIT
"""s until Python is loaded on a busy computer."""
SERIAL: Final = Path(__file__).with_name("web_serial.js")


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """A folder on a server of plain files; its address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


class Relay:
    """A socket of a page, joined to the board's line; notes the velocities that go to the board, and when."""

    def __init__(self, board: int) -> None:
        self.told: list[tuple[float, Velocity]] = []
        self.measured: list[tuple[float, float]] = []
        """Times, and speeds that the board told, m/s."""
        self.cut: Callable[[], object] = lambda: None
        """Pulls the plug."""
        self.babble: Callable[[bytes], object] = lambda data: None
        """Sends the page bytes as if they came from the board."""
        self._board, self._decoder, self._reports = board, Decoder(Role.BOARD), Decoder(Role.HOST)
        self._loop = asyncio.new_event_loop()
        self.port = free_port()
        ready = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(ready,), daemon=True)
        self._thread.start()
        assert ready.wait(LIMIT)

    def _run(self, ready: threading.Event) -> None:
        from aiohttp import web

        asyncio.set_event_loop(self._loop)
        app = web.Application()
        app.router.add_get("/", self._join)
        runner = web.AppRunner(app)
        self._loop.run_until_complete(runner.setup())
        self._loop.run_until_complete(web.TCPSite(runner, "127.0.0.1", self.port).start())
        ready.set()
        self._loop.run_forever()
        self._loop.run_until_complete(runner.cleanup())
        self._loop.close()

    def close(self) -> None:
        self.cut()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(LIMIT)

    async def _join(self, request: Any) -> Any:
        from aiohttp import WSMsgType, web

        socket = web.WebSocketResponse()
        await socket.prepare(request)
        reader, writer = await asyncio.open_connection("127.0.0.1", self._board)
        self.cut = lambda: self._loop.call_soon_threadsafe(lambda: self._loop.create_task(socket.close()))
        self.babble = lambda data: asyncio.run_coroutine_threadsafe(socket.send_bytes(data), self._loop).result(LIMIT)

        async def from_board() -> None:
            while data := await reader.read(4096):
                for event in self._reports.feed(data):
                    if isinstance(event, EncoderOdometry):
                        self.measured.append((monotonic(), event.v))
                if not socket.closed:
                    with suppress(ConnectionError):
                        await socket.send_bytes(data)

        reading = asyncio.create_task(from_board())
        try:
            async for message in socket:
                if message.type is not WSMsgType.BINARY:
                    break
                for event in self._decoder.feed(message.data):
                    if isinstance(event, Velocity):
                        self.told.append((monotonic(), event))
                writer.write(message.data)
            # the cable of a killed browser stays in the board
            await asyncio.sleep(5.0 * S)
        finally:
            reading.cancel()
            writer.close()
        return socket

    def moving(self) -> bool:
        """Whether the last velocity moves the board, and it is as fast."""
        return bool(self.told and self.measured) and min(self.told[-1][1].v, self.measured[-1][1]) > 0.3

    def stops_after(self, since: float) -> float:
        """Return after how many s the board was told zeros for good."""
        ends = monotonic() + LIMIT
        while monotonic() < ends:
            sleep(0.3)
            last = [time for time, told in self.told if told.v or told.omega]
            zeros = [time for time, told in self.told if not (told.v or told.omega)]
            if last and zeros and zeros[-1] > last[-1] and zeros[-1] > since:
                return max(0.0, next(time for time in zeros if time > last[-1]) - since)
        raise AssertionError("the board is never told to stop")

    def frozen(self, stop: Callable[[], None]) -> float:
        """Stop the browser; return for how many s the board, which is told nothing more, keeps its speed."""
        # it has its full speed by then
        sleep(1.0 * S)
        stop()
        sleep(4.0 * S)
        since, last = self.told[-1]
        assert last.v > 0.3, "zeros came, so the browser was not stopped"
        # measured speeds scatter: one that is low does not say that it slows down
        speed = median([v for time, v in self.measured if time < since][-10:])
        assert abs(self.measured[-1][1]) < 0.05, "it does not stand"
        return max(time for time, v in self.measured if v > 0.9 * speed) - since


@contextmanager
def board(habits: str) -> Iterator[Relay]:
    """A virtual board in a long room, "ours" or "original", and the relay before it."""
    port = free_port()
    words = ["board", "--tcp", str(port), "--as", habits, "--set", "sim.room.length=80"]
    process = subprocess.Popen([*TXT1, *words], stdout=subprocess.DEVNULL)
    ends = monotonic() + LIMIT
    while monotonic() < ends:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                break
        sleep(0.1)
    made = Relay(port)
    yield made
    made.close()
    process.send_signal(signal.SIGINT)
    process.wait(LIMIT)


def arm(page: Any) -> None:
    """Hold m until the robot is armed, anew where a busy computer has the page let go."""
    ends = monotonic() + START
    while page.evaluate(STATE) != "armed":
        assert monotonic() < ends, "it is not armed"
        page.keyboard.down("m")
        sleep(1.0)
        page.keyboard.up("m")


def hold(page: Any, relay: Relay) -> None:
    """Hold w until the board drives, anew where a busy computer has the page let go."""
    ends = monotonic() + START
    while monotonic() < ends:
        page.keyboard.up("w")
        page.keyboard.down("w")
        for _ in range(200):
            sleep(0.01 * S)
            if relay.moving():
                return
    raise AssertionError("the board does not drive")


def drives_off(page: Any) -> None:
    """Press w until the page shows that the robot moves, anew where a busy computer has the page let go."""
    ends = monotonic() + START
    while monotonic() < ends:
        page.keyboard.down("w")
        for _ in range(20):
            if page.evaluate("parseFloat(document.getElementById('v-now').textContent) > 0"):
                return
            sleep(0.05)
        page.keyboard.up("w")
    raise AssertionError("it does not drive")


def renderers(browser: Any) -> list[int]:
    """The processes of a browser that run pages and their workers."""
    told = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    return [int(each["id"]) for each in told if each["type"] == "renderer"]


def signalled(processes: list[int], what: signal.Signals) -> None:
    """Send processes a signal."""
    for each in processes:
        os.kill(each, what)


@contextmanager
def driven(page: Any, folder: Path, url: str, relay: Relay) -> Iterator[Any]:
    """A page that drives a board: w is held. Service workers have to be blocked in it."""
    fake = SERIAL.read_text().replace("RELAY", f"ws://127.0.0.1:{relay.port}/")
    page.add_init_script(fake)
    # a worker whose script playwright gives has no sockets
    guard = (folder / "guard.js").read_text()
    (folder / "guard.js").write_text(f"{fake}\n{guard}")
    try:
        page.goto(url)
        page.wait_for_function(ARMED, timeout=1000 * START)
        page.click("#board")
        linked = f"{STATE} === 'disarmed' && document.getElementById('link').textContent.endsWith('ms')"
        page.wait_for_function(linked, timeout=1000 * START)
        arm(page)
        hold(page, relay)
        yield page
    finally:
        (folder / "guard.js").write_text(guard)
