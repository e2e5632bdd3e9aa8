"""A link over one of asyncio's transports."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from txt1.link.base import BACKLOG, End, Link

Explain = Callable[[str, Exception | None], str]
"""Puts the loss of an address into words."""


class StreamLink(Link, asyncio.Protocol):
    """A link over one of asyncio's transports."""

    transport: asyncio.Transport

    def __init__(self, address: str, end: End, explain: Explain) -> None:
        super().__init__(address, end)
        self._explain = explain

    def _send(self, data: bytes) -> None:
        waiting = self.transport.get_write_buffer_size()
        if waiting and waiting + len(data) > BACKLOG:
            self._overflows += 1
        else:
            self.transport.write(data)

    def _let_go(self) -> None:
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
        self.lose(self._explain(self.address, exc))
