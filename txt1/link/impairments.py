"""Put a baud rate or a bad line between an end and its link. They nest: `paced(faulty(board, faults, seed), 57600)`."""

import asyncio
from collections import deque
from collections.abc import Callable
from functools import partial

from txt1.link.base import BYTES_WAITING_MAX, End, Link
from txt1.sim.parameters import LineFaults
from txt1.sim.random_streams import random_stream
from txt1.sim.serial_line import Arrival, LineFault, Pace, SerialLine

# decides which bytes arrive, and when
Carrier = SerialLine | Pace


class Way:
    """One direction of a line: the bytes on their way, and a timer for the first of them."""

    def __init__(self, carrier: Carrier, deliver: Callable[[bytes], None]) -> None:
        self._carrier = carrier
        self._deliver = deliver
        self._loop = asyncio.get_running_loop()
        self._pieces: deque[Arrival] = deque()
        self._waiting = 0
        self._timer: asyncio.TimerHandle | None = None
        self._open = True
        self.overflows = 0

    def send(self, data: bytes) -> None:
        """Send bytes; bytes that take no time are delivered now."""
        if self._waiting and self._waiting + len(data) > BYTES_WAITING_MAX:
            self.overflows += 1
            return
        now = self._loop.time()
        for when, piece in self._carrier.carry(data, now):
            if self._pieces or when > now or self._carrier.merges:
                self._pieces.append((when, piece))
                self._waiting += len(piece)
            elif self._open:
                self._deliver(piece)
        self._set_timer()

    def deliver_until(self, now: float) -> None:
        """Deliver the bytes that have arrived by `now`."""
        while self._pieces and self._pieces[0][0] <= now:
            when, piece = self._pieces.popleft()
            while self._carrier.merges and self._pieces and self._pieces[0][0] == when:
                piece += self._pieces.popleft()[1]
            self._waiting -= len(piece)
            self._deliver(piece)

    def stop(self) -> None:
        """Discard the bytes on their way; nothing is delivered any more."""
        self._open = False
        self._pieces.clear()
        if self._timer is not None:
            self._timer.cancel()

    def _set_timer(self) -> None:
        if self._pieces and self._timer is None and self._open:
            self._timer = self._loop.call_at(self._pieces[0][0], self._due, self._pieces[0][0])

    def _due(self, when: float) -> None:
        self._timer = None
        # a timer may fire early by the clock's resolution
        self.deliver_until(max(when, self._loop.time()))
        self._set_timer()


class Through:
    """An end behind two carriers, outgoing and incoming: the link sees this object as its end, the end sees a
    separate link.
    """

    def __init__(self, end: End, carriers: Callable[[float], tuple[Carrier, Carrier]]) -> None:
        self._end = end
        self._carriers = carriers
        self._link: _ThroughLink

    def connected(self, link: Link) -> None:
        """Give the end its separate link."""
        self._link = _ThroughLink(self._end, link, *self._carriers(asyncio.get_running_loop().time()))
        self._end.connected(self._link)

    def received(self, data: bytes) -> None:
        """Send incoming bytes on their way to the end."""
        self._link.incoming.send(data)

    def lost(self, reason: str) -> None:
        """Tell the end; bytes on their way are lost."""
        self._link.lose(reason)


class _ThroughLink(Link):
    """The link that an end behind carriers sees."""

    def __init__(self, end: End, link: Link, outgoing: Carrier, incoming: Carrier) -> None:
        super().__init__(link.address, end)
        self._link = link
        link.on_shut = self.shut
        self.outgoing, self.incoming = self._ways = Way(outgoing, link.write), Way(incoming, end.received)
        self._cutter: asyncio.TimerHandle | None = None
        if outgoing.ends < float("inf"):
            self._cutter = asyncio.get_running_loop().call_at(outgoing.ends, self._cut, outgoing.ends)

    @property
    def overflows(self) -> int:  # type: ignore[override]
        return self._link.overflows + sum(way.overflows for way in self._ways)

    def _send(self, data: bytes) -> None:
        self.outgoing.send(data)

    def close(self) -> None:
        self.shut()
        self._link.close()

    def shut(self) -> bool:
        self._stop()
        return super().shut()

    def lose(self, reason: str) -> None:
        self._stop()
        super().lose(reason)

    def _cut(self, now: float) -> None:
        for way in self._ways:
            # the byte was in time, even if its timer comes after this one
            way.deliver_until(now)
        if self.up:
            self.lose(f"{self.address}: the line was cut, as its faults say")
            self._link.close()

    def _stop(self) -> None:
        """Discard the bytes on their way."""
        for way in self._ways:
            way.stop()
        if self._cutter is not None:
            self._cutter.cancel()


def paced(end: End, baud: int) -> End:
    """Return an end with a baud rate between it and its links: ten bits a byte, in both directions.

    Bytes that were written together are delivered together, when the last of them has passed. So faults at either end
    hit whole frames.
    """
    # a wrong rate is refused here, and not when a host connects
    Pace(baud)
    return Through(end, lambda _: (Pace(baud), Pace(baud)))


def faulty(
    end: End,
    faults: LineFaults,
    seed: int,
    name: str = "line",
    on_fault: Callable[[LineFault, bytes], None] | None = None,
) -> End:
    """Return an end with a bad line between it and its links, in both directions; the same end if the line has
    no faults.

    Each connection is a new line: `cut` counts from its start. Seed and name make the faults of all connections repeat.
    `on_fault` (see `SerialLine`) is called for both directions.
    """
    if faults.harmless:
        return end
    outgoing, incoming = (random_stream(seed, name, way) for way in ("outgoing", "incoming"))
    line = partial(SerialLine, faults, on_fault=on_fault)
    return Through(end, lambda now: (line(rng=outgoing, start=now), line(rng=incoming, start=now)))
