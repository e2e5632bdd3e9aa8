"""The web page's server from outside: what it serves, whom it lets in, and that no attack reaches the robot."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import struct
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from time import monotonic, time
from typing import Any

import aiohttp
import pytest

from rigs.live_browser import Live, live
from tests.patience import LIMIT, S, until
from txt1.web.auth import Auth, visitors_token
from txt1.web.connections import CONNECTIONS_MAX, STRANGER
from txt1.web.routes import MESSAGE_MAX

TOKEN = "t0ken-of-the-robot-long-enough"


@pytest.fixture(scope="module")
def token(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("web") / "token"
    file.write_text(TOKEN)
    file.chmod(0o600)
    return file


ENDLESS = ("sim.room.length=.inf", "sim.room.width=.inf")


@pytest.fixture(scope="module")
def car(token: Path) -> Iterator[Live]:
    """A simulated robot, and its page behind a token; whatever is done to it, the terminal is the operator's."""
    said, terminal = token.with_name("said"), os.dup(2)
    with said.open("w") as file, ExitStack() as stack:
        os.dup2(file.fileno(), 2)  # the server is born with it
        try:
            # without walls: a busy machine may take so long that the car would meet one
            here = stack.enter_context(live(ENDLESS, folder=token.parent, token=str(token)))
        finally:
            os.dup2(terminal, 2)
            os.close(terminal)
        yield here
    assert said.read_text() == ""


class Browser:
    """A page without a browser: it answers pings, and its clock is an hour off."""

    OFFSET = 3600.0

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket
        self.page: dict[str, Any] = {}
        self.told: list[str] = []
        self.topics: dict[str, Any] = {}
        self.pinged = asyncio.Event()
        self.number = 0
        self._reading = asyncio.create_task(self._read())

    async def _read(self) -> None:
        async for message in self.socket:
            said = json.loads(message.data)
            if "ping" in said:
                await self.send(do="pong", ping=said["ping"], t=monotonic() + self.OFFSET)
                self.page = said["page"]
                self.pinged.set()
            self.topics.update(said.get("topics", {}))
            if "told" in said:
                self.told.append(said["told"])

    async def send(self, **message: object) -> None:
        await self.socket.send_str(json.dumps(message))

    async def command(self, late: float = 0.0, **message: object) -> None:
        self.number += 1
        await self.send(**{"n": self.number, "t": monotonic() + self.OFFSET - late, **message})


@asynccontextmanager
async def session(car: Live, token: str | None = TOKEN) -> AsyncIterator[aiohttp.ClientSession]:
    """A browser that is signed in with a token, or a stranger's."""
    headers = {"Origin": car.url.rstrip("/")}
    if token is not None:
        door = Auth(TOKEN, "http", car.port)
        signed = door.sign_in(token, time())
        assert signed is not None
        headers["Cookie"] = f"{door.cookie}={signed[1]}"
    async with aiohttp.ClientSession(car.url, headers=headers, cookie_jar=aiohttp.DummyCookieJar()) as client:
        yield client


@asynccontextmanager
async def page(car: Live, token: str = TOKEN) -> AsyncIterator[Browser]:
    async with session(car, token) as client, client.ws_connect("/socket") as socket:
        browser = Browser(socket)
        await browser.pinged.wait()
        await asyncio.sleep(0.05)  # its answer is on the way
        yield browser


async def comes(car: Live, condition: Callable[[Any], object]) -> None:
    """Wait until something is true of the robot."""
    await until(lambda: car.call(condition), look=0.02)


async def driven(car: Live, browser: Browser, condition: Callable[[Any], object], v: float, omega: float = 0.0) -> None:
    """Hold a page's stick until something is true of the robot."""
    async with asyncio.timeout(LIMIT):
        while not car.call(condition):
            await browser.command(do="drive", v=v, omega=omega)
            await asyncio.sleep(0.04)


def go(work: Any) -> None:
    """Run in real time: the robot has a thread of its own."""
    asyncio.run(work)


def drives(robot: Any) -> bool:
    return bool(robot.runtime.state.control.v > 0.1)


def stands(robot: Any) -> bool:
    return bool(robot.runtime.state.control.v == 0.0)


@pytest.fixture(autouse=True)
def armed(car: Live) -> None:
    car.call(lambda robot: robot.arm())
    car.call(lambda robot: robot.place(0.0, 0.0, 0.0) if robot.odometry.v == 0.0 else None)


def test_a_page_sees_the_robot_and_drives_it(car: Live) -> None:
    async def main() -> None:
        async with page(car) as browser:
            await until(lambda: {"/odom", "/surroundings", "/events", "/battery1"} <= browser.topics.keys())
            await driven(car, browser, lambda robot: drives(robot) and robot.driver.name == "web", 0.5)
            await browser.send(do="release")
            await comes(car, stands)

    go(main())


@pytest.mark.parametrize("late", [0.3, 5.0, -0.5])
def test_a_late_command_and_one_from_the_future_do_nothing(car: Live, late: float) -> None:
    async def main() -> None:
        async with page(car) as browser:
            for _ in range(8):
                await browser.command(late, do="drive", v=0.5, omega=0.0)
                await asyncio.sleep(0.02)
                assert car.call(stands)
            assert car.call(lambda robot: robot.driver.name) == ""

    go(main())


def test_what_is_sent_again_does_nothing(car: Live) -> None:
    async def main() -> None:
        async with page(car) as browser:
            seen, message = len(car.samples), {}

            async def sent_anew() -> None:  # it may have come too late
                nonlocal message
                browser.number += 1
                now = monotonic() + browser.OFFSET
                message = {"do": "drive", "v": 0.5, "omega": 0.0, "n": browser.number, "t": now}
                await browser.send(**message)

            async with asyncio.timeout(LIMIT):
                while not any(each.v > 0.1 for each in car.samples[seen:]):
                    await sent_anew()
                    await asyncio.sleep(0.3 * S)
            car.call(lambda robot: robot.stop())
            car.call(lambda robot: robot.arm())
            for _ in range(5):
                await browser.send(**message)
            await asyncio.sleep(0.1)
            assert car.call(stands)

    go(main())


def test_a_visitor_is_slower_and_changes_nothing(car: Live) -> None:
    async def main() -> None:
        async with page(car, visitors_token(TOKEN)) as visitor:
            before = car.call(lambda robot: robot.runtime.state.gains)
            assert visitor.page["limit"] == 0.5
            await visitor.send(do="gains", linear=[1, 2, 3], angular=[[1.5, 1, 2, 3]])
            await visitor.send(do="record", on=True)
            await visitor.send(do="limit", speed=1.5)
            await driven(car, visitor, lambda robot: robot.runtime.state.control.v == 0.5, 1.5, 1.5)
            assert car.call(lambda robot: robot.runtime.state.gains) == before
            await visitor.command(do="here", points=[[1.0, 1.0]])
            car.call(lambda robot: robot.stop())
            await visitor.command(do="arm")
            await until(lambda: len(visitor.told) == 5)
            assert not car.call(lambda robot: robot.armed), "what a visitor has stopped, or anybody, the operator arms"
            await visitor.send(do="release")


def test_an_operator_takes_the_wheel_from_a_visitor_at_once_and_for_good(car: Live) -> None:
    async def main() -> None:
        async with page(car, visitors_token(TOKEN)) as visitor, page(car) as operator:
            await driven(car, visitor, drives, 0.5)
            await operator.send(do="take")
            await comes(car, stands)
            for _ in range(5):  # the visitor goes on
                await visitor.command(do="drive", v=0.5, omega=0.0)
                await visitor.send(do="take")
                await asyncio.sleep(0.05)
            assert car.call(stands)
            await driven(car, operator, lambda robot: robot.runtime.state.control.v < -0.1, -0.5)
            await operator.send(do="give")
            await comes(car, stands)
            for _ in range(5):
                await visitor.command(do="drive", v=0.5, omega=0.0)
                await asyncio.sleep(0.05)
            assert car.call(stands), "its press is older than the free wheel"
            await visitor.send(do="release")
            await driven(car, visitor, drives, 0.5)
            await visitor.send(do="release")
            await comes(car, stands)

    go(main())


def test_the_wheel_comes_free_when_its_page_goes(car: Live) -> None:
    async def main() -> None:
        async with page(car) as watching:
            async with page(car) as driving:
                await driven(car, driving, drives, 0.5)
                await watching.command(do="drive", v=-0.5, omega=0.0)
                await driving.command(do="drive", v=0.5, omega=0.0)
                await asyncio.sleep(0.05)
                assert car.call(lambda robot: robot.runtime.state.control.v) >= 0.0
            await comes(car, stands)
            await watching.send(do="release")  # it has to let go first
            await driven(car, watching, lambda robot: robot.runtime.state.control.v < -0.1, -0.5)
            await watching.send(do="release")

    go(main())


def test_the_wheel_comes_free_at_once_and_not_only_when_the_command_is_stale(car: Live) -> None:
    async def rested() -> float:
        """How old the last command of a page was when the robot was told to stand, s; more where something was late."""
        async with page(car) as driving:
            await driven(car, driving, drives, 0.5)
        await comes(car, stands)
        drove = max(k for k, each in enumerate(car.samples) if each.v > 0.1)
        return car.samples[drove + 1].origin - car.samples[drove].origin

    async def main() -> None:
        async with asyncio.timeout(LIMIT):
            while await rested() > 0.2:
                pass

    go(main())


def test_strangers_other_origins_and_other_names_are_sent_away(car: Live) -> None:
    async def main() -> None:
        async with session(car, None) as client:
            for path in ("/socket", "/recordings/a.mcap", "/visitors.svg"):
                assert (await client.get(path)).status == 403
            assert "sign-in.js" in await (await client.get("/")).text()
            assert "app.js" not in await (await client.get("/")).text()
        async with session(car) as client:
            assert "app.js" in await (await client.get("/")).text()
            for origin in ("http://evil.example", "null", "http://127.0.0.1", ""):
                with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                    await client.ws_connect("/socket", headers={"Origin": origin})
                assert (await client.post("/sign-in", data={}, headers={"Origin": origin})).status == 403

    go(main())


def test_the_token_opens_the_door(car: Live) -> None:
    async def main() -> None:
        async with session(car, None) as client:
            answer = await client.post("/sign-in", data={"token": TOKEN})
            assert answer.status == 204
            given = answer.headers["Set-Cookie"]
            assert "HttpOnly" in given and "SameSite=Strict" in given and TOKEN not in given
            page = await client.get("/", headers={"Cookie": given.partition(";")[0]})
            assert "app.js" in await page.text()

    go(main())


def test_wrong_tokens_get_nowhere_and_keep_the_right_one_from_nothing(car: Live) -> None:
    async def main() -> None:
        async with session(car, None) as client:
            answers = [(await client.post("/sign-in", data={"token": f"wrong{k}"})).status for k in range(8)]
            assert set(answers) <= {403, 429} and 429 in answers
            answer = await client.post("/sign-in", data={"token": TOKEN})
            assert answer.status == 204, "the right one is taken, however many wrong ones came from its address"

    go(main())


@pytest.mark.parametrize(
    "path",
    [
        "/../../../etc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/..%2f..%2fserver.py",
        "/static/../server.py",
        "/server.py",
        "/recordings/..%2ftoken",
        "/recordings/%2e%2e%2f%2e%2e%2fetc%2fpasswd",
        "/recordings/token",
        "/recordings//etc/passwd",
        "/recordings/a.mcap%00",
        "//etc/passwd",
        "/index.html%00.js",
        "/\\..\\token",
    ],
)
def test_no_path_leads_to_another_file(car: Live, path: str) -> None:
    with socket.create_connection(("127.0.0.1", car.port)) as raw:
        raw.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{car.port}\r\nConnection: close\r\n\r\n".encode())
        answer = b""
        while piece := raw.recv(65536):
            answer += piece
    assert answer.split(b" ", 2)[1] in (b"400", b"403", b"404")
    assert b"root:" not in answer and TOKEN.encode() not in answer and b"import" not in answer


NONSENSE = (
    "", "{", "null", "[]", '{"do": 3}', '{"do": "__init__"}', '{"do": "drive"}', "[" * 4000,
    '{"do": "drive", "v": 1e999, "omega": 0, "n": 5, "t": 0}', '{"do": "go", "points": [[1]], "n": 9, "t": 1}',
    '{"do": "robot", "name": "nobody"}', '{"do": "robot", "name": [1]}', '{"do": "choose", "topics": 5}',
    '{"do": "wind", "to": "x"}', '{"do": "pong", "ping": "x", "t": 1}',
)  # fmt: skip


def test_messages_that_are_none_harm_nobody(car: Live) -> None:
    async def main() -> None:
        async with page(car) as browser:
            for text in NONSENSE:
                await browser.socket.send_str(text)
            async with asyncio.timeout(LIMIT):
                while browser.page["counts"].get("malformed", 0) < 12:
                    browser.pinged.clear()
                    await browser.pinged.wait()
            await driven(car, browser, drives, 0.5)

    go(main())


def test_a_message_too_long_ends_its_page_alone(car: Live) -> None:
    async def main() -> None:
        async with page(car) as watching, page(car) as browser:
            await browser.socket.send_str("x" * (MESSAGE_MAX + 1))
            await until(lambda: browser.socket.closed)
            watching.pinged.clear()
            await watching.pinged.wait()

    go(main())


def test_a_flood_is_dropped_and_its_page_sent_away_while_another_drives(car: Live) -> None:
    async def main() -> None:
        async with page(car) as driving, page(car) as flooding:

            async def flood() -> None:
                while not flooding.socket.closed:
                    for _ in range(100):
                        await flooding.socket.send_str('{"do": "drive", "v": -1, "omega": 0, "n": 1, "t": 1}')
                    await asyncio.sleep(0.005)

            task = asyncio.create_task(flood())
            async with asyncio.timeout(LIMIT):
                while not task.done():  # until it is sent away
                    await driving.command(do="drive", v=0.4, omega=0.0)
                    await asyncio.sleep(0.04)
                    assert car.call(lambda robot: robot.runtime.state.control.v) >= 0.0
            await driven(car, driving, drives, 0.4)
            await driving.send(do="release")
            await asyncio.gather(task, return_exceptions=True)

    go(main())


def test_a_stop_comes_through_whoever_sends_it_and_however_much_else(car: Live) -> None:
    async def main() -> None:
        async with page(car, visitors_token(TOKEN)) as browser:
            for _ in range(400):
                await browser.socket.send_str("{}")
            await browser.send(do="stop")
            await comes(car, lambda robot: robot.runtime.gate.stopped)

    go(main())


def test_nothing_that_is_secret_stands_in_the_list_of_processes(car: Live) -> None:
    command = Path(f"/proc/{car.pid}/cmdline")
    if not command.exists():
        pytest.skip("there is no /proc")
    assert TOKEN.encode() not in command.read_bytes()


def test_every_answer_says_what_a_browser_may_do_with_it(car: Live) -> None:
    async def main() -> None:
        async with session(car, None) as client:
            for path in ("/", "/style.css", "/nothing"):
                headers = (await client.get(path)).headers
                assert "default-src 'none'" in headers["Content-Security-Policy"]
                assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
                assert headers["X-Content-Type-Options"] == "nosniff"
                assert "Access-Control-Allow-Origin" not in headers

    go(main())


def test_the_page_needs_nothing_from_elsewhere() -> None:
    import re

    from txt1.web.files import page_files

    static = Path(__file__).parents[2] / "txt1" / "web" / "static"
    for name in page_files():
        found = re.findall(r"(?:https?:)?//[a-z0-9.-]+\.[a-z]{2,}", (static / name).read_text())
        assert [each for each in found if "w3.org" not in each] == [], name
    assert sum(len(file.body) for file in page_files().values()) < 100_000


def asking(car: Live) -> socket.socket:
    """A page that has asked for its socket."""
    door = Auth(TOKEN, "http", car.port)
    signed = door.sign_in(TOKEN, time())
    assert signed is not None
    host = f"127.0.0.1:{car.port}"
    raw = socket.create_connection(("127.0.0.1", car.port))
    raw.sendall(
        f"GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nConnection: Upgrade\r\n"
        f"Cookie: {door.cookie}={signed[1]}\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
    )
    return raw


def upgraded(car: Live) -> socket.socket:
    """A page's socket, which answers nothing; after many connections of its address it has to try again."""
    ends = monotonic() + LIMIT
    while True:
        raw = asking(car)
        try:
            if raw.recv(12) == b"HTTP/1.1 101":
                return raw
        except ConnectionError:
            pass
        raw.close()
        assert monotonic() < ends, "it is let in by and by"


def test_who_asks_and_hangs_up_before_the_answer_leaves_no_word_in_the_terminal(car: Live) -> None:
    for _ in range(20):
        with asking(car) as raw:
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # at once, by a reset


@pytest.mark.long
def test_half_a_frame_and_a_head_without_an_end_are_closed(car: Live) -> None:
    with upgraded(car) as frame, socket.create_connection(("127.0.0.1", car.port)) as head:
        frame.sendall(b"\x81\xfe\x10\x00\x01\x02\x03\x04half")  # says 4096 bytes, sends four
        head.sendall(b"GET / HTTP/1.1\r\nX-Endless: ")
        for each in (frame, head):
            each.settimeout(LIMIT)
            while each.recv(65536):
                pass


@pytest.mark.long
def test_a_page_that_reads_nothing_is_sent_away_and_costs_the_others_nothing(car: Live) -> None:
    async def main() -> None:
        async with page(car) as watching:
            with upgraded(car):
                for pages in (2, 1):
                    async with asyncio.timeout(LIMIT):
                        while watching.page["pages"] != pages:
                            watching.pinged.clear()
                            await watching.pinged.wait()

    go(main())


# the last, as its address has no budget for connections after it
@pytest.mark.long
def test_five_hundred_connections_leave_room_for_one_that_asks(car: Live) -> None:
    strangers = [socket.create_connection(("127.0.0.1", car.port)) for _ in range(500)]
    try:
        ends = monotonic() + STRANGER + LIMIT
        while True:
            try:
                with socket.create_connection(("127.0.0.1", car.port), 2.0) as raw:
                    raw.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{car.port}\r\nConnection: close\r\n\r\n".encode())
                    if raw.recv(100).startswith(b"HTTP/1.1 200"):
                        break
            except OSError:
                pass
            assert monotonic() < ends, "strangers are not sent away"
    finally:
        for each in strangers:
            each.close()
    assert car.call(lambda robot: robot.armed)
    assert len(strangers) > CONNECTIONS_MAX
