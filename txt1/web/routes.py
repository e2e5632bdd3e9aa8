"""The routes of the web page: its files, signing in and out, recordings, and the sockets of every page.

`ROUTES` says who may ask for each; there are no routes but these.
"""

from __future__ import annotations

import asyncio
from io import BytesIO
from typing import Final
from urllib.parse import parse_qs

from aiohttp import WSMsgType, web

from txt1.web.admission import MESSAGE_MAX, SOCKET_BEAT, SOCKET_CLOSE_TIME, STRANGERS, Admission, Route, wall
from txt1.web.auth import Auth, Role
from txt1.web.budgets import FRAME_COST, PING_COST, SIGN_IN
from txt1.web.connections import STRANGER, Metered
from txt1.web.files import page_files
from txt1.web.pages import Page, Pages, now
from txt1.web.player import RECORDING_NAME
from txt1.web.requests import EVERYBODY, OPERATOR, take

PAGES_MAX: Final = 100
# pages of these that are kept for operators
OPERATORS: Final = 20
# messages of a page beyond its budget that are searched for a stop in one turn
SEARCHED: Final = 32


class Routes(Admission):
    """Answers requests of admitted pages."""

    def __init__(self, door: Auth, pages: Pages) -> None:
        super().__init__(door, camera=pages.camera)
        self._pages = pages

    async def index(self, request: web.Request) -> web.Response:
        """Return the page, or the door for a stranger."""
        return self._answer(request, "index.html" if self.role(request) else "sign-in.html")

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
        self.pay(request, SIGN_IN)
        try:
            async with asyncio.timeout(STRANGER):
                body = await request.read()
            given = parse_qs(body.decode("latin-1"), max_num_fields=8).get("token", [""])[0]
        except (ValueError, web.RequestPayloadError):
            raise web.HTTPBadRequest(text="that is no form\n") from None
        signed = self._door.sign_in(given.strip(), wall())
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
        role = self.role(request)
        assert role is not None
        socket, metered = await self._connected(request, role, len(self._pages.connected))
        return await self._until_it_leaves(
            self._pages.join(role, request.remote or "", socket, metered.account), socket
        )

    async def stop_channel(self, request: web.Request) -> web.StreamResponse:
        """Open a page's connection for stops, which may do nothing else, until it leaves.

        A packet that is lost holds up all that follows it on its connection: a page sends its stops on all that it has.
        """
        role = self.role(request)
        assert role is not None
        socket, metered = await self._connected(request, role, len(self._pages.stop_channels))
        return await self._until_it_leaves(
            self._pages.join_stop_channel(request.remote or "", socket, metered.account), socket
        )

    async def _connected(self, request: web.Request, role: Role, there: int) -> tuple[web.WebSocketResponse, Metered]:
        """Return the socket of a page, and what pays for it, if there are not too many `there`."""
        room = PAGES_MAX if role == "operator" else PAGES_MAX - OPERATORS
        if there >= room:
            raise web.HTTPServiceUnavailable(text=f"there are {room} pages already\n")
        metered = self.pay(request, 0.0)
        # pings are answered by `listen`, when they are paid
        socket = web.WebSocketResponse(
            heartbeat=SOCKET_BEAT, max_msg_size=MESSAGE_MAX, compress=False, timeout=SOCKET_CLOSE_TIME, autoping=False
        )
        await socket.prepare(request)
        metered.page = True
        return socket, metered

    async def _until_it_leaves(self, page: Page, socket: web.WebSocketResponse) -> web.WebSocketResponse:
        sender = asyncio.create_task(self._pages.send(page))
        try:
            await listen(self._pages, page, socket)
        finally:
            sender.cancel()
            self._pages.leave(page)
        return socket


ROUTES: Final = (
    Route("GET", "/", STRANGERS, Routes.index),
    Route("POST", "/sign-in", STRANGERS, Routes.sign_in),
    Route("POST", "/sign-out", STRANGERS, Routes.sign_out),
    Route("GET", "/socket", frozenset(EVERYBODY), Routes.socket),
    Route("GET", "/stop", frozenset(EVERYBODY), Routes.stop_channel),
    Route("GET", "/visitors.svg", frozenset(OPERATOR), Routes.visitors),
    Route("GET", "/recordings/{name}", frozenset(EVERYBODY), Routes.recording),
    Route("GET", "/{name}", STRANGERS, Routes.file),
)


async def listen(pages: Pages, page: Page, socket: web.WebSocketResponse) -> None:
    """Carry out the messages of a page until it leaves, or sends anything but text, pings and pongs.

    One message in each turn of the event loop, so that another page's stop waits for one message of each page at most.
    """
    behind = 0
    async for message in socket:
        if message.type is WSMsgType.TEXT:
            take(pages, page, message.data)
        elif message.type is WSMsgType.PING:
            if page.account.spend(now(), PING_COST):
                await socket.pong(message.data)
        elif message.type is WSMsgType.PONG:
            page.account.spend(now(), FRAME_COST)
        else:
            break
        # the search for a stop behind a flood costs little
        behind = (behind + 1) % SEARCHED if page.account.exceeded else 0
        if behind == 0:
            await asyncio.sleep(0)
