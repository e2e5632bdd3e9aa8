"""Ends of links that remember, and devices for them."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Coroutine, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from txt1.errors import HalError
from txt1.kernel.loop import run
from txt1.link.base import Link
from txt1.link.device import open_link

FRAME = bytes(range(0x10, 0x2A))
EVERY_BYTE = bytes(range(256))


class End:
    """Remembers what happens to it, and when."""

    def __init__(self) -> None:
        self.links: list[Link] = []
        self.pieces: list[bytes] = []
        self.times: list[float] = []
        self.reasons: list[str] = []
        self.lost_at: list[float] = []

    @property
    def link(self) -> Link:
        return self.links[-1]

    @property
    def data(self) -> bytes:
        return b"".join(self.pieces)

    def has(self, size: int) -> bool:
        return len(self.data) >= size

    def connected(self, link: Link) -> None:
        self.links.append(link)

    def received(self, data: bytes) -> None:
        self.pieces.append(data)
        self.times.append(asyncio.get_running_loop().time())

    def lost(self, reason: str) -> None:
        self.reasons.append(reason)
        self.lost_at.append(asyncio.get_running_loop().time())


class Echo(End):
    """Sends back what comes."""

    def received(self, data: bytes) -> None:
        super().received(data)
        self.link.write(data)


async def turns() -> None:
    """Enough turns of the loop, and real time, for anything under way to arrive."""
    for _ in range(20):
        await asyncio.sleep(0.002)


def timers() -> list[asyncio.TimerHandle]:
    """What the loop is still to call later."""
    loop: Any = asyncio.get_running_loop()
    now = loop.time()
    return [handle for handle in loop._scheduled if not handle.cancelled() and handle.when() > now]  # noqa: SLF001


def run_quietly(main: Coroutine[Any, Any, None], speed: Any = None) -> None:
    """Run to the end; the loop had no unhandled exception to report, and no timer is left."""
    reports: list[dict[str, Any]] = []

    async def body() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, report: reports.append(report))
        before = timers()
        await main
        await asyncio.sleep(0)
        assert [timer for timer in timers() if timer not in before] == []

    run(body(), speed=speed)
    assert reports == []


@contextmanager
def opened_pty() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal of nobody's making: its master and the path of its other side."""
    master, slave = os.openpty()
    path = os.ttyname(slave)
    os.close(slave)
    try:
        yield master, path
    finally:
        with suppress(OSError):  # it may be gone already
            os.close(master)


@contextmanager
def host_at(path: str) -> Iterator[int]:
    """A host that has the device open, and does nothing else to it."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        yield fd
    finally:
        os.close(fd)


def waiting(fd: int) -> bytes:
    """What there is to read, without waiting."""
    data = b""
    with suppress(BlockingIOError):
        while piece := os.read(fd, 4096):
            data += piece
    return data


def refusal(address: str, baud: int = 57600, transport: str = "pyserial-asyncio") -> str:
    """What is said when this address cannot be opened."""

    async def main() -> str:
        with pytest.raises(HalError) as error:
            await open_link(address, End(), baud, transport=transport)
        return str(error.value)

    return run(main())
