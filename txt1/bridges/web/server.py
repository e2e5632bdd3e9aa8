"""The server of the web page: telemetry to every page, and what pages ask for to the robot.

Every page has a socket. What it sends is bounded in size and number; a command is as old as its own time stamp says
(`PageClock`), and of a page that is too slow only the newest telemetry waits. A stop needs no wheel and no budget.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections import Counter, deque
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import Any, Final, Protocol

from aiohttp import WSCloseCode, WSMsgType, web

from txt1.beside import BEAT, Connection
from txt1.bridges.web.door import Door, Role
from txt1.bridges.web.files import page_files
from txt1.bridges.web.player import Player, recordings, strict
from txt1.bridges.web.wheel import AGE_MAX, Budget, PageClock, Sequence, Wheel
from txt1.errors import CommandRefused
from txt1.kernel.clock import NS_PER_S, RealClock, seconds, wall_ns
from txt1.record.view_proxy import token_in

PAGES_MAX: Final = 100
CONNECTIONS_MAX: Final = 256
STRANGER: Final = 5.0  # s that a connection has for its first request
MESSAGE_MAX: Final = 8192  # bytes of a page's message
MESSAGES: Final = (80.0, 160.0)  # a second, and at once, of one page; more are dropped
FLOOD: Final = 5000  # messages dropped after which a page is sent away
SLOW: Final = 10.0  # s in which a page must have taken what it was sent
SOCKET_BEAT: Final = 4.0  # s between two pings of a socket; one that is not answered in half of it is closed
RATE: Final = 20.0  # telemetry a second
UNSEEN: Final = 0.1  # the same of a robot that no page shows, of several
FAST: Final = ("/odom", "/odometry/filtered", "/setpoint", "/pose", "/vehicles", "/mode", "/driver")
FULL: Final = "/capabilities"  # is told with everything else, once a second
CHOSEN_MAX: Final = 20  # topics that a page may choose
POINTS_MAX: Final = 100  # of a route
STATUS: Final = 1.0  # s between two messages about the page itself
NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}\.mcap")

_clock: Final = RealClock()

HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "gamepad=(self), camera=(), microphone=(), geolocation=()",
}


def now() -> float:
    """Seconds on this process's clock."""
    return seconds(_clock.now_ns())


def wall() -> float:
    """Seconds since 1970: for sessions alone."""
    return wall_ns() / NS_PER_S


@dataclass(eq=False)
class Car:
    """One robot, as pages see it."""

    name: str  # empty where there is only one
    wheel: Wheel = field(default_factory=Wheel)
    full: str = ""  # the newest telemetry with everything in it
    wanted: tuple[frozenset[str], float] | None = None  # topics asked for, and how often a second


@dataclass(eq=False)
class Page:
    """One page that is connected."""

    number: int
    role: Role
    address: str
    socket: web.WebSocketResponse
    car: Car  # the robot that it shows
    clock: PageClock = field(default_factory=PageClock)
    sequence: Sequence = field(default_factory=Sequence)
    budget: Budget = field(default_factory=lambda: Budget(*MESSAGES))
    counts: Counter[str] = field(default_factory=Counter)  # late, dropped and malformed messages
    round_trip: float | None = None  # s, of the last message there and back
    chosen: frozenset[str] = frozenset()  # topics that it plots
    player: Player | None = None  # of the recording it sees in place of the robot
    outbox: deque[str] = field(default_factory=lambda: deque(maxlen=50))
    newest: str | None = None  # telemetry that waits to be sent
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def tell(self, **message: object) -> None:
        """Send it a message."""
        self.outbox.append(json.dumps(message, separators=(",", ":")))
        self.news.set()

    def show(self, line: str) -> None:
        """Send it telemetry, in place of what it has not taken yet."""
        self.newest = line
        self.news.set()


class Robots(Protocol):
    """The way to a robot, or to several: a `Connection`, or a fleet on a network."""

    def fileno(self) -> int:
        """Of what becomes readable when there is telemetry."""

    def newest(self) -> bytes | None:
        """The newest telemetry; None: there is none; EOFError or OSError: there will be none any more."""

    def request(self, name: str, /, **fields: object) -> None:
        """Ask for something; OSError: nobody is there; CommandRefused: not this."""


class Server:
    """Pages on one side, the robot on the other."""

    def __init__(
        self, robot: Robots, door: Door, folder: Path, speed: float, robots: Mapping[str, str], fleet: list[str]
    ) -> None:
        self._robot, self._door, self._folder, self._robots = robot, door, folder, dict(robots)
        self._fleet = fleet
        self._cars = {name: Car(name) for name in fleet or [""]}
        self._limit = speed  # m/s, of visitors
        self._pages: dict[int, Page] = {}
        self._last_page = 0
        self.ended = asyncio.Event()  # the robot's process has gone
        self.connected: dict[web.RequestHandler, float] = {}  # without a request yet, and since when
        self._loading = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._requests: Mapping[str, Callable[[Page, dict[str, Any], float], None]] = {
            name.removeprefix("_do_"): getattr(self, name) for name in dir(self) if name.startswith("_do_")
        }  # what a page may ask for, by the names of the methods below

    def application(self) -> web.Application:
        """The routes."""
        app = web.Application(middlewares=[self._guard], client_max_size=MESSAGE_MAX)
        app.router.add_get("/", self._index)
        app.router.add_post("/sign-in", self._sign_in)
        app.router.add_post("/sign-out", self._sign_out)
        app.router.add_get("/socket", self._socket)
        app.router.add_get("/visitors.svg", self._visitors)
        app.router.add_get("/recordings/{name}", self._recording)
        app.router.add_get("/{name}", self._file)
        return app

    # -- HTTP --------------------------------------------------------------------------------------------------

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Look at where a request goes and comes from; add the headers that every answer has."""
        self.connected.pop(request.protocol, None)
        try:
            if not self._door.knows_host(request.host):
                raise web.HTTPMisdirectedRequest(text="this robot is not known by that name\n")
            foreign = not self._door.knows_origin(request.headers.get("Origin"), request.host)
            if foreign and (request.method != "GET" or request.path == "/socket"):
                raise web.HTTPForbidden(text="only the robot's own page may ask for that\n")
            response = await handler(request)
        except web.HTTPException as answer:
            response = answer
        except (TimeoutError, ConnectionError):  # it says nothing, or is gone before it is answered
            response = web.Response(status=408)
        if not response.prepared:
            response.headers.update(HEADERS)
            sockets = f"{'wss' if request.secure else 'ws'}://{request.host}"
            response.headers["Content-Security-Policy"] = (
                f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
                f"connect-src 'self' {sockets}; manifest-src 'self'; form-action 'self'; base-uri 'none'; "
                "frame-ancestors 'none'"
            )
        return response

    def _role(self, request: web.Request) -> Role | None:
        return self._door.role(request.cookies.get(self._door.cookie), wall())

    async def _index(self, request: web.Request) -> web.Response:
        return self._answer(request, "index.html" if self._role(request) else "sign-in.html")

    async def _file(self, request: web.Request) -> web.Response:
        return self._answer(request, request.match_info["name"])

    def _answer(self, request: web.Request, name: str) -> web.Response:
        file = page_files().get(name)
        if file is None:
            raise web.HTTPNotFound(text="there is no such page\n")
        headers = {"Content-Encoding": "gzip", "Cache-Control": "no-cache", "ETag": file.tag, "Content-Type": file.kind}
        if request.headers.get("If-None-Match") == file.tag:
            return web.Response(status=304, headers={"ETag": file.tag, "Cache-Control": "no-cache"})
        return web.Response(body=file.body, headers=headers)

    async def _sign_in(self, request: web.Request) -> web.Response:
        if not self._door.may_try(request.remote or "", now()):
            raise web.HTTPTooManyRequests(text="too many tries; wait a few seconds\n")
        async with asyncio.timeout(STRANGER):
            given = (await request.post()).get("token", "")
        signed = self._door.sign_in(str(given).strip(), wall())
        if signed is None:
            self._door.failed(request.remote or "", now())
            raise web.HTTPForbidden(text="that is not the token\n")
        response = web.Response(status=204)
        response.set_cookie(
            self._door.cookie, signed[1], httponly=True, samesite="Strict", secure=request.secure, path="/"
        )
        return response

    async def _sign_out(self, request: web.Request) -> web.Response:
        response = web.Response(status=204)
        response.del_cookie(self._door.cookie, path="/")
        return response

    async def _visitors(self, request: web.Request) -> web.Response:
        """The visitors' way in, as a QR code, for the operator to show."""
        token = self._door.visitors_token
        if self._role(request) != "operator" or token is None:
            raise web.HTTPForbidden(text="only the operator invites\n")
        import segno

        code = segno.make(f"{request.scheme}://{request.host}/#token={token}", error="m")
        return web.Response(
            body=code.svg_inline(scale=4, border=2, light="white").encode(), content_type="image/svg+xml"
        )

    async def _recording(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        path = self._folder / name
        if self._role(request) is None:
            raise web.HTTPForbidden(text="sign in first\n")
        if not NAME.fullmatch(name) or path.is_symlink() or not path.is_file():
            raise web.HTTPNotFound(text="there is no such recording\n")
        return web.FileResponse(path, headers={"Content-Disposition": f'attachment; filename="{name}"'})

    # -- pages -------------------------------------------------------------------------------------------------

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        role = self._role(request)
        if role is None:
            raise web.HTTPForbidden(text="sign in first\n")
        if len(self._pages) >= PAGES_MAX:
            raise web.HTTPServiceUnavailable(text=f"there are {PAGES_MAX} pages already\n")
        socket = web.WebSocketResponse(heartbeat=SOCKET_BEAT, max_msg_size=MESSAGE_MAX, compress=False)
        await socket.prepare(request)
        self._last_page += 1
        page = Page(self._last_page, role, request.remote or "", socket, next(iter(self._cars.values())))
        self._pages[page.number] = page
        sender = asyncio.create_task(self._send(page))
        self._subscribe()
        page.show(page.car.full)
        self._status(page)
        try:
            async for message in socket:
                if message.type is not WSMsgType.TEXT:
                    break
                self._take(page, message.data)
        finally:
            sender.cancel()
            if page.player is not None:
                page.player.stop()
            del self._pages[page.number]
            if page.car.wheel.holder == page.number:
                page.car.wheel.give(page.number)
                self._ask(page, "release")
            self._subscribe()
            self._status()
        return socket

    async def _send(self, page: Page) -> None:
        """Send a page what there is, as fast as it takes it; one that takes nothing is sent away."""
        try:
            while True:
                await page.news.wait()
                page.news.clear()
                async with asyncio.timeout(SLOW):
                    while page.outbox:
                        await page.socket.send_str(page.outbox.popleft())
                    line, page.newest = page.newest, None
                    if line:
                        await page.socket.send_str(line)
        except (ConnectionError, RuntimeError):
            pass  # it has gone
        except TimeoutError:
            self._dismiss(page, "too slow")

    def _dismiss(self, page: Page, why: str) -> None:
        """Send a page away."""
        self._later(page.socket.close(code=WSCloseCode.POLICY_VIOLATION, message=why.encode()))

    def _later(self, work: Any) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _status(self, *pages: Page) -> None:
        """Tell pages, all if none are given, about themselves."""
        for page in pages or tuple(self._pages.values()):
            page.tell(
                page={
                    "number": page.number, "role": page.role, "limit": self._limit_of(page),
                    "visitors": self._limit, "wheel": page.car.wheel.holder, "pages": len(self._pages),
                    "round_trip": page.round_trip, "counts": dict(page.counts), "robots": self._robots,
                    "invites": page.role == "operator" and self._door.visitors_token is not None,
                    "replay": page.player and page.player.status(), "fleet": self._fleet, "robot": page.car.name,
                },
                ping=now(),
            )  # fmt: skip

    def _limit_of(self, page: Page) -> float | None:
        """The fastest that a page may drive, m/s; None where only the safety gate limits it."""
        return self._limit if page.role == "visitor" else None

    # -- what pages ask for ------------------------------------------------------------------------------------

    def _take(self, page: Page, text: str) -> None:
        """Do what a page asks for."""
        present = now()
        if not page.budget.spend(present) and '"stop"' not in text[:40]:
            page.counts["dropped"] += 1
            if page.counts["dropped"] == FLOOD:
                self._dismiss(page, "too many messages")
            return
        try:
            message = json.loads(text)
            self._requests[message["do"]](page, message, present)
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
            page.counts["malformed"] += 1

    def _fresh(self, page: Page, message: dict[str, Any], present: float) -> float | None:
        """The age of a command in s; None when it is late, and then it is counted."""
        age = page.clock.age(float(message["t"]), present)
        if page.sequence.accepts(message["n"]) and 0.0 <= age <= AGE_MAX:
            return age
        page.counts["late"] += 1
        return None

    def _do_pong(self, page: Page, message: dict[str, Any], present: float) -> None:
        sent = float(message["ping"])
        if 0.0 <= present - sent < 60.0:
            page.clock.answered(sent, float(message["t"]), present)
            page.round_trip = present - sent

    def _do_stop(self, page: Page, message: dict[str, Any], present: float) -> None:
        """All of a fleet stop, whichever the page shows."""
        self._ask(None, "stop")

    def _do_drive(self, page: Page, message: dict[str, Any], present: float) -> None:
        """V in m/s, omega in rad/s; with zeros the page holds the wheel and the robot stands."""
        v, omega = float(message["v"]), float(message["omega"])
        if not (isfinite(v) and isfinite(omega)):
            raise ValueError("not finite")
        age = self._fresh(page, message, present)
        if age is None or page.player is not None:
            return
        before = page.car.wheel.holder
        if not page.car.wheel.drive(page.number, present):
            page.counts["refused"] += 1
            return
        if before != page.number:
            self._status()
        limit = self._limit_of(page)
        if limit is not None and abs(v) > limit:
            v, omega = v * limit / abs(v), omega * limit / abs(v)
        if v == 0.0 and omega == 0.0:
            self._ask(page, "request")
        self._ask(page, "drive", v=v, omega=omega, age=age)

    def _do_release(self, page: Page, message: dict[str, Any], present: float) -> None:
        """Let go of the stick: nothing moves, and the wheel stays this page's. It is never too late for that."""
        page.sequence.accepts(message.get("n"))
        if page.car.wheel.holder == page.number:
            self._ask(page, "release")
            self._ask(page, "halt")

    def _do_take(self, page: Page, message: dict[str, Any], present: float) -> None:
        if page.player is None and page.car.wheel.take(page.number, present):
            self._ask(page, "release")  # what the page before had asked for
            self._ask(page, "halt")
        else:
            page.tell(told=f"page {page.car.wheel.holder} drives; it may give the wheel away, or be idle for 10 s")
        self._status()

    def _do_give(self, page: Page, message: dict[str, Any], present: float) -> None:
        if page.car.wheel.holder == page.number:
            self._ask(page, "release")
            self._ask(page, "halt")
            page.car.wheel.give(page.number)
            self._status()

    def _do_arm(self, page: Page, message: dict[str, Any], present: float) -> None:
        if self._fresh(page, message, present) is None:
            page.tell(told="that came too late: hold again")
        elif page.player is None and page.car.wheel.take(page.number, present):
            self._ask(page, "arm")
            self._status()
        else:
            page.tell(told=f"page {page.car.wheel.holder} drives: only it arms the robot")

    def _do_disarm(self, page: Page, message: dict[str, Any], present: float) -> None:
        self._ask(page, "disarm", reason=f"disarmed by web page {page.number}")

    def _do_go(self, page: Page, message: dict[str, Any], present: float) -> None:
        """Drive along points, m, as long as the page says `hold`."""
        points = [[float(x), float(y)] for x, y in message["points"]]
        wanted = float(message.get("speed", 0.5))
        if not (0 < len(points) <= POINTS_MAX and all(map(isfinite, chain(*points))) and 0.0 < wanted <= 1.5):
            raise ValueError("points or speed")
        if page.player is None and self._fresh(page, message, present) is not None:
            if not page.car.wheel.drive(page.number, present):
                page.tell(told=f"page {page.car.wheel.holder} drives")
                return
            speed = min(wanted, self._limit_of(page) or wanted)
            self._ask(page, "go", points=points, speed=speed)

    def _do_hold(self, page: Page, message: dict[str, Any], present: float) -> None:
        age = self._fresh(page, message, present)
        if age is not None and page.car.wheel.holder == page.number and page.car.wheel.drive(page.number, present):
            self._ask(page, "hold", age=age)

    def _do_gains(self, page: Page, message: dict[str, Any], present: float) -> None:
        if self._operates(page):
            self._ask(page, "gains", linear=message["linear"], angular=message["angular"])

    def _do_limit(self, page: Page, message: dict[str, Any], present: float) -> None:
        limit = float(message["speed"])
        if self._operates(page) and 0.1 <= limit <= 1.5:
            self._limit = limit
            self._status()

    def _do_record(self, page: Page, message: dict[str, Any], present: float) -> None:
        if self._operates(page):
            self._ask(page, "record", on=bool(message["on"]))

    def _operates(self, page: Page) -> bool:
        if page.role != "operator":
            page.tell(told="visitors may look and drive; this is the operator's")
        return page.role == "operator"

    def _do_robot(self, page: Page, message: dict[str, Any], present: float) -> None:
        """Show another robot of the fleet, and let go of this one."""
        car = self._cars[message["name"]]
        if car is not page.car:
            self._do_give(page, message, present)
            page.car, page.chosen = car, frozenset()
            self._subscribe()
            page.show(car.full)
        self._status(page)

    def _do_choose(self, page: Page, message: dict[str, Any], present: float) -> None:
        topics = message["topics"]
        if not (isinstance(topics, list) and len(topics) <= CHOSEN_MAX and all(isinstance(t, str) for t in topics)):
            raise ValueError("topics")
        page.chosen = frozenset(t[:100] for t in topics)
        self._subscribe()

    def _do_files(self, page: Page, message: dict[str, Any], present: float) -> None:
        page.tell(files=recordings(self._folder, NAME))

    def _do_replay(self, page: Page, message: dict[str, Any], present: float) -> None:
        """Show a recording in place of the robot; without a name the robot again."""
        name = message.get("name")
        if page.player is not None:
            page.player.stop()
            page.player = None
        if name is not None and not NAME.fullmatch(str(name)):
            raise ValueError("name")
        self._do_give(page, message, present)
        if name is not None:
            self._later(self._replay(page, str(name)))
        else:
            page.show(page.car.full)
        self._status(page)

    async def _replay(self, page: Page, name: str) -> None:
        try:
            async with self._loading:  # one at a time: it takes memory
                player = await asyncio.to_thread(Player.open, self._folder / name)
            if page.number in self._pages:
                page.player = player
                self._status(page)
                await player.play(page.show, now)
        except Exception as error:  # whatever is wrong with the file
            page.tell(told=f"{name} cannot be shown: {error}")

    def _do_wind(self, page: Page, message: dict[str, Any], present: float) -> None:
        """Move within the recording, or set its speed; 0 pauses."""
        if page.player is not None:
            page.player.wind(message.get("to"), message.get("speed"))
            self._status(page)

    # -- the robot ---------------------------------------------------------------------------------------------

    def _ask(self, page: Page | None, name: str, **fields: object) -> None:
        """Ask a page's robot for something, or all of them."""
        if page is not None and self._fleet:
            fields["robot"] = page.car.name
        try:
            self._robot.request(name, **fields)
        except CommandRefused as error:
            if page is not None:
                page.tell(told=str(error))
        except OSError:
            self.ended.set()

    def _subscribe(self) -> None:
        """Ask for the topics that pages want to see often, if they are others than before."""
        for car in self._cars.values():
            pages = [page for page in self._pages.values() if page.car is car]
            unseen = bool(self._fleet) and not pages
            wanted = frozenset(FAST).union(*(page.chosen for page in pages)), UNSEEN if unseen else RATE
            if wanted != car.wanted:
                car.wanted = wanted
                if unseen:
                    car.full = ""  # whoever looks next waits for what is new
                which = {"robot": car.name} if self._fleet else {}
                self._ask(None, "subscribe", topics=sorted(wanted[0]), rate=wanted[1], seldom=None, **which)

    def hear(self) -> None:
        """Take telemetry and hand it on."""
        try:
            line = self._robot.newest()
        except (EOFError, OSError):
            self.ended.set()
            return
        if line is None:
            return
        if not self._fleet:
            self._show(self._cars[""], strict(line.decode()))
        else:
            for each in json.loads(line, parse_constant=lambda _: None):
                car = self._cars.get(each["name"])
                if car is None:  # one that has come to a fleet on a network
                    car = self._cars[each["name"]] = Car(each["name"])
                    self._fleet.append(car.name)
                self._show(car, json.dumps(each, separators=(",", ":")))

    def _show(self, car: Car, text: str) -> None:
        if f'"{FULL}":' in text:
            car.full = text
        for page in self._pages.values():
            if page.car is car and page.player is None:
                page.show(text)

    async def beat(self) -> None:
        """Send the heartbeat that the robot listens for, and pages what they should know of themselves."""
        wanted = frozenset(FAST), UNSEEN if self._fleet else RATE
        for car in self._cars.values():
            car.wanted = wanted
        self._ask(None, "subscribe", topics=sorted(wanted[0]), rate=wanted[1], seldom=None)
        self._subscribe()
        due = now()
        while True:
            self._ask(None, "")
            if now() >= due:
                due = now() + STATUS
                self._status()
                for protocol, since in tuple(self.connected.items()):
                    if now() - since > STRANGER:
                        del self.connected[protocol]
                        protocol.force_close()
            await asyncio.sleep(BEAT)


def main(
    robot: Connection,
    host: str = "127.0.0.1",
    port: int = 8080,
    token: str | None = None,
    certificate: str | None = None,
    key: str | None = None,
    folder: str = "out/recordings",
    speed: float = 0.5,
    robots: Mapping[str, str] | None = None,
    fleet: list[str] | None = None,
) -> None:
    """Serve the page until the robot's process ends.

    Here `token`, `certificate` and `key` are files, `robots` the addresses of others' pages, and `fleet` the names of
    this process's robots, where there are several.
    """
    asyncio.run(serve(robot, host, port, token, certificate, key, Path(folder), speed, robots or {}, fleet or []))


async def serve(
    robot: Robots,
    host: str,
    port: int,
    token: str | None,
    certificate: str | None,
    key: str | None,
    folder: Path,
    speed: float,
    robots: Mapping[str, str],
    fleet: list[str],
) -> None:
    """As `main`, with any way to the robots, in an event loop."""
    context = None
    if certificate is not None:
        from txt1.bridges.web.certificate import tls  # cryptography takes a while to load

        context = tls(Path(certificate), None if key is None else Path(key))
    door = Door(None if token is None else token_in(Path(token)), "http" if context is None else "https", port)
    server = Server(robot, door, folder, speed, robots, fleet)
    runner = web.AppRunner(server.application(), access_log=None, keepalive_timeout=15.0, shutdown_timeout=0.5)
    await runner.setup()
    serve = runner.server
    assert serve is not None

    def connect() -> asyncio.BaseProtocol:
        """A protocol for a new connection: one that hangs up at once where there are too many."""
        if len(serve.connections) >= CONNECTIONS_MAX:
            return _Full()
        protocol = serve()
        server.connected[protocol] = now()
        return protocol

    loop = asyncio.get_running_loop()
    patience = None if context is None else STRANGER
    listener = await loop.create_server(
        connect, host, port, ssl=context, reuse_address=True, ssl_handshake_timeout=patience
    )
    beating = asyncio.create_task(server.beat())
    loop.add_reader(robot.fileno(), server.hear)
    try:
        await server.ended.wait()
    finally:
        loop.remove_reader(robot.fileno())
        beating.cancel()
        listener.close()
        await runner.cleanup()


class _Full(asyncio.Protocol):
    """Hangs up."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport.close()
