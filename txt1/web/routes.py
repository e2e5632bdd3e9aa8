"""The routes of the web page: its files, signing in and out, recordings, and a socket for every page.

`ROUTES` says who may ask for each; there are no routes but these.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, Awaitable, Callable
from io import BytesIO
from typing import Final, NamedTuple

from aiohttp import WSMessage, WSMsgType, web

from txt1.kernel.clock import NS_PER_S, wall_ns
from txt1.web.auth import Auth, Role
from txt1.web.files import page_files
from txt1.web.pages import Page, Pages, now
from txt1.web.player import RECORDING_NAME
from txt1.web.requests import EVERYBODY, OPERATOR, take

PAGES_MAX: Final = 100
# s within which a connection has to send its first request
STRANGER: Final = 5.0
# bytes of a page's longest message
MESSAGE_MAX: Final = 8192
# s that a disconnected page has to close its socket; a flood is read until then
PARTING: Final = 0.02
# s between two pings of a socket; without an answer within half of it, the socket is closed
SOCKET_BEAT: Final = 4.0

HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "gamepad=(self), camera=(), microphone=(), geolocation=()",
}


def wall() -> float:
    """Return seconds since 1970, for sessions only."""
    return wall_ns() / NS_PER_S


def _limit(request: web.Request, answer: web.StreamResponse) -> None:
    """Add the headers that limit what a browser may do with an answer."""
    answer.headers.update(HEADERS)
    sockets = f"{'wss' if request.secure else 'ws'}://{request.host}"
    answer.headers["Content-Security-Policy"] = (
        f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
        f"connect-src 'self' {sockets}; manifest-src 'self'; form-action 'self'; base-uri 'none'; "
        "frame-ancestors 'none'"
    )


class Route(NamedTuple):
    """A route: who may ask for it, and which method of `Routes` answers."""

    method: str
    path: str
    who: frozenset[Role | None]
    """None is a stranger."""
    answer: Callable[[Routes, web.Request], Awaitable[web.StreamResponse]]


class Routes:
    """Answers requests of admitted pages."""

    def __init__(self, door: Auth, pages: Pages) -> None:
        self._door, self._pages = door, pages
        # connections without a request yet, and their start
        self.strangers: dict[web.RequestHandler, float] = {}

    def application(self) -> web.Application:
        """Return all routes."""
        app = web.Application(middlewares=[self._guard], client_max_size=MESSAGE_MAX)
        for route in ROUTES:
            app.router.add_route(route.method, route.path, self._admitting(route))
        return app

    def _admitting(self, route: Route) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
        """Return the handler of a route, for those alone who may ask for it."""

        async def handle(request: web.Request) -> web.StreamResponse:
            role = self._role(request)
            if role not in route.who:
                raise web.HTTPForbidden(text="sign in first\n" if role is None else "this is the operator's\n")
            return await route.answer(self, request)

        return handle

    def hang_up(self) -> None:
        """Close the connections that have been silent for too long."""
        for protocol, since in tuple(self.strangers.items()):
            if now() - since > STRANGER:
                del self.strangers[protocol]
                protocol.force_close()

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Check the host and the origin of a request; add the headers of every answer."""
        self.strangers.pop(request.protocol, None)
        try:
            if not self._door.knows_host(request.host):
                raise web.HTTPMisdirectedRequest(text="this robot is not known by that name\n")
            foreign = not self._door.knows_origin(request.headers.get("Origin"), request.host)
            if foreign and (request.method != "GET" or request.path == "/socket"):
                raise web.HTTPForbidden(text="only the robot's own page may ask for that\n")
            response = await handler(request)
        except web.HTTPException as answer:
            _limit(request, answer)
            raise
        except (TimeoutError, ConnectionError):
            # the client sends no request, or is gone before the answer
            response = web.Response(status=408)
        if not response.prepared:
            _limit(request, response)
        return response

    def _role(self, request: web.Request) -> Role | None:
        return self._door.role(request.cookies.get(self._door.cookie), wall())

    async def index(self, request: web.Request) -> web.Response:
        """Return the page, or the door for a stranger."""
        return self._answer(request, "index.html" if self._role(request) else "sign-in.html")

    async def file(self, request: web.Request) -> web.Response:
        """Return a file of the page, by its name."""
        return self._answer(request, request.match_info["name"])

    def _answer(self, request: web.Request, name: str) -> web.Response:
        file = page_files().get(name)
        if file is None:
            raise web.HTTPNotFound(text="there is no such page\n")
        headers = {"Content-Encoding": "gzip", "Cache-Control": "no-cache", "ETag": file.tag, "Content-Type": file.kind}
        if request.headers.get("If-None-Match") == file.tag:
            return web.Response(status=304, headers={"ETag": file.tag, "Cache-Control": "no-cache"})
        return web.Response(body=file.body, headers=headers)

    async def sign_in(self, request: web.Request) -> web.Response:
        """Return a cookie for the right token."""
        async with asyncio.timeout(STRANGER):
            given = (await request.post()).get("token", "")
        signed = self._door.sign_in(str(given).strip(), wall())
        if signed is None:
            if not self._door.failed(request.remote or "", now()):
                raise web.HTTPTooManyRequests(text="not the token, and too many were wrong; wait a few seconds\n")
            raise web.HTTPForbidden(text="that is not the token\n")
        response = web.Response(status=204)
        response.set_cookie(
            self._door.cookie, signed[1], httponly=True, samesite="Strict", secure=request.secure, path="/"
        )
        return response

    async def sign_out(self, request: web.Request) -> web.Response:
        """Take the cookie back."""
        response = web.Response(status=204)
        response.del_cookie(self._door.cookie, path="/")
        return response

    async def visitors(self, request: web.Request) -> web.Response:
        """Return the visitors' address as a QR code, for the operator to show."""
        token = self._door.visitors_token
        if token is None:
            raise web.HTTPForbidden(text="without a token everybody is the operator, and nobody is invited\n")
        import segno

        # with its namespace, without which a browser shows no picture
        picture = BytesIO()
        code = segno.make(f"{request.scheme}://{request.host}/#token={token}", error="m")
        code.save(picture, kind="svg", scale=4, border=2, light="white")
        return web.Response(body=picture.getvalue(), content_type="image/svg+xml")

    async def recording(self, request: web.Request) -> web.StreamResponse:
        """Return a recording, to be saved."""
        name = request.match_info["name"]
        path = self._pages.folder / name
        if not RECORDING_NAME.fullmatch(name) or path.is_symlink() or not path.is_file():
            raise web.HTTPNotFound(text="there is no such recording\n")
        return web.FileResponse(path, headers={"Content-Disposition": f'attachment; filename="{name}"'})

    async def socket(self, request: web.Request) -> web.StreamResponse:
        """Connect a page until it leaves."""
        role = self._role(request)
        assert role is not None
        if len(self._pages.connected) >= PAGES_MAX:
            raise web.HTTPServiceUnavailable(text=f"there are {PAGES_MAX} pages already\n")
        socket = web.WebSocketResponse(heartbeat=SOCKET_BEAT, max_msg_size=MESSAGE_MAX, compress=False, timeout=PARTING)
        await socket.prepare(request)
        page = self._pages.join(role, request.remote or "", socket)
        sender = asyncio.create_task(self._pages.send(page))
        try:
            await listen(self._pages, page, socket)
        finally:
            sender.cancel()
            self._pages.leave(page)
        return socket


STRANGERS: Final[frozenset[Role | None]] = frozenset({None, "visitor", "operator"})
ROUTES: Final = (
    Route("GET", "/", STRANGERS, Routes.index),
    Route("POST", "/sign-in", STRANGERS, Routes.sign_in),
    Route("POST", "/sign-out", STRANGERS, Routes.sign_out),
    Route("GET", "/socket", frozenset(EVERYBODY), Routes.socket),
    Route("GET", "/visitors.svg", frozenset(OPERATOR), Routes.visitors),
    Route("GET", "/recordings/{name}", frozenset(EVERYBODY), Routes.recording),
    Route("GET", "/{name}", STRANGERS, Routes.file),
)


async def listen(pages: Pages, page: Page, messages: AsyncIterable[WSMessage]) -> None:
    """Carry out the messages of a page until it leaves, or sends anything but text."""
    async for message in messages:
        if message.type is not WSMsgType.TEXT:
            break
        if not take(pages, page, message.data):
            # otherwise a flood would be read in one go, and a stop of another page would wait
            await pages.overrun()
