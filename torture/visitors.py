"""Visitors of the web page of a struck robot, in its virtual time; no socket is between them and the server."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from txt1.bridges.services import Services
from txt1.kernel.clock import seconds
from txt1.kernel.loop import clock_of
from txt1.sidecar import Request
from txt1.web import pages, requests
from txt1.web.auth import Role
from txt1.web.budgets import Budgets

if TYPE_CHECKING:
    from torture.struck_robot import Desk


class Web:
    """The page's server, and its line to the robot's end."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        clock = clock_of(asyncio.get_running_loop())
        for module in (pages, requests):
            # in place of this process's clock
            vars(module)["now"] = lambda: seconds(clock.now_ns())
        services = Services(desk.robot, desk.robot.config, "max", Path("/nowhere"))
        self.end = desk.end("web", services.requests)
        self._pages = pages.Pages(self, Path("/nowhere"), 0.5, {}, [], invites=False)
        self._budgets = Budgets()

    def fileno(self) -> int:
        """Return no descriptor: nobody waits for telemetry."""
        return -1

    def newest(self) -> bytes | None:
        """Return no telemetry."""
        return None

    def request(self, name: str, /, **fields: object) -> None:
        """Make a request of the robot's end."""
        if name in ("drive", "go", "hold"):
            self._desk.noted()
        self.end.request(Request(name, json.loads(json.dumps(fields)), 0.0))

    def join(self, role: Role) -> pages.Page:
        """Return a new page."""
        socket: Any = None
        page = self._pages.join(role, "192.0.2.1", socket, self._budgets.account("192.0.2.1"))
        present = requests.now()  # type: ignore[attr-defined]
        page.clock.answered(present, present, present)
        return page

    def ask(self, page: pages.Page, **message: object) -> None:
        """Send a message as a page."""
        present = requests.now()  # type: ignore[attr-defined]
        requests.take(self._pages, page, json.dumps({"n": round(1e6 * present), "t": present, **message}))

    def leave(self, page: pages.Page) -> None:
        """Close a page."""
        self._pages.leave(page)
