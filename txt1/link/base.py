"""The two sides of a byte link's interface: the user writes to a `Link`, and the link calls an `End`.

A host opens a link to a board with `device.open_link`. The virtual board waits for hosts with `pty.listen_pty` and
`tcp.listen_tcp`. `connect` joins two ends in memory. `impairments` puts a baud rate and a bad line between an end and
any link.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final, Protocol

from txt1.errors import LinkLost

# bytes that may wait for the other side to take them
BYTES_WAITING_MAX: Final = 4096


class Link:
    """One end of a byte link. Each kind of link defines how it sends and how it closes.

    `address` names the other side, for people: "/dev/ttyUSB0", "socket://127.0.0.1:5000", "memory", "./txt1-board".
    `overflows` counts writes dropped, or cut short, because the other side did not take the bytes.
    """

    overflows = 0

    def __init__(self, address: str, end: End) -> None:
        self.address = address
        # called when the link is closed without notice to the end
        self.on_shut: Callable[[], object] = lambda: None
        self._end = end
        # why the link is down, once it is down
        self._down = ""

    @property
    def up(self) -> bool:
        """Whether the link is neither lost nor closed."""
        return not self._down

    def write(self, data: bytes) -> None:
        """Send these bytes; never waits. Raises LinkLost when the link is lost or closed.

        When more than BYTES_WAITING_MAX bytes already wait for the other side, the write is dropped whole and counted,
        as on a UART.
        """
        if self._down:
            raise LinkLost(f"nothing was sent: {self._down}")
        self._send(data)

    def close(self) -> None:
        """Close at once: unsent bytes are discarded, and the end is not called again.

        Harmless when the link is down.
        """
        if self.shut():
            self._let_go()

    def lose(self, reason: str) -> None:
        """Tell the end that the link is lost, unless the link is down already."""
        if self.up:
            self._down = reason
            self._end.lost(reason)

    def shut(self) -> bool:
        """Return True the first time; from then on the end is not called."""
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
        """Take bytes, in the order they were sent; the pieces are arbitrary."""

    def lost(self, reason: str) -> None:
        """Take the loss of the link: called once, unless `close` was called.

        `reason` is a sentence that names the link.
        """


class Listener(Protocol):
    """A place to which hosts connect."""

    @property
    def address(self) -> str:
        """The address for `open_link`."""

    def close(self) -> None:
        """Release the place, and the connected host, at once; the end is not called again."""


class Port(Protocol):
    """The other side of a link, such as a board."""

    @property
    def address(self) -> str:
        """The address, for people."""

    async def open(self, end: End) -> Link:
        """Open a link to it. Raises HalError, with the remedy; any other error ends the run."""

    async def close(self) -> None:
        """Release everything that the link needed."""


class StreamLink(Link, asyncio.Protocol):
    """A link over an asyncio transport. `explain` turns an address and an error into a sentence about the loss."""

    transport: asyncio.Transport

    def __init__(self, address: str, end: End, explain: Callable[[str, Exception | None], str]) -> None:
        super().__init__(address, end)
        self._explain = explain

    def _send(self, data: bytes) -> None:
        waiting = self.transport.get_write_buffer_size()
        if waiting and waiting + len(data) > BYTES_WAITING_MAX:
            self.overflows += 1
        else:
            self.transport.write(data)

    def _let_go(self) -> None:
        self.transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Connect the end, unless the wait for the connection was cancelled."""
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        if self.up:
            self._end.connected(self)

    def data_received(self, data: bytes) -> None:
        """Hand bytes on to the end."""
        if self.up:
            self._end.received(data)

    def eof_received(self) -> bool:
        """Return True, so that asyncio leaves the closing to this class: a peer that sends no more is gone."""
        # asyncio itself would first wait until the other side has taken all bytes
        self.transport.abort()
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the end the reason."""
        self.lose(self._explain(self.address, exc))


class _MemoryLink(Link):
    """One end of a pair. Bytes are delivered in the next turn of the loop, in no virtual time."""

    peer: _MemoryLink

    def _send(self, data: bytes) -> None:
        asyncio.get_running_loop().call_soon(self.peer.arrive, data)

    def _let_go(self) -> None:
        asyncio.get_running_loop().call_soon(self.peer.lose, "the other end of the link in memory was closed")

    def arrive(self, data: bytes) -> None:
        if self.up:
            self._end.received(data)


def connect(one: End, other: End) -> tuple[Link, Link]:
    """Return the two ends of a link in memory, the first for `one`; both are connected on return."""
    first, second = _MemoryLink("memory", one), _MemoryLink("memory", other)
    first.peer, second.peer = second, first
    one.connected(first)
    other.connected(second)
    return first, second
