"""A serial line that takes time for its bytes, and damages, loses and delays them.

`carry(data, now)` returns the arriving bytes and their times. The caller moves time and delivers.
"""

from collections.abc import Callable
from math import ceil, log, log1p
from random import Random
from typing import Final, Literal, get_args

from txt1.sim.parameters import LineFaults

BITS_PER_BYTE: Final = 10
"""Bits on the line for a byte: a start bit, eight data bits, a stop bit (8N1, thesis 3.5)."""

# more bits than any line ever carries
NO_ERROR_BITS: Final = 1e18

LineFault = Literal["drop", "tear", "flip", "duplicate", "stall", "cut"]
Arrival = tuple[float, bytes]
"""Time of arrival of a piece, s, and its bytes."""


class SerialLine:
    """One direction of a faulty line.

    Args:
        faults: the line's faults.
        rng: decides the fate of each piece; the same seed and traffic repeat every fault.
        on_fault: called with each fault and the piece before the damage. The faults are "drop", "tear", "flip",
            "duplicate", "stall" for the first piece that a stall holds back, and "cut" for each piece that would arrive
            after the line is lost.
        start: time at which the line came up, s.

    """

    def __init__(
        self,
        faults: LineFaults,
        rng: Random,
        on_fault: Callable[[LineFault, bytes], None] | None = None,
        start: float = 0.0,
    ) -> None:
        if faults.stall and faults.stall_every <= 0.0:
            raise ValueError("a line that always stalls carries nothing: stall_every must be positive")
        self.faults = faults
        self.merges = faults.merge > 0.0
        """Whether pieces that arrive at the same instant become a single piece."""
        self.counts: dict[LineFault, int] = dict.fromkeys(get_args(LineFault), 0)
        self.ends = start + faults.cut if faults.cut else float("inf")
        """Time at which the line is lost, s."""
        self._rng = rng
        self._on_fault = on_fault
        self._last = start
        self._good_bits = self._gap()
        self._stall_starts = start + rng.expovariate(1.0 / faults.stall_every) if faults.stall else float("inf")

    def carry(self, data: bytes, now: float) -> list[Arrival]:
        """Return the pieces that arrive for a piece sent at `now`; their times are never before those of
        earlier calls.
        """
        faults, arrival = self.faults, data
        if faults.drop and self._rng.random() < faults.drop:
            self._report("drop", data)
            return []
        when = self._when(data, now)
        if when > self.ends:
            self._report("cut", data)
            return []
        if faults.flip:
            arrival = self._damage(data)
        if faults.tear and data and self._rng.random() < faults.tear:
            self._report("tear", data)
            arrival = arrival[: self._rng.randrange(len(data))]
            if not arrival:
                return []
        pieces = [(when, arrival)]
        if faults.split:
            pieces = [(when, arrival[at : at + 1]) for at in range(len(arrival))]
        if faults.duplicate and self._rng.random() < faults.duplicate:
            self._report("duplicate", data)
            pieces *= 2
        return pieces

    def _when(self, data: bytes, now: float) -> float:
        """Return the time of arrival for a piece sent at `now`, s."""
        faults = self.faults
        when = now + faults.delay
        if faults.jitter:
            when += faults.jitter * self._rng.random()
        when = max(when, self._last)
        while when >= self._stall_starts:
            end = self._stall_starts + faults.stall
            self._stall_starts = end + self._rng.expovariate(1.0 / faults.stall_every)
            if when < end:
                self._report("stall", data)
                when = end
        if faults.merge:
            when = max(when, ceil(round(when / faults.merge, 6)) * faults.merge)
        self._last = when
        return when

    def _damage(self, data: bytes) -> bytes:
        """Return the bytes with every damaged bit inverted.

        The distance between two damaged bits is drawn, and not the fate of each bit, because damage is rare and traffic
        is not.
        """
        at, bits = self._good_bits, 8 * len(data)
        if at >= bits:
            self._good_bits = at - bits
            return data
        damaged = bytearray(data)
        while at < bits:
            damaged[at >> 3] ^= 0x80 >> (at & 7)
            at += 1 + self._gap()
        self._good_bits = at - bits
        self._report("flip", data)
        return bytes(damaged)

    def _gap(self) -> int:
        """Return the number of bits that arrive intact before the next damaged bit: P(n or more) = (1 - flip)^n."""
        flip = self.faults.flip
        if flip in (0.0, 1.0):
            return 0
        return int(min(log(1.0 - self._rng.random()) / log1p(-flip), NO_ERROR_BITS))

    def _report(self, fault: LineFault, data: bytes) -> None:
        self.counts[fault] += 1
        if self._on_fault is not None:
            self._on_fault(fault, data)


class Pace:
    """The time that bytes take at a baud rate: ten bits each, after all bytes still on their way.

    Bytes that are given together arrive together, at the instant of the last byte, as from a USB adapter.
    """

    ends = float("inf")
    merges = False

    def __init__(self, baud: int) -> None:
        if baud <= 0:
            raise ValueError(f"a baud rate is positive, not {baud}")
        self.baud = baud
        self.busy_until = 0.0
        """Time at which the last byte so far has passed, s."""

    def carry(self, data: bytes, now: float) -> list[Arrival]:
        """Return the bytes with the time at which they have passed, s."""
        if not data:
            return []
        self.busy_until = max(now, self.busy_until) + len(data) * BITS_PER_BYTE / self.baud
        return [(self.busy_until, data)]
