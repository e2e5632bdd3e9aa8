"""A sensor at the end of a byte link: its codec turns bytes into readings, and each gets the time of its
measurement.

A lost device is opened again, and a silent device is greeted and then opened again (`txt1.link.silence`).
"""

import asyncio
from collections.abc import Callable
from math import inf
from typing import Final, Generic, NamedTuple, TypeVar

from txt1.errors import HalError
from txt1.link.base import Link, Port
from txt1.link.device import DevicePort
from txt1.link.silence import Ladder, Watched
from txt1.sensors.base import Reading
from txt1.telemetry.topics import Topic

T = TypeVar("T")

# periods of silence, and the least number of s, after which a device is greeted again
SILENT_PERIODS: Final = 20
SILENT_MIN: Final = 2.0
# largest share by which a device's clock may be fast
DEVICE_CLOCK_DRIFT: Final = 1e-4
# s: a device's clock with a larger error has started again
CLOCK_ERROR_MAX: Final = 1.0


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
    """The host's end of a device's protocol, without I/O. A new one is made for each greeting.

    An answer that makes no sense is not asked for again: whoever is silent is greeted again after a while.

    Args:
        greeting: bytes sent first; empty: the device takes no commands.
        farewell: bytes sent before the link is closed.

    """

    def __init__(self, greeting: bytes = b"", farewell: bytes = b"") -> None:
        self.faults = 0
        """Number of discarded pieces of the stream."""
        self.idle = False
        """Set to True by a device that is well, but has nothing to measure."""
        self.trouble = ""
        """Why there are no readings, in the device's own words; empty if it told nothing."""
        self.farewell = farewell
        self.greets = bool(greeting)
        """Whether the device takes commands."""
        self.pause: float | None = None
        """s after which `resume` is to be called, unless a new pause comes before; None: as before."""
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

    def resume(self) -> None:
        """Go on after a pause that it has asked for."""


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
        if device < self._last or late > CLOCK_ERROR_MAX:
            self._offset = inf
        elif self._offset < inf:
            self._offset += DEVICE_CLOCK_DRIFT * (device - self._last)
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
    """A sensor with a codec and an address.

    Args:
        topic: topic of its values.
        period: time between two calls of `read`, s.
        address: serial device or socket://host:port; or the device's port.
        codec: makes a codec for a new connection, and for each time that the device is greeted again.
        baud: baud rate of a serial device.
        latency: time from measuring to sending, s.
        server: the command that serves a virtual device of this kind.
        patience: s for which the device may be silent; None: SILENT_PERIODS, and at least SILENT_MIN.

    """

    simulated = False

    def __init__(
        self,
        topic: Topic[T],
        period: float,
        address: str | Port,
        codec: Callable[[], Codec[T]],
        baud: int = 115200,
        latency: float = 0.0,
        server: str = "txt1 sensor virtual",
        patience: float | None = None,
    ) -> None:
        self.topic, self.period = topic, period
        self._make, self._latency = codec, latency
        self._codec = codec()
        # faults of earlier codecs
        self._faults = 0
        self._link: Link | None = None
        # why the port cannot be opened, or a mistake in the program
        self._failure = ""
        self._mistake: Exception | None = None
        greet = self._greet if self._codec.greets else None
        patience = max(SILENT_PERIODS * period, SILENT_MIN) if patience is None else patience
        port = DevicePort(address, baud, behind=server) if isinstance(address, str) else address
        self._watched = Watched(port, self, patience, greet, self._tell, self._fail)
        self._clock = DeviceClock()
        # calls the codec after a pause
        self._timer: asyncio.TimerHandle | None = None
        # s of the loop's clock at the start of the run
        self._origin = inf
        self._newest: tuple[float, T] | None = None
        self._last = -inf

    @property
    def port(self) -> Port:
        """The device's port. A virtual device may take its place before the sensor is opened."""
        return self._watched.port

    @port.setter
    def port(self, port: Port) -> None:
        self._watched.port = port

    @property
    def ladder(self) -> Ladder:
        """The steps taken against the present silence."""
        return self._watched.ladder

    @property
    def faults(self) -> int:
        """Number of pieces of the stream that were discarded since the sensor was opened."""
        return self._faults + self._codec.faults

    async def open(self) -> None:
        """Open the link, and let the device begin."""
        self._origin, self._last, self._failure, self._mistake, self._newest = inf, -inf, "", None, None
        self._faults, self._codec = 0, self._make()
        await self._watched.open()

    async def close(self) -> None:
        """Let the device stop, and close the link."""
        self._watched.close()
        self._pause(inf)
        link, self._link = self._link, None
        if link is not None and link.up:
            if self._codec.farewell:
                link.write(self._codec.farewell)
                # closing discards unsent bytes
                await asyncio.sleep(0.05)
            link.close()
        await self.port.close()

    def read(self, now: float) -> Reading[T] | None:
        """Return the newest reading that has arrived; raises HalError while the device is lost, silent or in
        trouble.
        """
        self._origin = min(self._origin, asyncio.get_running_loop().time() - now)
        if self._mistake is not None:
            raise self._mistake
        newest, self._newest = self._newest, None
        if newest is None:
            self._raise_why()
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
        self._link, self._failure = link, ""
        self._greet()

    def received(self, data: bytes) -> None:
        """Take bytes."""
        arrived = asyncio.get_running_loop().time()
        try:
            measured = self._codec.feed(data)
        except HalError as error:
            self._watched.give_up(f"{self.port.address}: {error}")
            return
        if measured or self._codec.idle:
            self._watched.heard()
            self._codec.idle = False
        for value, time, age in measured:
            self._newest = self._clock.time(time, arrived) - age, value
            self._codec.trouble = ""
        self._send()

    def lost(self, reason: str) -> None:
        """Note why there are no readings; what was buffered is from before."""
        self._failure, self._link, self._newest = reason, None, None

    # -- inside ------------------------------------------------------------------------------------------------

    def _greet(self) -> None:
        """Begin anew with the device, which may have restarted: half an answer and its clock are worth nothing."""
        self._faults += self._codec.faults
        self._codec, self._clock, self._newest = self._make(), DeviceClock(), None
        self._send()

    def _raise_why(self) -> None:
        """Raise HalError if it is known why there is no reading."""
        if self._failure:
            raise HalError(self._failure)
        ladder, trouble = self.ladder, self._codec.trouble
        if trouble:
            raise HalError(f"{self.port.address}: {trouble}")
        if ladder.silent:
            raise HalError(f"{self.port.address} is silent: {ladder}")

    def _tell(self, reason: str) -> None:
        self._failure = reason

    def _fail(self, error: Exception) -> None:
        self._mistake = error

    def _send(self) -> None:
        data = self._codec.to_send()
        if data and self._link is not None and self._link.up:
            self._link.write(data)
        pause, self._codec.pause = self._codec.pause, None
        if pause is not None:
            self._pause(pause)

    def _pause(self, pause: float) -> None:
        """Let the codec go on after a pause, s; inf: not at all."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if pause < inf:
            self._timer = asyncio.get_running_loop().call_later(pause, self._resume, self._codec)

    def _resume(self, codec: Codec[T]) -> None:
        self._timer = None
        if codec is self._codec:
            codec.resume()
            self._send()
