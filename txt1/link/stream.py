"""A link over one of asyncio's transports."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from txt1.link.base import BACKLOG, BaseLink, End


class StreamLink(BaseLink, asyncio.Protocol):
    """A link over one of asyncio's transports. `explain` puts the reason of a loss into words."""

    transport: asyncio.Transport

    def __init__(self, address: str, end: End, explain: Callable[[str, Exception | None], str]) -> None:
        super().__init__(address, end)
        self._explain = explain

    def write(self, data: bytes) -> None:
        """Send, or drop when too much waits already."""
        self.require_up()
        waiting = self.transport.get_write_buffer_size()
        if waiting and waiting + len(data) > BACKLOG:
            self._overflows += 1
        else:
            self.transport.write(data)

    def close(self) -> None:
        """Let go at once."""
        if self.shut():
            self.transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Connect the end, unless nobody waits for it any more."""
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
        self.transport.abort()  # asyncio's own answer would first wait until the other side has taken our bytes
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the end why."""
        self.lose(self._explain(self._address, exc))
