"""A link in memory: what is written at one end arrives at the other at once, in the loop's next turn."""

from __future__ import annotations

import asyncio

from txt1.link.base import End, Link


class _MemoryLink(Link):
    """One end of a pair; delivery is the loop's next business, so it takes no virtual time."""

    peer: _MemoryLink

    def __init__(self, end: End) -> None:
        super().__init__("memory", end)
        self._loop = asyncio.get_running_loop()

    def _send(self, data: bytes) -> None:
        self._loop.call_soon(self.peer.arrive, data)

    def _let_go(self) -> None:
        self._loop.call_soon(self.peer.lose, "the other end of the link in memory was closed")

    def arrive(self, data: bytes) -> None:
        if self.up:
            self._end.received(data)


def connect(one: End, other: End) -> tuple[Link, Link]:
    """The two ends of a link in memory, the first for `one`; both are connected when this returns."""
    first, second = _MemoryLink(one), _MemoryLink(other)
    first.peer, second.peer = second, first
    one.connected(first)
    other.connected(second)
    return first, second
