"""The connected pages and the robots that they show: sends telemetry to pages, and their requests to robots.

Of a page that is too slow only the newest telemetry waits. Topics that pages plot come often, others once a second.
"""

from __future__ import annotations

import asyncio
import json
from collections import Counter, deque
from collections.abc import Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

from aiohttp import WSCloseCode, web

from txt1.errors import CommandRefused
from txt1.kernel.clock import RealClock, seconds
from txt1.web.auth import Role
from txt1.web.player import PagePlayer, strict
from txt1.web.wheel import Budget, PageClock, PageWheel, Sequence

# a second, and at once, of one page; more are dropped
MESSAGES: Final = (80.0, 160.0)
# a second, beyond the budgets, of all pages together; the rest waits in its socket
OVERRUNS: Final = 4000.0
# s in which a page must have taken what it was sent
SLOW: Final = 10.0
# telemetry a second
PAGE_RATE: Final = 20.0
# the same of a robot that no page shows, of several
UNSEEN: Final = 0.1
FAST: Final = (
    "/odom",
    "/odometry/filtered",
    "/setpoint",
    "/pose",
    "/map_pose",
    "/particles",
    "/vehicles",
    "/movers",
    "/mode",
    "/driver",
)
# is told with everything else, once a second
FULL: Final = "/capabilities"

_clock: Final = RealClock()


def now() -> float:
    """Seconds on this process's clock."""
    return seconds(_clock.now_ns())


@dataclass(eq=False)
class PageRobot:
    """One robot, as pages see it."""

    # empty where there is only one
    name: str
    wheel: PageWheel = field(default_factory=PageWheel)
    # the newest telemetry with everything in it
    full: str = ""
    # topics asked for, and how often a second
    wanted: tuple[frozenset[str], float] | None = None


@dataclass(eq=False)
class Page:
    """One page that is connected."""

    number: int
    role: Role
    address: str
    socket: web.WebSocketResponse
    # the robot that it shows
    car: PageRobot
    clock: PageClock = field(default_factory=PageClock)
    sequence: Sequence = field(default_factory=Sequence)
    budget: Budget = field(default_factory=lambda: Budget(*MESSAGES))
    # late, dropped and malformed messages
    counts: Counter[str] = field(default_factory=Counter)
    # s, of the last message there and back
    round_trip: float | None = None
    # topics that it plots
    chosen: frozenset[str] = frozenset()
    # of the recording it sees in place of the robot
    player: PagePlayer | None = None
    outbox: deque[str] = field(default_factory=lambda: deque(maxlen=50))
    # telemetry that waits to be sent
    newest: str | None = None
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
        """Make a request; OSError: the robot is gone; CommandRefused: the robot refuses it."""


class Pages:
    """All pages on one side, the robots on the other.

    Args:
        robot: the way to the robots.
        folder: of the recordings.
        limit: of visitors' speed, m/s.
        others: addresses of other robots' pages, by the robots' names.
        fleet: names of the robots behind `robot`, where there are several.
        invites: whether the operator may invite visitors.

    """

    def __init__(
        self, robot: Robots, folder: Path, limit: float, others: Mapping[str, str], fleet: list[str], invites: bool
    ) -> None:
        self.folder, self.limit = folder, limit
        self.cars = {name: PageRobot(name) for name in fleet or [""]}
        self.connected: dict[int, Page] = {}
        # the robot's process has gone
        self.ended = asyncio.Event()
        # held while a recording is read
        self.loading = asyncio.Lock()
        self._robot, self._others, self._fleet, self._invites = robot, dict(others), fleet, invites
        self._last = 0
        # when the next message beyond a budget may be read
        self._overrun = 0.0
        self._tasks: set[asyncio.Task[None]] = set()

    # -- the pages ---------------------------------------------------------------------------------------------

    def join(self, role: Role, address: str, socket: web.WebSocketResponse) -> Page:
        """Return the new page behind a socket."""
        self._last += 1
        page = Page(self._last, role, address, socket, next(iter(self.cars.values())))
        self.connected[page.number] = page
        self.subscribe()
        page.show(page.car.full)
        self.status(page)
        return page

    def leave(self, page: Page) -> None:
        """Forget a page that has gone, and let go of the robot that it drove."""
        if page.player is not None:
            page.player.stop()
        del self.connected[page.number]
        if page.car.wheel.holder == page.number:
            page.car.wheel.give(page.number)
            self.ask(page, "release")
        self.subscribe()
        self.status()

    async def send(self, page: Page) -> None:
        """Send a page its telemetry, as fast as it takes it; a page that takes nothing is disconnected."""
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
            # it has gone
            pass
        except TimeoutError:
            self.dismiss(page, "too slow")

    async def overrun(self) -> None:
        """Wait until one more message beyond its page's budget may be read; so few of them slow nobody else down."""
        self._overrun = max(self._overrun, now()) + 1.0 / OVERRUNS
        ahead = self._overrun - now()
        # a shorter sleep lasts longer than it should
        await asyncio.sleep(ahead if ahead > 0.005 else 0.0)

    def dismiss(self, page: Page, why: str) -> None:
        """Send a page away."""

        async def close() -> None:
            await page.socket.close(code=WSCloseCode.POLICY_VIOLATION, message=why.encode())

        self.later(close())

    def later(self, work: Coroutine[Any, Any, None]) -> None:
        """Run something beside the rest."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def status(self, *pages: Page) -> None:
        """Tell pages, all if none are given, about themselves."""
        for page in pages or tuple(self.connected.values()):
            page.tell(
                page={
                    "number": page.number,
                    "role": page.role,
                    "limit": self.limit_of(page),
                    "visitors": self.limit,
                    "wheel": page.car.wheel.holder,
                    "pages": len(self.connected),
                    "round_trip": page.round_trip,
                    "counts": dict(page.counts),
                    "robots": self._others,
                    "invites": page.role == "operator" and self._invites,
                    "replay": page.player and page.player.status(),
                    "fleet": self._fleet,
                    "robot": page.car.name,
                },
                ping=now(),
            )

    def limit_of(self, page: Page) -> float | None:
        """The fastest that a page may drive, m/s; None where only the safety gate limits it."""
        return self.limit if page.role == "visitor" else None

    # -- the robots --------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Ask for the topics of all robots as if no page showed one, and then for what pages show."""
        wanted = frozenset(FAST), UNSEEN if self._fleet else PAGE_RATE
        for car in self.cars.values():
            car.wanted = wanted
        self.ask(None, "subscribe", topics=sorted(wanted[0]), rate=wanted[1], seldom=None)
        self.subscribe()

    def ask(self, page: Page | None, name: str, **fields: object) -> None:
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

    def subscribe(self) -> None:
        """Ask for the topics that pages want to see often, if they are others than before."""
        for car in self.cars.values():
            pages = [page for page in self.connected.values() if page.car is car]
            unseen = bool(self._fleet) and not pages
            wanted = frozenset(FAST).union(*(page.chosen for page in pages)), UNSEEN if unseen else PAGE_RATE
            if wanted != car.wanted:
                car.wanted = wanted
                if unseen:
                    # whoever looks next waits for what is new
                    car.full = ""
                which = {"robot": car.name} if self._fleet else {}
                self.ask(None, "subscribe", topics=sorted(wanted[0]), rate=wanted[1], seldom=None, **which)

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
            self._show(self.cars[""], strict(line.decode()))
        else:
            for each in json.loads(line, parse_constant=lambda _: None):
                car = self.cars.get(each["name"])
                # one that has come to a fleet on a network
                if car is None:
                    car = self.cars[each["name"]] = PageRobot(each["name"])
                    self._fleet.append(car.name)
                self._show(car, json.dumps(each, separators=(",", ":")))

    def _show(self, car: PageRobot, text: str) -> None:
        if f'"{FULL}":' in text:
            car.full = text
        for page in self.connected.values():
            if page.car is car and page.player is None:
                page.show(text)
