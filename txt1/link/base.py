"""The two faces of a byte link: `Link`, which is written to, and `End`, which is told what happens.

`device.open_link` leads a host to a board, `pty.listen_pty` and `tcp.listen_tcp` lead hosts to the virtual board,
`connect` joins two ends in memory. `impairments` puts a baud rate and a bad line between an end and any of these.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final, Protocol

from txt1.errors import LinkLost

# bytes that may wait for the other side to take them
BACKLOG: Final = 4096


class Link:
    """One end of a byte link; each kind says how it sends, and how it lets go.

    `address` is where it leads, for people: "/dev/ttyUSB0", "socket://127.0.0.1:5000", "memory", "./txt1-board".
    `overflows` counts writes dropped, or cut short, because the other side did not take the bytes.
    """

    overflows = 0

    def __init__(self, address: str, end: End) -> None:
        self.address = address
        # called when it is closed without asking the end
        self.on_shut: Callable[[], object] = lambda: None
        self._end = end
        # the reason, once it is
        self._down = ""

    @property
    def up(self) -> bool:
        """Whether it is neither lost nor closed."""
        return not self._down

    def write(self, data: bytes) -> None:
        """Send these bytes; never waits. Raises LinkLost when the link is lost or closed.

        When more than BACKLOG bytes wait because the other side does not take them, this write is dropped whole and
        counted, as a UART would.
        """
        if self._down:
            raise LinkLost(f"nothing was sent: {self._down}")
        self._send(data)

    def close(self) -> None:
        """Let go at once: bytes that are not sent are thrown away, and the end hears nothing any more; harmless when
        down."""
        if self.shut():
            self._let_go()

    def lose(self, reason: str) -> None:
        """Tell the end, unless the link is down already."""
        if self.up:
            self._down = reason
            self._end.lost(reason)

    def shut(self) -> bool:
        """True the first time: from now on the end hears nothing."""
        if self._down:
            return False
        self._down = f"the link {self.address} was closed"
        self.on_shut()
        return True

    def _send(self, data: bytes) -> None:
        raise NotImplementedError

    def _let_go(self) -> None:
        raise NotImplementedError


class End(Protocol):
    """The user of a link; called by the event loop."""

    def connected(self, link: Link) -> None:
        """Take the link, which is up."""

    def received(self, data: bytes) -> None:
        """Take bytes, in the order they were sent and cut up as they arrived."""

    def lost(self, reason: str) -> None:
        """The link is down and its `close` was not called; once, with a sentence for people that names the link."""


class Listener(Protocol):
    """A place where hosts connect to an end."""

    @property
    def address(self) -> str:
        """Where, as `open_link` takes it."""

    def close(self) -> None:
        """Let go of it, and of the host that is connected, at once; the end hears nothing any more."""


class Port(Protocol):
    """Where the other side of a link is found, such as a board."""

    @property
    def address(self) -> str:
        """For people."""

    async def open(self, end: End) -> Link:
        """A link to it, up; raises HalError, which says what to do. Another error ends the run."""

    async def close(self) -> None:
        """Free all that the link needed."""


class StreamLink(Link, asyncio.Protocol):
    """A link over one of asyncio's transports; `explain` puts the loss of an address into words."""

    transport: asyncio.Transport

    def __init__(self, address: str, end: End, explain: Callable[[str, Exception | None], str]) -> None:
        super().__init__(address, end)
        self._explain = explain

    def _send(self, data: bytes) -> None:
        waiting = self.transport.get_write_buffer_size()
        if waiting and waiting + len(data) > BACKLOG:
            self.overflows += 1
        else:
            self.transport.write(data)

    def _let_go(self) -> None:
        self.transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Connect the end, unless the wait for it was cancelled."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        if self.up:
            self._end.connected(self)

    def data_received(self, data: bytes) -> None:
        """Hand bytes on to the end."""
        if self.up:
            self._end.received(data)

    def eof_received(self) -> bool:
        """True, so that asyncio leaves it to us: a peer that sends no more is gone."""
        # asyncio's own answer would first wait until the other side has taken our bytes
        self.transport.abort()
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the end why."""
        self.lose(self._explain(self.address, exc))


class _MemoryLink(Link):
    """One end of a pair; delivery is the loop's next business, so it takes no virtual time."""

    peer: _MemoryLink

    def _send(self, data: bytes) -> None:
        asyncio.get_running_loop().call_soon(self.peer.arrive, data)

    def _let_go(self) -> None:
        asyncio.get_running_loop().call_soon(self.peer.lose, "the other end of the link in memory was closed")

    def arrive(self, data: bytes) -> None:
        if self.up:
            self._end.received(data)


def connect(one: End, other: End) -> tuple[Link, Link]:
    """The two ends of a link in memory, the first for `one`; both are connected when this returns."""
    first, second = _MemoryLink("memory", one), _MemoryLink("memory", other)
    first.peer, second.peer = second, first
    one.connected(first)
    other.connected(second)
    return first, second
