"""The server of the web page: sends telemetry to pages, and requests of pages to the robot.

Every page has a socket. Messages, requests and connections cost a budget (`budgets`, `connections`).
"""

from __future__ import annotations

import asyncio
import os
import ssl
import sys
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from aiohttp import web

from txt1.sidecar import BEAT, Connection
from txt1.web.auth import Auth, token_in
from txt1.web.connections import Connections
from txt1.web.pages import Pages, Robots, now
from txt1.web.routes import ROUTES, Routes
from txt1.web.troubles import counting

# s between two messages about a page's own state
STATUS: Final = 1.0


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
    camera: int | None = None,
) -> None:
    """Serve the page until the robot's process ends.

    `token`, `certificate` and `key` are files. `robots` has the addresses of other robots' pages. `fleet` has the names
    of this process's robots, if there are several. `camera` is the port of the cameras' pictures, if there are any.
    """
    others, names = robots or {}, fleet or []
    asyncio.run(serve(robot, host, port, token, certificate, key, Path(folder), speed, others, names, camera))


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
    camera: int | None = None,
) -> None:
    """Serve the page in an event loop, with any connection to the robots; the other arguments are those of `main`."""
    door, context = admitting(port, token, certificate, key)
    pages = Pages(robot, folder, speed, robots, fleet, invites=door.visitors_token is not None, camera=camera)
    loop = asyncio.get_running_loop()
    async with listening(Routes(door, pages).application(ROUTES), host, port, context) as connections:
        beating = asyncio.create_task(_beat(pages, connections))
        loop.add_reader(robot.fileno(), pages.hear)
        try:
            with counting(lambda text: pages.ask(None, "tell", text=text)):
                await pages.ended.wait()
        finally:
            loop.remove_reader(robot.fileno())
            beating.cancel()


def admitting(
    port: int, token: str | None, certificate: str | None, key: str | None
) -> tuple[Auth, ssl.SSLContext | None]:
    """Return who is admitted to the page at a port, by the files of token, certificate and key, and the context."""
    context = None
    if certificate is not None:
        # cryptography takes a while to load
        from txt1.web.certificate import tls

        context = tls(Path(certificate), None if key is None else Path(key))
    return Auth(None if token is None else token_in(Path(token)), "http" if context is None else "https", port), context


@asynccontextmanager
async def listening(
    application: web.Application, host: str, port: int, context: ssl.SSLContext | None
) -> AsyncIterator[Connections]:
    """Serve an application until the block is left; ends the process if nothing can listen there."""
    # a packed form could unpack to a large one
    runner = web.AppRunner(
        application,
        access_log=None,
        keepalive_timeout=15.0,
        shutdown_timeout=0.5,
        lingering_time=1.0,
        auto_decompress=False,
    )
    await runner.setup()
    assert runner.server is not None
    connections = Connections(runner.server, context, now)
    try:
        try:
            await connections.listen(host, port)
        except OSError as error:
            # another program has taken the port since it was found to be free
            why = os.strerror(error.errno) if error.errno else error
            sys.exit(f"txt1: --web {host}:{port}: cannot listen there: {why}; choose another address")
        yield connections
    finally:
        connections.close()
        await runner.cleanup()


async def _beat(pages: Pages, connections: Connections) -> None:
    """Send the robot its heartbeat, and pages their own state."""
    pages.begin()
    due = now()
    while True:
        pages.ask(None, "")
        if now() >= due:
            due = now() + STATUS
            pages.status_of_all()
            connections.hang_up()
        await asyncio.sleep(BEAT)
