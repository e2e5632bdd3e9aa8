"""The server of the cameras' pictures, beside the page's: a process of its own, so that no picture delays a stop.

How it works
------------

The robot sends pictures only while somebody looks, and of each camera only the newest. A viewer is a socket of the page
for one camera. It gets the newest picture, and the next one only after it has said that it has seen this one: so one
picture of a viewer is under way at most, on the network as well, and all that come meanwhile are dropped. There are
`VIEWERS` viewers at most. A viewer that does not answer is sent away after `VIEWER_TIME_OUT` s. If a picture took
longer than the quickest, the network was busy, and the next one waits for as long: so pictures never fill a weak
network.

A message is `HEAD` and a JPEG. The head's numbers are s of this process's clock: the picture's exposure, the time of
sending, and the shortest time from sending a picture to the answer. From these the page computes the picture's age.

The door is the page's: the same cookie, roles and budgets. Only the page of the same robot may look.
"""

from __future__ import annotations

import asyncio
import json
import struct
from base64 import b64decode
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple, Protocol

from aiohttp import WSMsgType, web

from txt1.sidecar import BEAT, TELEMETRY_PERIOD, Connection
from txt1.web.admission import SOCKET_BEAT, SOCKET_CLOSE_TIME, STRANGERS, Admission, Route
from txt1.web.auth import Auth, Role
from txt1.web.budgets import FRAME_COST, PING_COST, Account
from txt1.web.pages import now
from txt1.web.requests import EVERYBODY
from txt1.web.server import admitting, listening
from txt1.web.troubles import counting

# viewers at once, and those of them who may be visitors
VIEWERS: Final = 4
VISITORS: Final = 3
# s within which a viewer must have seen a picture
VIEWER_TIME_OUT: Final = 10.0
# the answer of a viewer, and the bytes of its longest message
SEEN: Final = "seen"
VIEWER_MESSAGE_MAX: Final = 64
# exposure, sending, shortest answer: s
HEAD: Final = struct.Struct("<3d")


class Picture(NamedTuple):
    """A picture of a camera."""

    exposed: float
    """s of this process's clock."""
    jpeg: bytes


class Eyes(Protocol):
    """The connection to the robot."""

    def fileno(self) -> int:
        """Return the descriptor that becomes readable with new telemetry."""

    def newest(self) -> bytes | None:
        """Return the newest telemetry; None: none has come. Raises EOFError or OSError: none will come any more."""

    def request(self, name: str, /, **fields: object) -> None:
        """Make a request. Raises OSError: the robot is gone."""


@dataclass(eq=False)
class CameraViewer:
    """A page that looks at a camera."""

    camera: str
    role: Role
    account: Account
    socket: web.WebSocketResponse
    # the picture that waits for it, in place of any before
    newest: Picture | None = None
    news: asyncio.Event = field(default_factory=asyncio.Event)
    seen: asyncio.Event = field(default_factory=asyncio.Event)
    # s, the shortest time from sending a picture to the answer
    round_trip: float = inf

    def show(self, picture: Picture) -> None:
        """Send it a picture, when it has seen the one before."""
        self.newest = picture
        self.news.set()


class CameraViewers:
    """All viewers, and the pictures of the robot."""

    def __init__(self, robot: Eyes, cameras: list[str]) -> None:
        self.cameras = cameras
        self.looking: set[CameraViewer] = set()
        # set when the robot's process has gone
        self.ended = asyncio.Event()
        self._robot = robot
        self._asked: list[str] = []

    def has_room(self, role: Role) -> bool:
        """Return whether one viewer more may look."""
        visitors = sum(each.role == "visitor" for each in self.looking)
        return len(self.looking) < VIEWERS and (role == "operator" or visitors < VISITORS)

    def join(self, viewer: CameraViewer) -> None:
        """Take a viewer."""
        self.looking.add(viewer)
        self._subscribe()

    def leave(self, viewer: CameraViewer) -> None:
        """Forget a viewer."""
        self.looking.discard(viewer)
        self._subscribe()

    def ask(self, name: str, **fields: object) -> None:
        """Make a request to the robot; an empty name is the heartbeat."""
        try:
            self._robot.request(name, **fields)
        except OSError:
            self.ended.set()

    def begin(self) -> None:
        """Ask for nothing at first."""
        self.ask("subscribe", topics=[], rate=1.0)

    def _subscribe(self) -> None:
        wanted = sorted({each.camera for each in self.looking})
        if wanted != self._asked:
            self._asked = wanted
            topics = [f"/sensors/{name}" for name in wanted]
            self.ask("subscribe", topics=topics, rate=1.0 / TELEMETRY_PERIOD if wanted else 1.0)

    def hear(self) -> None:
        """Receive telemetry, ask for the next, and pass pictures on."""
        try:
            line = self._robot.newest()
        except (EOFError, OSError):
            self.ended.set()
            return
        if line is None:
            return
        # the heartbeat says that it was received: the next line may come
        self.ask("")
        for event in json.loads(line).get("events", ()):
            camera = event["topic"].removeprefix("/sensors/")
            picture = Picture(event["exposed"], b64decode(event["value"]["data"]))
            for viewer in self.looking:
                if viewer.camera == camera:
                    viewer.show(picture)


async def send(viewer: CameraViewer) -> None:
    """Send a viewer the newest picture, and the next when it has seen this one; a viewer that does not is sent away."""
    with suppress(ConnectionError, RuntimeError, TimeoutError):
        while True:
            await viewer.news.wait()
            viewer.news.clear()
            picture, viewer.newest = viewer.newest, None
            assert picture is not None
            viewer.seen.clear()
            sent = now()
            async with asyncio.timeout(VIEWER_TIME_OUT):
                await viewer.socket.send_bytes(HEAD.pack(picture.exposed, sent, viewer.round_trip) + picture.jpeg)
                await viewer.seen.wait()
            trip = now() - sent
            viewer.round_trip = min(viewer.round_trip, trip)
            # a network that made it wait is left to others for as long: a stop's confirmation is among them
            await asyncio.sleep(trip - viewer.round_trip)
    await viewer.socket.close()


async def listen(viewer: CameraViewer) -> None:
    """Take a viewer's answers until it leaves, or sends anything else."""
    async for message in viewer.socket:
        if message.type is WSMsgType.TEXT and message.data == SEEN:
            viewer.account.spend(now(), FRAME_COST)
            viewer.seen.set()
        elif message.type is WSMsgType.PING:
            if viewer.account.spend(now(), PING_COST):
                await viewer.socket.pong(message.data)
        elif message.type is WSMsgType.PONG:
            viewer.account.spend(now(), FRAME_COST)
        else:
            break
        await asyncio.sleep(0)


class CameraRoutes(Admission):
    """Answers requests for pictures."""

    def __init__(self, door: Auth, page: int, viewers: CameraViewers) -> None:
        super().__init__(door, page)
        self._viewers = viewers

    async def trust(self, request: web.Request) -> web.Response:
        """Say that this address is trusted now: a browser asks so for each port with a certificate of its own."""
        return web.Response(text="These are the cameras of the robot. Close this tab, and go back to its page.\n")

    async def look(self, request: web.Request) -> web.StreamResponse:
        """Connect a viewer until it leaves."""
        role, name = self.role(request), request.match_info["name"]
        assert role is not None
        if name not in self._viewers.cameras:
            raise web.HTTPNotFound(text="there is no such camera\n")
        if not self._viewers.has_room(role):
            raise web.HTTPServiceUnavailable(text=f"{len(self._viewers.looking)} pages look already\n")
        metered = self.pay(request, 0.0)
        socket = web.WebSocketResponse(
            heartbeat=SOCKET_BEAT,
            max_msg_size=VIEWER_MESSAGE_MAX,
            compress=False,
            timeout=SOCKET_CLOSE_TIME,
            autoping=False,
        )
        viewer = CameraViewer(name, role, metered.account, socket)
        # before it waits, so that no more than there is room for come in
        self._viewers.join(viewer)
        sender = None
        try:
            await socket.prepare(request)
            sender = asyncio.create_task(send(viewer))
            await listen(viewer)
        finally:
            if sender is not None:
                sender.cancel()
            self._viewers.leave(viewer)
        return socket


ROUTES: Final = (
    Route("GET", "/", STRANGERS, CameraRoutes.trust),
    Route("GET", "/camera/{name}", frozenset(EVERYBODY), CameraRoutes.look),
)


def main(
    robot: Connection,
    host: str,
    port: int,
    page: int,
    cameras: list[str],
    token: str | None = None,
    certificate: str | None = None,
    key: str | None = None,
) -> None:
    """Serve the pictures of cameras until the robot's process ends.

    `page` is the port of the robot's page, whose `token`, `certificate` and `key` are files.
    """
    asyncio.run(serve(robot, host, port, page, cameras, token, certificate, key))


async def serve(
    robot: Eyes,
    host: str,
    port: int,
    page: int,
    cameras: list[str],
    token: str | None,
    certificate: str | None,
    key: str | None,
) -> None:
    """Serve the pictures in an event loop; the arguments are those of `main`."""
    door, context = admitting(page, token, certificate, key)
    viewers = CameraViewers(robot, cameras)
    loop = asyncio.get_running_loop()
    async with listening(CameraRoutes(door, page, viewers).application(ROUTES), host, port, context) as connections:
        viewers.begin()
        loop.add_reader(robot.fileno(), viewers.hear)
        try:
            with counting(lambda text: viewers.ask("tell", text=text)):
                while not viewers.ended.is_set():
                    viewers.ask("")
                    connections.hang_up()
                    await asyncio.sleep(BEAT)
        finally:
            loop.remove_reader(robot.fileno())
