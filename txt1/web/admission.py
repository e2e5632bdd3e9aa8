"""Admits requests to a server of the page: each is paid, its host and origin are checked, and a table says who may.

The page's server and the camera's have a table each (`Route`), and the same door.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Final, NamedTuple

from aiohttp import web

from txt1.kernel.clock import NS_PER_S, wall_ns
from txt1.web.auth import Auth, Role
from txt1.web.budgets import REQUEST
from txt1.web.connections import Metered
from txt1.web.pages import now

# bytes of a message
MESSAGE_MAX: Final = 8192
# s that a disconnected page has to close its socket
SOCKET_CLOSE_TIME: Final = 0.02
# s between two pings of a socket; without an answer within half of it, the socket is closed
SOCKET_BEAT: Final = 4.0
# requests that open a socket: another site's page may not make them
SOCKETS: Final = ("/socket", "/stop", "/camera/")

HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "gamepad=(self), camera=(), microphone=(), geolocation=()",
}
# ports that an address leaves out
USUAL: Final = {"http": 80, "https": 443}

STRANGERS: Final[frozenset[Role | None]] = frozenset({None, "visitor", "operator"})


def wall() -> float:
    """Return seconds since 1970, for sessions only."""
    return wall_ns() / NS_PER_S


def at_port(host: str, port: int, scheme: str) -> str:
    """Return a request's host with another port, as a browser writes it."""
    name = re.sub(r":\d+$", "", host)
    return name if USUAL[scheme] == port else f"{name}:{port}"


class Route(NamedTuple):
    """A route: who may ask for it, and which method answers."""

    method: str
    path: str
    who: frozenset[Role | None]
    """None is a stranger."""
    answer: Callable[[Any, web.Request], Awaitable[web.StreamResponse]]


class Admission:
    """The door of a server.

    `page` is the port of the page whose requests it answers, if that is another server's; `camera` is the port to which
    its page may connect for pictures.
    """

    def __init__(self, door: Auth, page: int | None = None, camera: int | None = None) -> None:
        self._door, self._page, self._camera = door, page, camera

    def application(self, routes: Sequence[Route]) -> web.Application:
        """Return the application of a table."""
        app = web.Application(middlewares=[self._guard], client_max_size=MESSAGE_MAX)
        for route in routes:
            app.router.add_route(route.method, route.path, self._admitting(route))
        return app

    def role(self, request: web.Request) -> Role | None:
        """Return who asks; None for a stranger."""
        return self._door.role(request.cookies.get(self._door.cookie), wall())

    def pay(self, request: web.Request, cost: float = REQUEST) -> Metered:
        """Have a request's connection pay, and return it; raises ConnectionError: it cannot, and is closed."""
        metered = None if request.transport is None else request.transport.get_protocol()
        if not isinstance(metered, Metered):
            raise ConnectionResetError
        metered.asked = True
        if self.role(request) == "operator":
            metered.account.operator = metered.account.address.operator = True
        if not metered.account.spend(now(), cost):
            raise ConnectionResetError
        return metered

    def _admitting(self, route: Route) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
        """Return the handler of a route, for those alone who may ask for it."""

        async def handle(request: web.Request) -> web.StreamResponse:
            role = self.role(request)
            if role not in route.who:
                raise web.HTTPForbidden(text="sign in first\n" if role is None else "this is the operator's\n")
            return await route.answer(self, request)

        return handle

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Have a request paid, check its host and origin, and add the headers of every answer."""
        if len(request.headers.getall("Host", ())) != 1:
            # aiohttp would ask a name server for the name of this computer
            return web.Response(status=400, text="which host? give its name once\n")
        try:
            self.pay(request)
            if not self._door.knows_host(request.host):
                raise web.HTTPMisdirectedRequest(text="this robot is not known by that name\n")
            host = request.host if self._page is None else at_port(request.host, self._page, request.scheme)
            foreign = not self._door.knows_origin(request.headers.get("Origin"), host)
            if foreign and (request.method != "GET" or request.path.startswith(SOCKETS)):
                raise web.HTTPForbidden(text="only the robot's own page may ask for that\n")
            response = await handler(request)
        except web.HTTPException as answer:
            self.limit(request, answer)
            raise
        except (TimeoutError, ConnectionError):
            # the client sends no request, or is gone before the answer
            response = web.Response(status=408)
        if not response.prepared:
            self.limit(request, response)
        return response

    def limit(self, request: web.Request, answer: web.StreamResponse) -> None:
        """Add the headers that limit what a browser may do with an answer."""
        answer.headers.update(HEADERS)
        scheme = "wss" if request.secure else "ws"
        sockets = f"{scheme}://{request.host}"
        if self._camera is not None:
            sockets += f" {scheme}://{at_port(request.host, self._camera, request.scheme)}"
        answer.headers["Content-Security-Policy"] = (
            f"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
            f"connect-src 'self' {sockets}; manifest-src 'self'; form-action 'self'; base-uri 'none'; "
            "frame-ancestors 'none'"
        )
