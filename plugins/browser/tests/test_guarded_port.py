"""The line to a board through the guard: what the guard is told, and what it says."""

import asyncio

import pytest

from txt1.errors import HalError, LinkLost
from txt1.link.base import Link
from txt1.protocol.layout import encode
from txt1.protocol.messages import Velocity
from txt1_browser.serial_line import GuardedPort


class Guard:
    """Notes what it is told, and answers "open"."""

    def __init__(self, answer: tuple[str, str] = ("opened", "")) -> None:
        self.told: list[tuple[str, str]] = []
        self._answer = answer
        self.port = GuardedPort(self.tell)

    def tell(self, what: str, text: str) -> None:
        self.told.append((what, text))
        if what == "open":
            asyncio.get_running_loop().call_soon(self.port.heard, *self._answer)


class End:
    def __init__(self) -> None:
        self.got, self.why = b"", ""

    def connected(self, link: Link) -> None: ...

    def received(self, data: bytes) -> None:
        self.got += data

    def lost(self, reason: str) -> None:
        self.why = reason


async def test_the_guard_gets_the_zeros_before_the_first_byte() -> None:
    guard = Guard()
    link = await guard.port.open(End())
    link.write(b"\xfa\xfb\x00\xff")
    zeros = encode(Velocity(0.0, 0.0)).decode("latin-1")
    assert guard.told == [("open", zeros), ("write", "\xfa\xfb\x00\xff")]


async def test_every_byte_comes_as_it_was() -> None:
    guard, end = Guard(), End()
    await guard.port.open(end)
    guard.port.heard("read", bytes(range(256)).decode("latin-1"))
    assert end.got == bytes(range(256))


async def test_a_port_that_does_not_open_says_why() -> None:
    with pytest.raises(HalError, match=r"the browser's serial port: busy; close other programs"):
        await Guard(("refused", "busy; close other programs")).port.open(End())


async def test_a_board_that_is_unplugged_is_lost_and_takes_no_byte() -> None:
    guard, end = Guard(), End()
    link = await guard.port.open(end)
    guard.port.heard("lost", "the device was unplugged")
    assert end.why == "the browser's serial port: the device was unplugged"
    with pytest.raises(LinkLost):
        link.write(b"x")


async def test_a_stop_of_the_guard_stops_the_robot_before_it_is_confirmed() -> None:
    guard = Guard()
    order: list[object] = []
    guard.port.on_stop = lambda: order.append(len(guard.told))
    await guard.port.open(End())
    guard.port.heard("stop", "3")
    assert order == [1]
    assert guard.told[1:] == [("obeyed", "3")]
