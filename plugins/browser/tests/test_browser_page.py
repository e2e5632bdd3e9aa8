"""The page without a server, in chromium: it drives, records, replays, works offline, and drives a board by Web Serial.

`navigator.serial` is a script that joins its port to `txt1 board` (fake_serial.js): a browser's own chooser cannot be
operated by a program, and there is no hardware here.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

from rigs.patience import LIMIT, TXT1, S
from rigs.ports import free_port
from tests.browser.conftest import browser, fresh, waits  # noqa: F401
from txt1.errors import ConfigError
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role
from txt1.protocol.messages import Velocity
from txt1_browser import site

pytestmark = pytest.mark.browser

# the very program: that of the other tests lives through longer stalls, and so would repeat another run
DESK = (sys.executable, "-m", "txt1")
HERE = Path(__file__).parent
STATE = "document.getElementById('state').textContent"
ARMED = f"{STATE} === 'armed'"
X = "parseFloat(document.getElementById('where').textContent.split('x ')[1])"
START = 6 * LIMIT
"""s until Python is loaded on a busy computer."""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("browser") / "site"
    given = os.environ.get("TXT1_PYODIDE")
    try:
        site.build(made, None if given is None else Path(given), lambda text: None)
    except ConfigError as error:
        pytest.skip(f"the folder of files cannot be made here: {error}")
    return made


@pytest.fixture(scope="session")
def served(folder: Path) -> Iterator[str]:
    """The folder on a server of plain files; its address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


@pytest.fixture
def page(browser: Any, served: str) -> Iterator[Any]:  # noqa: F811
    page = fresh(browser, accept_downloads=True)
    page.goto(served)
    assert waits(page, ARMED, START)
    yield page
    page.context.close()


def notice(page: Any) -> str:
    return str(page.evaluate("document.getElementById('browser-state').firstElementChild.textContent"))


def drive(page: Any, s: float = 2.0) -> None:
    """Hold w for s seconds, anew where a busy computer has the page let go."""
    before = page.evaluate(X)
    for _ in range(10):
        page.keyboard.down("w")
        sleep(s)
        page.keyboard.up("w")
        if abs(page.evaluate(X) - before) > 0.1:
            return
    raise AssertionError("it does not drive")


def saved(page: Any, target: Path) -> Path:
    """Complete the recording of the run by a new start, and save it."""
    page.click("#restart")
    assert waits(page, ARMED, START)
    page.click("[data-tab=files]")
    assert waits(page, "document.querySelectorAll('a[download]').length >= 2")
    with page.expect_download() as download:
        page.locator("a[download]").last.click()
    download.value.save_as(target)
    return target


def test_a_key_drives_and_letting_go_stops(page: Any) -> None:
    drive(page)
    assert waits(page, "document.getElementById('v-now').textContent === '0 m/s'")


def test_a_drive_is_saved_and_verified_on_the_desk(page: Any, tmp_path: Path) -> None:
    drive(page)
    file = saved(page, tmp_path / "browser.mcap")
    verified = subprocess.run([*DESK, "replay", "--verify", str(file)], capture_output=True, text=True, check=False)
    assert verified.returncode == 0, verified.stdout + verified.stderr


def test_a_drive_of_the_desk_is_verified_in_the_browser(page: Any, tmp_path: Path) -> None:
    file = tmp_path / "desk.mcap"
    run = ["run", "--headless", "--speed", "max", "--duration", "4", "--drive", "0.5,0.3", "--log", str(file)]
    subprocess.run([*DESK, *run], check=True, capture_output=True)
    page.set_input_files("#pick", str(file))
    page.click("#verify")
    assert waits(page, "document.getElementById('browser-state').dataset.code !== undefined", START)
    assert page.evaluate("document.getElementById('browser-state').dataset.code") == "0", notice(page)
    assert "no difference" in notice(page)


def test_it_learns_with_its_table_and_curve_and_the_desk_verifies_what_was_recorded(page: Any, tmp_path: Path) -> None:
    page.click("#learn")
    assert waits(page, "document.querySelectorAll('#learner-episodes tr').length >= 2", 4 * START), notice(page)
    assert page.evaluate("document.querySelectorAll('#learner-table tbody tr').length") >= 2
    assert page.evaluate("document.getElementById('episodes-chart').width") > 0
    shown = page.evaluate("[...document.querySelectorAll('#learner-table td')].map((cell) => cell.textContent)")
    file = saved(page, tmp_path / "learned.mcap")
    verified = subprocess.run([*DESK, "replay", "--verify", str(file)], capture_output=True, text=True, check=False)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert any(float(value) for value in shown[1:])


def test_a_learner_that_computes_with_numpy_is_refused_in_words(browser: Any, served: str) -> None:  # noqa: F811
    page = fresh(browser)
    page.goto(f"{served}?learn=locator")
    assert waits(page, "document.getElementById('browser-state').textContent.includes('not to be had')", START)
    page.context.close()


def test_it_opens_without_a_network_once_it_was_loaded(page: Any, served: str) -> None:
    assert waits(page, "navigator.serviceWorker.controller !== null", START)
    page.context.set_offline(True)
    page.goto(served)
    assert waits(page, ARMED, START)


def test_settings_in_the_address_are_those_of_the_desk(browser: Any, served: str) -> None:  # noqa: F811
    page = fresh(browser)
    page.goto(f"{served}?set=sim.start=[-1.5,0,0]&set=sim.room.length=8")
    assert waits(page, ARMED, START)
    assert page.evaluate(X) == pytest.approx(-1.5, abs=0.05)
    page.goto(f"{served}?set=safety.v_max=fast")
    assert waits(page, "document.getElementById('browser-state').textContent.includes('safety.v_max')", START)
    page.context.close()


def test_a_file_that_is_no_recording_is_refused_in_words(page: Any, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    page.set_input_files("#pick", str(tmp_path / "notes.txt"))
    assert waits(page, "document.getElementById('browser-state').textContent.includes('it ends with .mcap')")


def test_without_serial_ports_the_board_button_says_what_to_take(page: Any) -> None:
    page.evaluate("Object.defineProperty(navigator, 'serial', { value: undefined, configurable: true })")
    page.click("#board")
    assert "take Chrome or Edge" in notice(page)


# -- a board ------------------------------------------------------------------------------------------------------


class Relay:
    """A socket of a page, joined to the board's line; notes the velocities that go to the board, and when."""

    def __init__(self, board: int) -> None:
        self.told: list[tuple[float, Velocity]] = []
        self.cut: Callable[[], object] = lambda: None
        """Pulls the plug."""
        self._board, self._decoder = board, Decoder(Role.BOARD)
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

        async def from_board() -> None:
            while data := await reader.read(4096):
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
        finally:
            reading.cancel()
            writer.close()
        return socket

    def moving(self) -> bool:
        """Whether the last velocity moves the board."""
        return bool(self.told) and self.told[-1][1].v != 0

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


@pytest.fixture
def relay() -> Iterator[Relay]:
    port = free_port()
    board = subprocess.Popen(
        [*TXT1, "board", "--tcp", str(port), "--set", "sim.room.length=80"], stdout=subprocess.DEVNULL
    )
    ends = monotonic() + LIMIT
    while monotonic() < ends:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                break
        sleep(0.1)
    made = Relay(port)
    yield made
    made.close()
    board.send_signal(signal.SIGINT)
    board.wait(LIMIT)


@pytest.fixture
def driven(browser: Any, folder: Path, served: str, relay: Relay) -> Iterator[Any]:  # noqa: F811
    """A page that drives a board: w is held."""
    fake = (HERE / "fake_serial.js").read_text().replace("RELAY", f"ws://127.0.0.1:{relay.port}/")
    page = fresh(browser, service_workers="block")
    page.add_init_script(fake)
    # a worker whose script playwright gives has no sockets
    guard = (site.HERE / "static" / "guard.js").read_text()
    (folder / "guard.js").write_text(f"{fake}\n{guard}")
    page.goto(served)
    assert waits(page, ARMED, START)
    page.click("#board")
    assert waits(page, f"{STATE} === 'disarmed' && document.getElementById('link').textContent.endsWith('ms')", START)
    ends = monotonic() + START
    while page.evaluate(STATE) != "armed" and monotonic() < ends:
        page.keyboard.down("m")
        sleep(1.0)
        page.keyboard.up("m")
    while not relay.moving() and monotonic() < ends:
        page.keyboard.up("w")
        page.keyboard.down("w")
        sleep(0.5 * S)
    assert relay.moving()
    yield page
    page.context.close()
    (folder / "guard.js").write_text(guard)


def test_a_board_is_driven_by_web_serial_and_no_faster_than_half_a_metre(driven: Any, relay: Relay) -> None:
    since = monotonic()
    driven.keyboard.up("w")
    assert relay.stops_after(since) < 0.5 * S
    assert max(told.v for _, told in relay.told) <= 0.501


def test_the_guard_stops_a_board_whose_robot_was_ended(driven: Any, relay: Relay) -> None:
    since = monotonic()
    next(each for each in driven.workers if each.url.endswith("worker.js")).evaluate("self.close()")
    assert relay.stops_after(since) < 0.5 * S


@pytest.mark.parametrize("event", ["visibilitychange", "pagehide", "freeze", "blur"])
def test_a_page_that_is_left_stops_its_board_within_half_a_second(driven: Any, relay: Relay, event: str) -> None:
    since = monotonic()
    driven.evaluate(
        """(name) => {
            Object.defineProperty(document, "hidden", { value: name === "visibilitychange", configurable: true })
            const target = name === "visibilitychange" || name === "freeze" ? document : window
            target.dispatchEvent(new Event(name))
        }""",
        event,
    )
    assert relay.stops_after(since) < 0.5 * S


def test_an_unplugged_board_is_told_and_disarms(driven: Any, relay: Relay) -> None:
    relay.cut()
    assert waits(driven, f"{STATE} !== 'armed'")
