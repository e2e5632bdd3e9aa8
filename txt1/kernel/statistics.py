"""Running statistics of durations, at a cost too small to matter.

A log-linear histogram: bucket widths grow with the value, so any percentile of any number of samples is known to 3 %
in a few kilobytes, and adding a sample is a shift and an increment.
"""

from __future__ import annotations

from bisect import bisect_left
from itertools import accumulate
from typing import Final, NamedTuple

from txt1.kernel.clock import NS_PER_S

_SUB_BITS: Final = 5
# buckets per factor of two; the relative error is at most 1 / _SUB
_SUB: Final = 1 << _SUB_BITS
# below this many ns every value has a bucket of its own
_EXACT: Final = 2 * _SUB


class Percentiles(NamedTuple):
    """Percentiles and the maximum of a duration, in seconds; all 0 without samples."""

    p50: float
    p99: float
    p999: float
    max: float


class Histogram:
    """Counts of durations in ns; never forgets, never grows."""

    def __init__(self) -> None:
        self._counts = [0] * (_EXACT + _SUB * (64 - _SUB_BITS))
        self.max_ns = 0

    @property
    def count(self) -> int:
        """Number of counted durations."""
        return sum(self._counts)

    def add(self, ns: int) -> None:
        """Count one duration in ns; a negative one counts as 0."""
        # comparisons, as `max` takes longer than the rest
        if ns < 0:
            ns = 0
        shift = ns.bit_length() - _SUB_BITS - 1
        if shift < 0:
            shift = 0
        self._counts[(shift << _SUB_BITS) + (ns >> shift)] += 1
        if ns > self.max_ns:
            self.max_ns = ns

    def copy(self) -> Histogram:
        """Return a new histogram with the same counts."""
        copied = Histogram()
        copied._counts, copied.max_ns = self._counts.copy(), self.max_ns
        return copied

    def pad(self, count: int) -> None:
        """Count durations of 0 until there are `count` durations in all."""
        self._counts[0] += count - self.count

    def percentiles_ns(self, *shares: float) -> list[int]:
        """Return the smallest durations in ns that these shares of samples do not exceed, to 3 %; 0 without samples."""
        reached = list(accumulate(self._counts))
        return [min(_upper_bound_ns(bisect_left(reached, share * reached[-1])), self.max_ns) for share in shares]

    def percentiles(self) -> Percentiles:
        """p50, p99, p99.9 and the maximum in seconds."""
        return Percentiles(*(ns / NS_PER_S for ns in (*self.percentiles_ns(0.5, 0.99, 0.999), self.max_ns)))


def _upper_bound_ns(index: int) -> int:
    """The largest duration in ns that falls into a bucket."""
    if index < _EXACT:
        return index
    shift = (index >> _SUB_BITS) - 1
    return ((index - (shift << _SUB_BITS) + 1) << shift) - 1


class TaskStatistics:
    """One task's statistics so far: cycles run, cycles missed, start lateness and run time.

    While virtual time jumps, the run time of one cycle in eight is measured; in real time that of each cycle.
    """

    def __init__(self) -> None:
        self.cycles = 0
        self.misses = 0
        self.run_time = Histogram()
        self._lateness = Histogram()

    @property
    def lateness(self) -> Histogram:
        """Start lateness. Only late cycles are added; all others count as 0."""
        self._lateness.pad(self.cycles)
        return self._lateness

    def add_lateness(self, ns: int) -> None:
        """Count how late a cycle started, ns."""
        self._lateness.add(ns)
