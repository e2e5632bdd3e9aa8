"""The page's server from its start to its end: where it listens, whom it hangs up on, what it tells robot and pages."""

from __future__ import annotations

import asyncio
import gzip
import json
import socket
import ssl
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

import pytest

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from rigs.ports import free_port  # noqa: E402
from tests.patience import LIMIT  # noqa: E402
from tests.unit.web.test_web_requests import Robot  # noqa: E402
from txt1.web import connections, pages, routes, server  # noqa: E402
from txt1.web.auth import Auth, visitors_token  # noqa: E402
from txt1.web.certificate import own_certificate  # noqa: E402
from txt1.web.connections import STRANGER  # noqa: E402
from txt1.web.pages import FAST, PAGE_RATE, Pages  # noqa: E402
from txt1.web.server import STATUS  # noqa: E402

HOST: Final = "127.0.0.1"
TOKEN: Final = "t0ken-of-the-robot-long-enough"


class Far(Robot):
    """A robot behind a socket pair: it sends lines of telemetry, and then it is gone."""

    def __init__(self) -> None:
        super().__init__()
        self._here, self._there = socket.socketpair()

    def fileno(self) -> int:
        return self._here.fileno()

    def send(self, line: bytes) -> None:
        self._there.sendall(line)

    def newest(self) -> bytes | None:
        line = self._here.recv(1 << 16)
        if not line:
            raise EOFError
        return line

    def go(self) -> None:
        self._there.close()

    def close(self) -> None:
        self._there.close()
        self._here.close()


class Served:
    """A server that runs, and the pages' clock, which the test sets."""

    def __init__(self, robot: Far, port: int, clock: Clock) -> None:
        self.robot, self.port, self.clock = robot, port, clock
        self.task: asyncio.Task[None]

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_connection(HOST, self.port)

    async def answer(self, path: str) -> bytes:
        """The first line of an answer, on a connection of its own; nothing from a server that hangs up."""
        reader, writer = await self.connect()
        try:
            writer.write(f"GET {path} HTTP/1.1\r\nHost: {HOST}\r\n\r\n".encode())
            return await reader.readline()
        except ConnectionError:
            return b""
        finally:
            writer.close()

    async def beats(self, number: int = 3) -> None:
        """Wait for heartbeats."""
        ends = self.robot.times("") + number
        await self.until(lambda: self.robot.times("") >= ends)

    async def hangs_up(self, reader: asyncio.StreamReader) -> bool:
        """Whether a connection ends without a word, and at once: within a thousand heartbeats."""
        before = self.robot.times("")
        return await reader.read() == b"" and self.robot.times("") < before + 1000

    async def until(self, condition: Callable[[], object]) -> None:
        while not condition():
            assert not self.task.done(), "the server has ended"
            await asyncio.sleep(0.001)


class Clock:
    """In place of the clock of the pages. Heartbeats are quick, so that no test waits long."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        patch.setattr(server, "BEAT", 0.001)
        for module in (pages, routes, server):
            patch.setattr(module, "now", lambda: self.now)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


@pytest.fixture
def port() -> int:
    return free_port()


@asynccontextmanager
async def serving(
    clock: Clock, port: int, token: str | None = None, certificate: str | None = None, key: str | None = None
) -> AsyncIterator[Served]:
    robot = Far()
    served = Served(robot, port, clock)
    async with asyncio.timeout(LIMIT):
        served.task = asyncio.create_task(
            server.serve(robot, HOST, port, token, certificate, key, Path("/nowhere"), 0.7, {"b": "http://b/"}, [])
        )
        try:
            await served.until(lambda: robot.asked)
            yield served
            robot.go()
            await served.task
        finally:
            served.task.cancel()
            await asyncio.gather(served.task, return_exceptions=True)
            robot.close()


# -- start and end -----------------------------------------------------------------------------------------------------


def test_by_default_the_page_is_the_computer_s_own_and_visitors_are_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[Any, ...]] = []

    async def serve(*arguments: Any) -> None:
        given.append(arguments)

    monkeypatch.setattr(server, "serve", serve)
    robot: Any = Robot()
    server.main(robot)
    server.main(robot, robots={"b": "http://b/"}, fleet=["a"])
    before = (robot, "127.0.0.1", 8080, None, None, None, Path("out/recordings"), 0.5)
    assert given == [(*before, {}, [], None), (*before, {"b": "http://b/"}, ["a"], None)]


async def test_the_page_is_served_until_the_robot_has_gone_and_then_nothing_is_left(clock: Clock, port: int) -> None:
    async with serving(clock, port) as served:
        robot = served.robot
        assert robot.asked[0] == ("subscribe", {"topics": sorted(FAST), "rate": PAGE_RATE, "seldom": None})
        reader, writer = await served.connect()
        writer.write(f"GET / HTTP/1.1\r\nHost: {HOST}\r\n\r\n".encode())
        assert (await reader.readline()).startswith(b"HTTP/1.1 200")
        await served.beats()
        robot.go()
        await served.task
        for _ in range(10):
            await asyncio.sleep(0)
        assert asyncio.all_tasks() == {asyncio.current_task()}, "no connection is open, and no heart beats"
        await reader.read()
        writer.close()
        loop = asyncio.get_running_loop()
        assert not loop.remove_reader(robot.fileno()), "it is read no more"
        with pytest.raises(ConnectionRefusedError):
            await served.connect()
    async with serving(clock, port) as again:
        assert again.robot.asked, "its address can be used again at once"


async def test_a_page_gets_telemetry_and_knows_the_robot_and_the_others(clock: Clock, port: int) -> None:
    async with serving(clock, port) as served, browser(served) as (_, page):
        status = json.loads((await page.receive()).data)["page"]
        assert (status["role"], status["visitors"], status["invites"]) == ("operator", 0.7, False)
        assert status["robots"] == {"b": "http://b/"}
        served.robot.send(b'{"topics":{"/odom":1}}')
        assert json.loads((await page.receive()).data) == {"topics": {"/odom": 1}}


@asynccontextmanager
async def browser(served: Served, scheme: str = "http", **options: Any) -> AsyncIterator[tuple[Any, Any]]:
    """A page at its socket, and its session."""
    address = f"{scheme}://{HOST}:{served.port}"
    cookies = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(address, headers={"Origin": address}, cookie_jar=cookies, **options) as session:
        if scheme == "https":
            assert (await session.post("/sign-in", data={"token": TOKEN})).status == 204
        async with session.ws_connect("/socket") as page:
            yield session, page


@pytest.mark.parametrize("files", [1, 2])
async def test_a_certificate_encrypts_the_page_and_a_token_is_the_operator_s_invitation(
    files: int, clock: Clock, port: int, tmp_path: Path
) -> None:
    token = tmp_path / "token"
    token.write_text(TOKEN)
    token.chmod(0o600)
    certificate, key = own_certificate(tmp_path, HOST)
    trusts = ssl.create_default_context(cafile=str(certificate))
    if files == 1:
        certificate.write_bytes(certificate.read_bytes() + key.read_bytes())
    names = str(certificate), (str(key) if files == 2 else None)
    async with serving(clock, port, str(token), *names) as served:
        connector = aiohttp.TCPConnector(ssl=trusts)
        async with browser(served, "https", connector=connector) as (session, page):
            status = json.loads((await page.receive()).data)["page"]
            assert (status["role"], status["invites"]) == ("operator", True)
            answer = await session.get("/")
            assert f"wss://{HOST}:{port};" in answer.headers["Content-Security-Policy"]
            given = await session.post("/sign-in", data={"token": visitors_token(TOKEN)})
            assert "Secure" in given.headers["Set-Cookie"] and Auth(TOKEN, "https", port).cookie in given.cookies


async def test_a_form_that_is_packed_is_not_unpacked(clock: Clock, port: int, tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text(TOKEN)
    token.chmod(0o600)
    form = f"token={TOKEN}".encode()
    kind = {"Origin": f"http://{HOST}:{port}", "Content-Type": "application/x-www-form-urlencoded"}
    packed = {**kind, "Content-Encoding": "gzip"}
    async with serving(clock, port, str(token)), aiohttp.ClientSession(f"http://{HOST}:{port}") as session:
        assert (await session.post("/sign-in", data=gzip.compress(form), headers=packed)).status == 403
        assert (await session.post("/sign-in", data=form, headers=kind)).status == 204


async def test_a_port_that_another_program_has_taken_ends_it_with_the_reason(port: int) -> None:
    robot = Far()
    with socket.create_server((HOST, port)), pytest.raises(SystemExit) as ended:
        await server.serve(robot, HOST, port, None, None, None, Path("/nowhere"), 0.5, {}, [])
    robot.close()
    assert ended.match(
        f"txt1: --web {HOST}:{port}: cannot listen there: Address already in use; choose another address"
    )


# -- connections -------------------------------------------------------------------------------------------------------


async def test_one_connection_too_many_takes_the_place_of_the_oldest_that_is_no_page(
    clock: Clock, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "CONNECTIONS_MAX", 3)
    async with serving(clock, port) as served, browser(served) as (_, page):
        (oldest, one), (older, other) = await served.connect(), await served.connect()
        await served.beats()
        assert (await served.answer("/nothing")).startswith(b"HTTP/1.1 404")
        assert await served.hangs_up(oldest)
        other.write(f"GET /robot.svg HTTP/1.1\r\nHost: {HOST}\r\n\r\n".encode())
        assert (await older.readline()).startswith(b"HTTP/1.1 200") and not page.closed
        for each in (one, other):
            each.close()


async def test_only_a_connection_that_has_asked_for_something_may_stay(clock: Clock, port: int) -> None:
    async with serving(clock, port) as served:
        (silent, one), (asking, other) = await served.connect(), await served.connect()
        other.write(f"GET /nothing HTTP/1.1\r\nHost: {HOST}\r\n\r\n".encode())
        assert (await asking.readline()).startswith(b"HTTP/1.1 404")
        clock.now += STRANGER + 0.1
        assert await served.hangs_up(silent)
        other.write(f"GET / HTTP/1.1\r\nHost: {HOST}\r\n\r\n".encode())
        while not (await asking.readline()).startswith(b"HTTP/1.1 200"):
            pass
        for each in (one, other):
            each.close()


async def test_the_robot_has_a_heartbeat_and_pages_get_their_status_once_a_second(
    clock: Clock, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[float] = []

    class Watched(Pages):
        def status_of_all(self) -> None:
            told.append(clock.now)
            super().status_of_all()

    monkeypatch.setattr(server, "Pages", Watched)
    async with serving(clock, port) as served:
        for second in range(3):
            await served.beats()
            assert told == [1000.0 + STATUS * k for k in range(second + 1)]
            clock.now += STATUS
    assert STATUS == 1.0
