"""The connected pages and the robots that they show: sends telemetry to pages, and their requests to robots.

For a slow page only the newest telemetry is kept. Topics that pages plot are sent often, other topics once a second.
"""

from __future__ import annotations

import asyncio
import json
from collections import Counter, deque
from collections.abc import Coroutine, Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any, Final, Protocol

from txt1.errors import CommandRefused
from txt1.kernel.clock import RealClock, seconds
from txt1.web.auth import Role
from txt1.web.budgets import Account
from txt1.web.player import PagePlayer, recordings, strict
from txt1.web.wheel import PageClock, PageWheel, Sequence

# s between two stops that are passed on
STOPS_PERIOD: Final = 0.01
# s between two messages to all pages about their state, and between two looks at the folder of recordings
STATUS_PERIOD: Final = 0.05
LISTINGS: Final = 0.25
# s within which a page must have taken its telemetry
SEND_TIME_OUT: Final = 10.0
# pieces of telemetry a second
PAGE_RATE: Final = 20.0
# the same for a robot that no page shows, if there are several
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
# number of a connection that is no page's first
NO_PAGE: Final = -1
# of RFC 6455, 7.4.1
POLICY_VIOLATION: Final = 1008
# sent with everything else, once a second
FULL: Final = "/capabilities"

_clock: Final = RealClock()


def now() -> float:
    """Seconds on this process's clock."""
    return seconds(_clock.now_ns())


@dataclass(eq=False)
class PageRobot:
    """A robot, as pages see it."""

    # empty for a single robot
    name: str
    wheel: PageWheel = field(default_factory=PageWheel)
    # the newest telemetry with all topics
    full: str = ""
    # requested topics, and their rate, Hz
    wanted: tuple[frozenset[str], float] | None = None


@dataclass(eq=False)
class Page:
    """A connected page."""

    number: int
    role: Role
    address: str
    socket: PageSocket
    # the robot that the page shows
    car: PageRobot
    account: Account
    clock: PageClock = field(default_factory=PageClock)
    sequence: Sequence = field(default_factory=Sequence)
    # numbers of late, dropped and malformed messages
    counts: Counter[str] = field(default_factory=Counter)
    # round trip of the last message, s
    round_trip: float | None = None
    # topics that the page plots
    chosen: frozenset[str] = frozenset()
    # whether it has to let go before it may drive: another page had the wheel
    overruled: bool = False
    # player of the recording that it shows in place of the robot
    player: PagePlayer | None = None
    # how often it has asked for a recording, or for the robot again
    replays: int = 0
    outbox: deque[str] = field(default_factory=lambda: deque(maxlen=50))
    # telemetry that waits to be sent
    newest: str | None = None
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def tell(self, **message: object) -> None:
        """Send the page a message."""
        self.outbox.append(json.dumps(message, separators=(",", ":")))
        self.news.set()

    def show(self, line: str) -> None:
        """Send the page telemetry, in place of telemetry that it has not taken yet."""
        self.newest = line
        self.news.set()


class PageSocket(Protocol):
    """The socket of a page: aiohttp's, or one that posts messages within a browser."""

    async def send_str(self, data: str) -> None:
        """Send a text. Raises ConnectionError or RuntimeError: the page has gone."""

    async def close(self, *, code: int, message: bytes) -> bool:
        """Close it, with the reason."""


class Robots(Protocol):
    """The connection to a robot or to several: a `Connection`, or a fleet on a network."""

    def fileno(self) -> int:
        """Return the descriptor that becomes readable with new telemetry."""

    def newest(self) -> bytes | None:
        """Return the newest telemetry; None: none has come. Raises EOFError or OSError: none will come any more."""

    def request(self, name: str, /, **fields: object) -> None:
        """Make a request. Raises OSError: the robot is gone; CommandRefused: the robot refuses it."""


class Pages:
    """Connects all pages with the robots.

    Args:
        robot: the connection to the robots.
        folder: folder of the recordings.
        limit: limit of visitors' speed, m/s.
        others: addresses of other robots' pages, by the robots' names.
        fleet: names of the robots behind `robot`, if there are several.
        invites: whether the operator may invite visitors.
        camera: the port of the cameras' pictures, if there are any.

    """

    def __init__(
        self,
        robot: Robots,
        folder: Path,
        limit: float,
        others: Mapping[str, str],
        fleet: list[str],
        invites: bool,
        camera: int | None = None,
    ) -> None:
        self.folder, self.limit, self.camera = folder, limit, camera
        self.cars = {name: PageRobot(name) for name in fleet or [""]}
        self.connected: dict[int, Page] = {}
        self.stop_channels: set[Page] = set()
        # set when the robot's process has gone
        self.ended = asyncio.Event()
        # held while a recording is read
        self.loading = asyncio.Lock()
        self._robot, self._others, self._fleet, self._invites = robot, dict(others), fleet, invites
        self._last = 0
        # time from which a stop is passed on at once
        self._stop_due = -inf
        # time from which all pages are told their state at once, and whether that waits
        self._news_due, self._news_waits = -inf, False
        # pages that want to know the recordings
        self._asking: set[Page] = set()
        self._looking: asyncio.Future[None] | None = None
        # pages whose stops wait until then, and the stops' numbers
        self._stops: dict[Page, object] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    # -- the pages ---------------------------------------------------------------------------------------------

    def join(self, role: Role, address: str, socket: PageSocket, account: Account) -> Page:
        """Return the new page behind a socket, which spends from an account."""
        self._last += 1
        page = Page(self._last, role, address, socket, next(iter(self.cars.values())), account)
        self.connected[page.number] = page
        self.subscribe()
        page.show(page.car.full)
        self.status(page)
        return page

    def join_stop_channel(self, address: str, socket: PageSocket, account: Account) -> Page:
        """Return a page's connection for stops. It is shown nothing but the confirmation of its stops."""
        page = Page(NO_PAGE, "stop channel", address, socket, next(iter(self.cars.values())), account)
        self.stop_channels.add(page)
        return page

    def leave(self, page: Page) -> None:
        """Forget a page that has gone, and release the robot that it drove; or forget a stop channel."""
        if page in self.stop_channels:
            self.stop_channels.remove(page)
            return
        if page.player is not None:
            page.player.stop()
        del self.connected[page.number]
        if page.car.wheel.holder == page.number:
            page.car.wheel.give(page.number)
            self.halt(page)
        self.subscribe()
        self.status_of_all()

    async def send(self, page: Page) -> None:
        """Send a page its telemetry, as fast as it takes it; a page that takes nothing is disconnected."""
        try:
            while True:
                await page.news.wait()
                page.news.clear()
                async with asyncio.timeout(SEND_TIME_OUT):
                    while page.outbox:
                        await page.socket.send_str(page.outbox.popleft())
                    line, page.newest = page.newest, None
                    if line:
                        await page.socket.send_str(line)
        except (ConnectionError, RuntimeError):
            # the page has gone
            pass
        except TimeoutError:
            self.dismiss(page, "too slow")

    def dismiss(self, page: Page, why: str) -> None:
        """Disconnect a page, and tell it why."""

        async def close() -> None:
            await page.socket.close(code=POLICY_VIOLATION, message=why.encode())

        self.later(close())

    def later(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a coroutine in the background."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def players(self, role: Role) -> int:
        """Return how many recordings are shown: to visitors for a visitor, to all for an operator."""
        return sum(each.player is not None and role in ("operator", each.role) for each in self.connected.values())

    def list_recordings(self, page: Page) -> None:
        """Tell a page which recordings there are; of many requests each look at the folder answers all."""

        async def look() -> None:
            while self._asking:
                asking, self._asking = self._asking, set()
                text = await asyncio.to_thread(lambda: json.dumps({"files": recordings(self.folder)}))
                for each in asking:
                    each.outbox.append(text)
                    each.news.set()
                await asyncio.sleep(LISTINGS)
            self._looking = None

        self._asking.add(page)
        if self._looking is None:
            self._looking = asyncio.ensure_future(look())

    def status_of_all(self) -> None:
        """Send all pages their own status: at once, and if it changes often after `STATUS_PERIOD` at most."""
        wait = self._news_due - now()
        if wait <= 0.0:
            self._news_due, self._news_waits = now() + STATUS_PERIOD, False
            self.status(*self.connected.values())
        elif not self._news_waits:
            self._news_waits = True
            asyncio.get_running_loop().call_later(wait, self.status_of_all)

    def status(self, *pages: Page) -> None:
        """Send pages their own status."""
        for page in pages:
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
                    "camera": self.camera,
                },
                ping=now(),
            )

    def limit_of(self, page: Page) -> float | None:
        """Return a page's speed limit, m/s; None if only the safety gate limits it."""
        return self.limit if page.role == "visitor" else None

    # -- the robots --------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Subscribe to the topics of all robots as if no page showed them, then to the topics that pages show."""
        wanted = frozenset(FAST), UNSEEN if self._fleet else PAGE_RATE
        for car in self.cars.values():
            car.wanted = wanted
        self.ask(None, "subscribe", topics=sorted(wanted[0]), rate=wanted[1], seldom=None)
        self.subscribe()

    def ask(self, page: Page | None, name: str, **fields: object) -> None:
        """Make a request to a page's robot, or to all robots."""
        if page is not None and self._fleet:
            fields["robot"] = page.car.name
        try:
            self._robot.request(name, **fields)
        except CommandRefused as error:
            if page is not None:
                page.tell(told=str(error))
        except OSError:
            self.ended.set()

    def stop(self, page: Page, number: object) -> None:
        """Stop all robots, and confirm it to the page by its number.

        It is passed on at once, and in a flood of stops after `STOPS_PERIOD` at most: then the flood does not fill the
        line.
        """
        wait = self._stop_due - now()
        if not self._stops and wait > 0.0:
            asyncio.get_running_loop().call_later(wait, self._stop)
        self._stops[page] = number
        if wait <= 0.0:
            self._stop()

    def _stop(self) -> None:
        if not self._stops:
            # a later stop has been passed on already
            return
        self._stop_due = now() + STOPS_PERIOD
        self.ask(None, "stop")
        asked, self._stops = self._stops, {}
        if not self.ended.is_set():
            for page, number in asked.items():
                page.tell(stop=number)

    def halt(self, page: Page) -> None:
        """Release a page's robot, and end its route: the robot stands."""
        self.ask(page, "release")
        self.ask(page, "halt")

    def subscribe(self) -> None:
        """Subscribe to the topics that pages plot, if they have changed."""
        for car in self.cars.values():
            pages = [page for page in self.connected.values() if page.car is car]
            unseen = bool(self._fleet) and not pages
            wanted = frozenset(FAST).union(*(page.chosen for page in pages)), UNSEEN if unseen else PAGE_RATE
            if wanted != car.wanted:
                car.wanted = wanted
                if unseen:
                    # a page that looks next waits for new telemetry
                    car.full = ""
                which = {"robot": car.name} if self._fleet else {}
                self.ask(None, "subscribe", topics=sorted(wanted[0]), rate=wanted[1], seldom=None, **which)

    def hear(self) -> None:
        """Receive telemetry and pass it on."""
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
                # a robot that has joined a fleet on a network
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
