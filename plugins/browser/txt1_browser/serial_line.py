"""The line to a board at the browser's serial port, which the guard owns (static/guard.js).

How it works. Bytes go to the guard as messages, and the guard writes them. Nothing that a browser does to this worker
may leave the car driving: so `beat` tells the guard in each cycle that the robot runs, and when no beat has come for
0.1 s the guard writes the zeros that it was given. A stop that the guard was told (a hidden page, a lost focus) comes
back by `heard`; until `obeyed` the guard writes none of this worker's bytes.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from txt1.config import Config
from txt1.errors import HalError
from txt1.hal.serial import SerialHal
from txt1.link.base import End, Link
from txt1.protocol.layout import encode
from txt1.protocol.messages import Velocity

ADDRESS: Final = "the browser's serial port"
OPENING: Final = 10.0
"""s that opening may take."""
CAREFUL: Final = 0.5
"""m/s: a board as of 2011 drives on for up to 1.9 s when its page is frozen, and nobody knows which board it is."""

Send = Callable[[str, str], None]
"""Sends the guard a kind of message, and bytes as latin-1."""


class _GuardLink(Link):
    """The link through the guard."""

    def __init__(self, end: End, send: Send) -> None:
        super().__init__(ADDRESS, end)
        self._told = send

    def _send(self, data: bytes) -> None:
        self._told("write", data.decode("latin-1"))

    def _let_go(self) -> None:
        self._told("close", "")

    def take(self, data: bytes) -> None:
        """Hand bytes on to the end."""
        if self.up:
            self._end.received(data)


class GuardedPort:
    """The port that the guard owns; `send` is the way to it, and what it says comes by `heard`."""

    address = ADDRESS

    def __init__(self, send: Send) -> None:
        self._send = send
        self._link: _GuardLink | None = None
        self._opening: asyncio.Future[str] | None = None
        self.on_stop: Callable[[], None] = lambda: None
        """Called for a stop that the guard was told."""

    async def open(self, end: End) -> Link:
        """Open the port; raises HalError."""
        self._opening = asyncio.get_running_loop().create_future()
        self._send("open", encode(Velocity(0.0, 0.0)).decode("latin-1"))
        try:
            why = await asyncio.wait_for(self._opening, OPENING)
        except TimeoutError:
            why = f"it did not open within {OPENING:g} s"
        finally:
            self._opening = None
        if why:
            raise HalError(f"{ADDRESS}: {why}")
        self._link = _GuardLink(end, self._send)
        end.connected(self._link)
        return self._link

    async def close(self) -> None:
        """Release the port."""
        self._send("close", "")

    def beat(self) -> None:
        """Tell the guard that the robot runs."""
        self._send("beat", "")

    def heard(self, what: str, text: str) -> None:
        """Take a message of the guard: "opened", "refused" or "lost" with the reason, "read" with bytes, "stop"."""
        if what == "read" and self._link is not None:
            self._link.take(text.encode("latin-1"))
        elif what in ("opened", "refused") and self._opening is not None and not self._opening.done():
            self._opening.set_result(text)
        elif what == "lost" and self._link is not None:
            self._link.lose(f"{ADDRESS}: {text}")
        elif what == "stop":
            self.on_stop()
            self._send("obeyed", text)


def board(config: Config, port: GuardedPort) -> SerialHal:
    """Return the board behind the guard."""
    return SerialHal(port, control=config.serial.control, scale=config.odometry.scale)
