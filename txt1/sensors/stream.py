"""A sensor at the end of a byte link: its codec turns bytes into readings, and each gets the time of its
measurement.
"""

import asyncio
from collections.abc import Callable, Coroutine
from math import inf
from typing import Any, Final, Generic, NamedTuple, TypeVar

from txt1.errors import HalError, LinkLost
from txt1.link.base import Link
from txt1.link.device import open_link
from txt1.sensors.base import Reading
from txt1.telemetry.topics import Topic

T = TypeVar("T")

# s from the loss of a device to the next attempt
RETRY: Final = 1.0
# largest share by which a device's clock may be fast
DRIFT: Final = 1e-4
# s: a device's clock with a larger error has started again
LOST: Final = 1.0


class Measured(NamedTuple, Generic[T]):
    """A value decoded from bytes."""

    value: T
    time: float | None = None
    """Time by the device's clock, s; None if it sends no time."""
    age: float = 0.0
    """s: age of the value when the device could send it at the earliest.

    A scan has the time of its first beam, so it is as old as its sweep is long.
    """


class Codec(Generic[T]):
    """The host's end of a device's protocol, without I/O. A new one is made for every connection.

    Args:
        greeting: bytes sent first.
        farewell: bytes sent before the link is closed.

    """

    def __init__(self, greeting: bytes = b"", farewell: bytes = b"") -> None:
        self.faults = 0
        """Number of discarded pieces of the stream."""
        self.farewell = farewell
        self._out = greeting
        # bytes of an incomplete piece
        self._rest = b""

    def feed(self, data: bytes) -> list[Measured[T]]:
        """Take bytes; return the values that they complete.

        Raises HalError if the device reports that it cannot go on, or is another device.
        """
        raise NotImplementedError

    def to_send(self) -> bytes:
        """Return the bytes to send now, even before the first byte has come."""
        out, self._out = self._out, b""
        return out


class Framed(Codec[T]):
    """The codec of a device that sends frames. After damaged bytes it goes on at the next intact frame."""

    _skipping = False

    def frame(self, data: bytes, at: int, found: list[Measured[T]]) -> int | None:
        """Append the values of the frame at an offset, and return its length; 0: no frame, None: an incomplete
        frame.
        """
        raise NotImplementedError

    def feed(self, data: bytes) -> list[Measured[T]]:
        """Take bytes; return the readings that they complete."""
        data, at = self._rest + data, 0
        found: list[Measured[T]] = []
        while at < len(data) and (length := self.frame(data, at, found)) is not None:
            self.faults += not (length or self._skipping)
            self._skipping = not length
            at += length or 1
        self._rest = data[at:]
        return found


class DeviceClock:
    """Converts a device's times to the run's. Messages are delayed by varying times; the quickest message counts."""

    def __init__(self) -> None:
        self._offset = inf
        self._last = -inf

    def time(self, device: float | None, arrived: float) -> float:
        """Return when a message was made, s by the run's clock.

        `device` is the device's time, which only increases; `arrived` is the message's arrival.
        """
        if device is None:
            return arrived
        late = arrived - device - self._offset
        if device < self._last or late > LOST:
            self._offset = inf
        elif self._offset < inf:
            self._offset += DRIFT * (device - self._last)
        self._offset = min(self._offset, arrived - device)
        self._last = device
        return device + self._offset


class Unwrapped:
    """Continues a device's counter across its overflows."""

    def __init__(self, modulus: float) -> None:
        self._modulus = modulus
        self._last: float | None = None
        self._turns = 0.0

    def __call__(self, count: float) -> float:
        """Return the count since the first 0. A count that falls by less than half the range has not overflowed."""
        if self._last is not None and self._last - count > 0.5 * self._modulus:
            self._turns += self._modulus
        self._last = count
        return self._turns + count


class Streamed(Generic[T]):
    """A sensor with a codec and an address. A lost device is tried again once a second.

    Args:
        topic: topic of its values.
        period: time between two calls of `read`, s.
        address: serial device or socket://host:port.
        codec: makes a codec for a new connection.
        baud: baud rate of a serial device.
        latency: time from measuring to sending, s.
        server: the command that serves a virtual device of this kind.

    """

    simulated = False

    def __init__(
        self,
        topic: Topic[T],
        period: float,
        address: str,
        codec: Callable[[], Codec[T]],
        baud: int = 115200,
        latency: float = 0.0,
        server: str = "txt1 sensor virtual",
    ) -> None:
        self.topic, self.period = topic, period
        self._address, self._make, self._baud, self._latency, self._server = address, codec, baud, latency, server
        self._codec = codec()
        self._link: Link | None = None
        self._failure = ""
        self._opening: asyncio.Task[None] | None = None
        self._clock = DeviceClock()
        # s of the loop's clock at the start of the run
        self._origin = inf
        self._newest: tuple[float, T] | None = None
        self._last = -inf

    @property
    def faults(self) -> int:
        """Number of pieces of the stream that the codec has discarded since the device was opened."""
        return self._codec.faults

    async def open(self) -> None:
        """Open the link, and let the device begin."""
        self._origin, self._last, self._failure, self._newest = inf, -inf, "", None
        await self._connect()

    async def close(self) -> None:
        """Let the device stop, and close the link."""
        if self._opening is not None:
            self._opening.cancel()
            self._opening = None
        link, self._link = self._link, None
        if link is not None and link.up:
            if self._codec.farewell:
                link.write(self._codec.farewell)
                # closing discards unsent bytes
                await asyncio.sleep(0.05)
            link.close()

    def read(self, now: float) -> Reading[T] | None:
        """Return the newest reading that has arrived; raises HalError while the device is lost."""
        self._origin = min(self._origin, asyncio.get_running_loop().time() - now)
        if self._failure:
            raise HalError(self._failure)
        newest, self._newest = self._newest, None
        if newest is None:
            return None
        time = max(self._last, min(newest[0] - self._origin - self._latency, now))
        # the reading is from before the run
        if time < 0.0:
            return None
        self._last = time
        return Reading(time, newest[1])

    # -- the link's end ----------------------------------------------------------------------------------------

    def connected(self, link: Link) -> None:
        """Greet the device."""
        self._link, self._codec, self._clock, self._failure = link, self._make(), DeviceClock(), ""
        self._send()

    def received(self, data: bytes) -> None:
        """Take bytes."""
        arrived = asyncio.get_running_loop().time()
        try:
            measured = self._codec.feed(data)
        except HalError as error:
            if self._link is not None:
                self._link.close()
            self.lost(f"{self._address}: {error}")
            return
        for value, time, age in measured:
            self._newest = self._clock.time(time, arrived) - age, value
        self._send()

    def lost(self, reason: str) -> None:
        """Try the device again, until the sensor is closed."""
        self._failure = reason
        self._link = None
        self._opening = _started(self._reconnect())

    # -- inside ------------------------------------------------------------------------------------------------

    def _send(self) -> None:
        data = self._codec.to_send()
        if data and self._link is not None and self._link.up:
            self._link.write(data)

    async def _connect(self) -> None:
        try:
            await open_link(self._address, self, self._baud, behind=self._server)
        except LinkLost as error:
            raise HalError(str(error)) from None

    async def _reconnect(self) -> None:
        while self._link is None:
            await asyncio.sleep(RETRY)
            try:
                await self._connect()
            except HalError as error:
                self._failure = str(error)


def _started(work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
    return asyncio.get_running_loop().create_task(work)
