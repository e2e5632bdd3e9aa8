"""Which answers a page gets: its files, recordings, the door, the visitors' code and the socket."""

from __future__ import annotations

import asyncio
import gzip
import json
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

import pytest

aiohttp = pytest.importorskip("aiohttp", reason="aiohttp is not installed: the extra 'web'")

from aiohttp import web  # noqa: E402
from aiohttp.test_utils import make_mocked_request  # noqa: E402

import txt1.web  # noqa: E402
from tests.patience import LIMIT  # noqa: E402
from tests.unit.web.test_web_requests import Robot, Socket  # noqa: E402
from txt1.kernel.clock import NS_PER_S  # noqa: E402
from txt1.web import admission, files, routes  # noqa: E402
from txt1.web.admission import HEADERS  # noqa: E402
from txt1.web.auth import Auth, visitors_token  # noqa: E402
from txt1.web.budgets import Budgets  # noqa: E402
from txt1.web.connections import Connections  # noqa: E402
from txt1.web.files import page_files  # noqa: E402
from txt1.web.pages import Pages  # noqa: E402
from txt1.web.routes import ROUTES, Routes, listen  # noqa: E402

TOKEN: Final = "t0ken-of-the-robot-long-enough"
WORDS: Final = {"operator": TOKEN, "visitor": visitors_token(TOKEN)}
STATIC: Final = Path(txt1.web.__file__).parent / "static"


class Site:
    """The page of a robot that writes down what it is asked for, and a browser."""

    client: aiohttp.ClientSession

    def __init__(self, folder: Path, token: str | None) -> None:
        self.robot, self.door = Robot(), Auth(token, "http", 80)
        self.pages = Pages(self.robot, folder, 0.5, {}, [], invites=token is not None)
        self.app = Routes(self.door, self.pages).application(ROUTES)
        self.runner = web.AppRunner(self.app)
        self._writers: list[asyncio.StreamWriter] = []

    async def open(self) -> None:
        await self.runner.setup()
        assert self.runner.server is not None
        self.connections = Connections(self.runner.server, None, routes.now)
        await self.connections.listen("127.0.0.1", 0)
        self.client = aiohttp.ClientSession(f"http://{self.host}", cookie_jar=aiohttp.DummyCookieJar())

    async def close(self) -> None:
        await self.client.close()
        for writer in self._writers:
            writer.close()
        self.connections.close()
        await self.runner.cleanup()

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """A connection by hand, which is closed at the end."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.connections.port)
        self._writers.append(writer)
        return reader, writer

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.connections.port}"

    def headers(self, role: str = "", origin: str | None = None, **others: str) -> dict[str, str]:
        """Of a request by the robot's own page, or by a page from elsewhere."""
        headers = {"Origin": f"http://{self.host}" if origin is None else origin, **others}
        signed = self.door.sign_in(WORDS.get(role, ""), routes.wall())
        return headers | ({"Cookie": f"{self.door.cookie}={signed[1]}"} if signed is not None else {})

    async def ask(self, path: str, role: str = "", method: str = "GET", **options: Any) -> tuple[int, Any, bytes]:
        """Status, headers and content of an answer."""
        headers = options.pop("headers", None) or self.headers(role)
        async with self.client.request(method, path, headers=headers, **options) as answer:
            return answer.status, answer.headers, await answer.read()

    async def sign_in(self, token: str, **options: Any) -> tuple[int, Any]:
        return (await self.ask("/sign-in", method="POST", data={"token": token}, **options))[:2]

    def socket(self, role: str = "operator") -> Any:
        return self.client.ws_connect("/socket", headers=self.headers(role), compress=15)

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait for what the server does next."""
        async with asyncio.timeout(LIMIT):
            while not condition():
                await asyncio.sleep(0)


@asynccontextmanager
async def served(folder: Path, token: str | None = TOKEN) -> AsyncIterator[Site]:
    site = Site(folder, token)
    await site.open()
    try:
        yield site
    finally:
        await site.close()


@pytest.fixture
async def site(tmp_path: Path) -> AsyncIterator[Site]:
    """With a recording, and with what is none."""
    for name in ("run.mcap", "run.txt"):
        (tmp_path / name).write_text(f"content of {name}")
    (tmp_path / "link.mcap").symlink_to("run.txt")
    (tmp_path / "folder.mcap").mkdir()
    async with served(tmp_path) as site:
        yield site


@pytest.fixture
def frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time stands still, so no wrong token is forgotten, however slow the computer is."""
    monkeypatch.setattr(routes, "now", lambda: 0.0)


# -- files -------------------------------------------------------------------------------------------------------------


async def test_the_page_consists_of_its_own_files_by_name_and_kind(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    page_files.cache_clear()
    kinds = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
    assert set(page_files()) == {path.name for path in STATIC.iterdir()}
    for path in STATIC.iterdir():
        assert gzip.decompress(page_files()[path.name].body) == path.read_bytes()
        status, headers, content = await site.ask(f"/{path.name}")
        assert (status, content) == (200, path.read_bytes()), "a browser unpacks it"
        assert headers["Content-Encoding"] == "gzip"
        kind = kinds.get(path.suffix[1:], "application/manifest+json")
        assert headers["Content-Type"].partition(";")[0] == kind
    page_files.cache_clear()
    monkeypatch.delitem(files.TYPES, "js")
    assert "app.js" not in page_files() and "index.html" in page_files()
    page_files.cache_clear()


async def test_a_browser_asks_each_time_and_fetches_a_file_only_if_it_is_another(site: Site) -> None:
    status, first, _ = await site.ask("/style.css")
    assert status == 200 and first["Cache-Control"] == "no-cache"
    for tag, answer in ((first["ETag"], 304), ('"another"', 200)):
        status, headers, content = await site.ask("/style.css", headers=site.headers(**{"If-None-Match": tag}))
        assert (status, bool(content)) == (answer, answer == 200)
        assert (headers["ETag"], headers["Cache-Control"]) == (first["ETag"], "no-cache")


MAY_ASK: Final = {
    ("GET", "/"): ("", "visitor", "operator"),
    ("POST", "/sign-in"): ("", "visitor", "operator"),
    ("POST", "/sign-out"): ("", "visitor", "operator"),
    ("GET", "/socket"): ("visitor", "operator"),
    ("GET", "/stop"): ("visitor", "operator"),
    ("GET", "/visitors.svg"): ("operator",),
    ("GET", "/recordings/{name}"): ("visitor", "operator"),
    ("GET", "/{name}"): ("", "visitor", "operator"),
}
"""Who may ask for which route; "" is a stranger."""


async def test_each_route_is_for_its_roles_and_there_is_no_other(site: Site) -> None:
    there = {(route.method, getattr(route.resource, "canonical", "")) for route in site.app.router.routes()}
    assert there == set(MAY_ASK)
    for (method, path), roles in MAY_ASK.items():
        for role in ("", "visitor", "operator"):
            status, _, _ = await site.ask(path.replace("{name}", "run.mcap"), role, method, data={"token": TOKEN})
            assert (status == 403) == (role not in roles), (method, path, role)


@pytest.mark.parametrize(
    ("path", "stranger", "visitor", "operator"),
    [
        ("/", "sign-in.html", "index.html", "index.html"),
        ("/style.css", 200, 200, 200),
        ("/nothing", 404, 404, 404),
        ("/server.py", 404, 404, 404),
        ("/visitors.svg", 403, 403, 200),
        ("/recordings/run.mcap", 403, 200, 200),
        ("/recordings/run.txt", 403, 404, 404),
        ("/recordings/none.mcap", 403, 404, 404),
        ("/recordings/link.mcap", 403, 404, 404),
        ("/recordings/folder.mcap", 403, 404, 404),
        ("/socket", 403, 400, 400),
        ("/stop", 403, 400, 400),
    ],
)
async def test_what_strangers_visitors_and_the_operator_may_fetch(
    path: str, stranger: int | str, visitor: int | str, operator: int | str, site: Site
) -> None:
    for role, expected in (("", stranger), ("visitor", visitor), ("operator", operator)):
        status, _, content = await site.ask(path, role)
        if isinstance(expected, str):
            assert (status, content) == (200, (STATIC / expected).read_bytes()), role
        else:
            assert status == expected, role


async def test_a_recording_is_saved_and_not_shown(site: Site) -> None:
    _, headers, content = await site.ask("/recordings/run.mcap", "visitor")
    assert headers["Content-Disposition"] == 'attachment; filename="run.mcap"'
    assert content == b"content of run.mcap"


@pytest.mark.parametrize("path", ["/", "/style.css", "/nothing", "/recordings/run.mcap", "/recordings/run.txt"])
async def test_every_answer_limits_what_a_browser_may_do_with_it(path: str, site: Site) -> None:
    for origin in (None, "http://evil.example"):
        _, headers, _ = await site.ask(path, headers=site.headers("operator", origin))
        limits(headers, site)


def limits(headers: Any, site: Site) -> None:
    assert {name: headers.get(name) for name in HEADERS} == HEADERS
    policy = dict(part.split(" ", 1) for part in headers["Content-Security-Policy"].split("; "))
    assert policy["default-src"] == policy["base-uri"] == policy["frame-ancestors"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["form-action"] == "'self'"
    assert policy["connect-src"] == f"'self' ws://{site.host}"
    assert "Access-Control-Allow-Origin" not in headers


# -- the door ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("origin", ["http://evil.example", "null", ""])
@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("POST", "/sign-in", 403),
        ("POST", "/sign-out", 403),
        ("POST", "/socket", 403),
        ("GET", "/socket", 403),
        ("GET", "/stop", 403),
        ("GET", "/", 200),
        ("GET", "/style.css", 200),
    ],
)
async def test_a_page_from_elsewhere_changes_nothing_and_gets_no_socket(
    method: str, path: str, status: int, origin: str, site: Site
) -> None:
    answer, headers, _ = await site.ask(
        path,
        method=method,
        headers=site.headers("operator", origin),
        data={"token": TOKEN} if method == "POST" else None,
    )
    assert answer == status and "Set-Cookie" not in headers
    limits(headers, site)


@pytest.mark.parametrize(
    ("token", "host", "status"), [(None, "evil.example", 421), (TOKEN, "robot.local", 200), (TOKEN, "a;b", 421)]
)
async def test_a_name_that_is_not_the_robot_s_gets_no_page(
    token: str | None, host: str, status: int, tmp_path: Path
) -> None:
    async with served(tmp_path, token) as site:
        assert (await site.ask("/", headers={"Host": host}))[0] == status
        assert (await site.ask("/"))[0] == 200


async def test_without_a_token_every_page_is_the_operator_s_and_invites_nobody(tmp_path: Path) -> None:
    async with served(tmp_path, None) as site:
        assert (await site.ask("/"))[2] == (STATIC / "index.html").read_bytes()
        assert (await site.ask("/visitors.svg"))[0] == 403
        assert (await site.sign_in(""))[0] == 403


@pytest.mark.parametrize("role", WORDS)
async def test_a_token_signs_a_page_in_and_out_again(role: str, site: Site) -> None:
    status, headers = await site.sign_in(f" {WORDS[role]}\n")
    assert status == 204
    cookie, *kept = headers["Set-Cookie"].split("; ")
    assert sorted(kept) == ["HttpOnly", "Path=/", "SameSite=Strict"], "without TLS it cannot be Secure"
    assert WORDS[role] not in cookie
    assert site.door.role(cookie.partition("=")[2], routes.wall()) == role
    assert (await site.ask("/", headers={"Cookie": cookie}))[2] == (STATIC / "index.html").read_bytes()
    status, headers, _ = await site.ask("/sign-out", method="POST")
    assert status == 204
    assert re.match(rf'{site.door.cookie}="";.*Max-Age=0; Path=/', headers["Set-Cookie"])


async def test_a_session_lasts_hours_of_the_computer_s_clock(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(admission, "wall_ns", lambda: 2_000_000_000 * NS_PER_S)
    assert routes.wall() == 2e9
    headers = site.headers("operator")
    for hours, status in ((11, 200), (13, 403)):
        monkeypatch.setattr(admission, "wall_ns", lambda hours=hours: (2_000_000_000 + hours * 3600) * NS_PER_S)
        assert (await site.ask("/recordings/run.mcap", headers=headers))[0] == status


@pytest.mark.usefixtures("frozen")
async def test_wrong_tokens_are_limited_for_their_address_and_the_right_one_is_not(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = [await site.sign_in(f"wrong{k}") for k in range(7)]
    assert [status for status, _ in answers] == [403] * 5 + [429] * 2
    assert not any("Set-Cookie" in headers for _, headers in answers)
    assert (await site.sign_in(TOKEN))[0] == 204
    counted: list[str] = []
    monkeypatch.setattr(site.door, "failed", lambda address, now: counted.append(address))
    await site.sign_in("wrong")
    assert counted == ["127.0.0.1"]


async def test_who_sends_half_a_token_is_not_waited_for(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "STRANGER", 0.0)
    reader, writer = await asyncio.open_connection("127.0.0.1", site.connections.port)
    form = "Content-Type: application/x-www-form-urlencoded\r\nContent-Length: 100"
    writer.write(
        f"POST /sign-in HTTP/1.1\r\nHost: {site.host}\r\nOrigin: http://{site.host}\r\n{form}\r\n\r\ntoken=".encode()
    )
    assert (await reader.readline()).startswith(b"HTTP/1.1 408")
    writer.close()


async def test_the_operator_s_code_invites_visitors_only(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    import segno

    made: list[str] = []
    make = segno.make
    monkeypatch.setattr(segno, "make", lambda text, **options: made.append(text) or make(text, **options))
    status, headers, content = await site.ask("/visitors.svg", "operator")
    assert made == [f"http://{site.host}/#token={visitors_token(TOKEN)}"]
    assert (status, headers["Content-Type"]) == (200, "image/svg+xml")
    assert b'xmlns="http://www.w3.org/2000/svg"' in content and content.rstrip().endswith(b"</svg>")


# -- connections -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("role", WORDS)
async def test_a_page_at_its_socket_has_its_role_asks_for_things_and_leaves(role: str, site: Site) -> None:
    async with site.socket(role) as socket:
        assert json.loads((await socket.receive()).data)["page"]["role"] == role
        [page] = site.pages.connected.values()
        assert (page.role, page.address) == (role, "127.0.0.1")
        assert socket.compress == 0, "a small message could unpack to a large one"
        await socket.send_str('{"do": "stop", "stop": 7}')
        assert json.loads((await socket.receive()).data) == {"stop": 7}
        assert site.robot.times("stop") == 1
        page.car.wheel.take(page.number, role == "operator", 0.0)
    await site.until(lambda: not site.pages.connected)
    assert page.car.wheel.holder == 0 and site.robot.asked[-2:] == [("release", {}), ("halt", {})]
    await site.until(lambda: not any("Pages.send" in str(task) for task in asyncio.all_tasks()))


@pytest.mark.parametrize("role", ["", "visitor", "operator"])
async def test_the_operators_reserve_is_theirs_who_have_signed_in(role: str, site: Site) -> None:
    await site.ask("/", role)
    [connection] = site.connections.open
    assert connection.account.operator is connection.account.address.operator is (role == "operator")


async def test_a_request_whose_connection_has_gone_is_paid_by_nobody(site: Site) -> None:
    request = make_mocked_request("GET", "/")
    with pytest.raises(ConnectionResetError):
        Routes(site.door, site.pages).pay(request)


@pytest.mark.parametrize(("version", "hosts"), [("1.0", 0), ("1.1", 0), ("1.1", 2)])
async def test_a_request_that_names_no_host_or_two_is_a_bad_one(version: str, hosts: int, site: Site) -> None:
    reader, writer = await site.connect()
    writer.write(f"GET / HTTP/{version}\r\n".encode() + f"Host: {site.host}\r\n".encode() * hosts + b"\r\n")
    assert (await reader.readline()).split()[1] == b"400"


async def test_one_page_more_than_there_may_be_is_refused(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "PAGES_MAX", 3)
    monkeypatch.setattr(routes, "OPERATORS", 1)
    async with site.socket(), site.socket("visitor"):
        with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
            await site.socket("visitor")
        async with site.socket("operator"):
            with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
                await site.socket()
            assert len(site.pages.connected) == 3
    await site.until(lambda: not site.pages.connected)
    async with site.socket("visitor"):
        assert len(site.pages.connected) == 1


async def test_a_page_that_sends_anything_but_text_has_left(tmp_path: Path) -> None:
    async def messages() -> AsyncIterator[aiohttp.WSMessage]:
        stop = '{"do": "stop"}'
        yield aiohttp.WSMessage(aiohttp.WSMsgType.TEXT, stop, None)
        yield aiohttp.WSMessage(aiohttp.WSMsgType.BINARY, stop.encode(), None)
        raise AssertionError("is read no further")

    async with served(tmp_path) as site:
        account = Budgets().account("127.0.0.1")
        page = site.pages.join("operator", "127.0.0.1", Socket(), account)  # type: ignore[arg-type]
        await listen(site.pages, page, messages())  # type: ignore[arg-type]
        assert site.robot.times("stop") == 1
