"""Outages of a device, put on the bytes between its port and its driver, for the conformance suites."""

import asyncio
from enum import StrEnum
from typing import Final

from txt1.errors import HalError
from txt1.link.base import End, Link, Port

# s that a nonsensical answer takes
ANSWER_TIME: Final = 0.001


class Outage(StrEnum):
    """The ways in which a device falls silent."""

    SILENT = "silent"
    """No byte passes in either direction; the link stays up."""
    UNPLUGGED = "unplugged"
    """The link is lost, and the port cannot be opened."""
    POWER = "without power"
    """The device is off behind an adapter that stays; then it starts in its first mode."""
    HALF_OPEN = "half open"
    """The connection carries nothing any more, also later; a new connection is served."""
    NONSENSE = "makes no sense"
    """Whatever is written comes back at once, and an empty line: an answer that makes no sense."""
    HELD = "held"
    """A chip holds the data line of its I2C bus: each transfer waits, and fails."""


class OutagePort:
    """A port with one outage.

    Args:
        port: the port of a virtual device. Closing it powers the device down.
        outage: the kind of outage.
        begins: s from the first opening to the outage.
        lasts: duration of the outage, s; 0: a restart.

    """

    def __init__(self, port: Port, outage: Outage, begins: float, lasts: float) -> None:
        self.address = port.address
        self.opened = 0
        """How often the port was opened."""
        self.written: list[float] = []
        """Loop times at which the driver wrote."""
        self.is_out = False
        """Whether the outage lasts at present."""
        self._port, self._outage, self._begins, self._lasts = port, outage, begins, lasts
        self._lines: list[_Line] = []
        self._running: asyncio.Task[None] | None = None

    async def open(self, end: End) -> Link:
        """Open a link to the device, unless it is unplugged."""
        if self._running is None:
            self._running = asyncio.create_task(self._run())
        if self.is_out and self._outage is Outage.UNPLUGGED:
            raise HalError(f"{self.address} is not plugged in: is it?")
        line = _Line(self.address, end, self)
        self._lines.append(line)
        self.opened += 1
        if not (self.is_out and self._outage is Outage.POWER):
            await self._port.open(line.far)
        end.connected(line)
        return line

    async def close(self) -> None:
        """Release the device."""
        if self._running is not None:
            self._running.cancel()
            self._running = None
        await self._port.close()

    async def _run(self) -> None:
        await asyncio.sleep(self._begins)
        self.is_out = True
        up = [line for line in self._lines if line.up]
        for line in up:
            line.deaf |= self._outage is Outage.HALF_OPEN
            if self._outage is Outage.UNPLUGGED:
                line.far.hang_up()
                line.lose(f"{self.address} was unplugged")
        if self._outage is Outage.POWER:
            for line in up:
                line.far.hang_up()
            await self._port.close()
        await asyncio.sleep(self._lasts)
        self.is_out = False
        if self._outage is Outage.POWER:
            for line in [line for line in self._lines if line.up]:
                await self._port.open(line.far)

    @property
    def answers_nonsense(self) -> bool:
        """Whether the device answers with nonsense now."""
        return self.is_out and self._outage is Outage.NONSENSE

    def passes(self, line: "_Line") -> bool:
        """Return whether bytes pass on this line now."""
        return not (self.is_out and self._outage is not Outage.HALF_OPEN) and not line.deaf


class _Far:
    """The end of the inner link, to the device."""

    def __init__(self, line: "_Line") -> None:
        self._line = line
        self.link: Link | None = None

    def connected(self, link: Link) -> None:
        self.link = link

    def received(self, data: bytes) -> None:
        self._line.arrive(data)

    def lost(self, reason: str) -> None:
        self.link = None
        self._line.lose(reason)

    def hang_up(self) -> None:
        if self.link is not None:
            self.link.close()
            self.link = None


class _Line(Link):
    """The link that the driver sees."""

    def __init__(self, address: str, end: End, port: OutagePort) -> None:
        super().__init__(address, end)
        self.far = _Far(self)
        # whether it carries nothing any more
        self.deaf = False
        self._port = port

    def arrive(self, data: bytes) -> None:
        """Pass bytes of the device on, if they pass."""
        if self.up and self._port.passes(self):
            self._end.received(data)

    def _send(self, data: bytes) -> None:
        loop = asyncio.get_running_loop()
        self._port.written.append(loop.time())
        if self._port.answers_nonsense and self.up:
            loop.call_later(ANSWER_TIME, self._echo, data + b"\n")
        if self.far.link is not None and self._port.passes(self):
            self.far.link.write(data)

    def _echo(self, data: bytes) -> None:
        if self.up:
            self._end.received(data)

    def _let_go(self) -> None:
        self.far.hang_up()
