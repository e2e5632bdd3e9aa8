"""Draws the random numbers of ``numpy.random.default_rng``, bit for bit, where there is no numpy.

How it works. Numbers are hashed to a state of 128 bits, as numpy's `SeedSequence` does. The state steps as a linear
congruential generator does, and its halves, joined and rotated, are 64 random bits (M. E. O'Neill, "PCG: A family of
simple fast space-efficient statistically good algorithms for random number generation", 2014: PCG XSL RR 128/64).
Normal numbers come by 256 strips of equal area under the curve (G. Marsaglia and W. W. Tsang, "The ziggurat method for
generating random variables", 2000). Most draws end in the rectangle of a strip; the others compare with the curve.
"""

from collections.abc import Iterable, Sequence
from decimal import Context, Decimal
from functools import cache
from math import exp, log1p, sqrt
from typing import Any, Final, Protocol

_32: Final = (1 << 32) - 1
_64: Final = (1 << 64) - 1
_128: Final = (1 << 128) - 1
MULTIPLIER: Final = 0x2360ED051FC65DA44385DF649FCCF645
# words in a seed's pool
POOL: Final = 4

STRIPS: Final = 256
# where the last strip's tail begins, and the area of each
TAIL: Final = 3.654152885361009
AREA: Final = 0.0049286732339746519
# of numpy's own table: this edge is rounded the other way
ODD_EDGE: Final = (37, 0.87327106808886)
# of the fraction of a double
FRACTION: Final = 1 << 52


class Draws(Protocol):
    """The random numbers that a simulation with light draws: `Pcg64`, or a ``numpy.random.Generator``."""

    @property
    def bit_generator(self) -> Any:
        """What has the `state`."""

    def random(self) -> float:
        """Return a number in [0, 1)."""

    def integers(self, low: int, /) -> Any:
        """Return a whole number from 0 to low - 1."""

    def uniform(self, low: float, high: float, size: int, /) -> Iterable[Any]:
        """Return `size` numbers in [low, high)."""

    def standard_normal(self, size: int, /) -> Iterable[Any]:
        """Return `size` numbers of mean 0 and standard deviation 1."""


class Pcg64:
    """A stream of random numbers; `entropy`, whole numbers from 0 on, names it."""

    def __init__(self, entropy: Sequence[int]) -> None:
        high, low, inc_high, inc_low = _hashed(entropy)
        self._inc = (((inc_high << 64 | inc_low) << 1) | 1) & _128
        self._state = ((self._inc + (high << 64 | low)) * MULTIPLIER + self._inc) & _128
        # the upper half of the last 64 bits for a draw of 32, and whether the next such draw takes it
        self._half, self._waits = 0, False

    @property
    def bit_generator(self) -> "Pcg64":
        """Itself, which has the `state`."""
        return self

    @property
    def state(self) -> dict[str, Any]:
        """All that it needs to carry on later, JSON values only, in numpy's form."""
        state = {"state": self._state, "inc": self._inc}
        return {"bit_generator": "PCG64", "state": state, "has_uint32": int(self._waits), "uinteger": self._half}

    @state.setter
    def state(self, told: dict[str, Any]) -> None:
        self._state, self._inc = int(told["state"]["state"]), int(told["state"]["inc"])
        self._half, self._waits = int(told["uinteger"]), bool(told["has_uint32"])

    def numpy(self) -> Any:
        """Return numpy's generator, which goes on from here."""
        from numpy.random import default_rng

        generator = default_rng()
        generator.bit_generator.state = self.state
        return generator

    def _next(self) -> int:
        """Return 64 random bits."""
        self._state = state = (self._state * MULTIPLIER + self._inc) & _128
        bits, turn = (state >> 64) ^ (state & _64), state >> 122
        return (bits >> turn | bits << (64 - turn)) & _64

    def _next_half(self) -> int:
        """Return 32 random bits: the lower half of 64, then the upper."""
        self._waits = not self._waits
        if not self._waits:
            return self._half
        bits = self._next()
        self._half = bits >> 32
        return bits & _32

    def random(self) -> float:
        """Return a number in [0, 1)."""
        return (self._next() >> 11) * 2.0**-53

    def integers(self, low: int, /) -> int:
        """Return a whole number from 0 to low - 1; low is 1 to 2^32."""
        if low == 1:
            return 0
        # D. Lemire, "Fast random integer generation in an interval", 2019
        product = self._next_half() * low
        while product & _32 < (1 << 32) % low:
            product = self._next_half() * low
        return product >> 32

    def uniform(self, low: float, high: float, size: int, /) -> list[float]:
        """Return `size` numbers in [low, high)."""
        span = high - low
        return [low + span * self.random() for _ in range(size)]

    def standard_normal(self, size: int, /) -> list[float]:
        """Return `size` numbers of mean 0 and standard deviation 1."""
        widths, inside, heights = _ziggurat()
        drawn: list[float] = []
        while len(drawn) < size:
            # as `_next`, without a call
            self._state = state = (self._state * MULTIPLIER + self._inc) & _128
            bits, turn = (state >> 64) ^ (state & _64), state >> 122
            bits = (bits >> turn | bits << (64 - turn)) & _64
            strip, place = bits & 255, bits >> 9 & (FRACTION - 1)
            x = place * widths[strip]
            if place >= inside[strip]:
                if not strip:
                    x, bits = self._beyond(), place
                elif heights[strip] + (heights[strip - 1] - heights[strip]) * self.random() >= exp(-0.5 * x * x):
                    continue
            drawn.append(-x if bits & 256 else x)
        return drawn

    def _beyond(self) -> float:
        """Return a number from the tail, which begins at `TAIL`."""
        while True:
            x, y = -1.0 / TAIL * log1p(-self.random()), -log1p(-self.random())
            if y + y > x * x:
                return TAIL + x


@cache
def _ziggurat() -> tuple[list[float], list[int], list[float]]:
    """Return each strip's width over `FRACTION`, the places inside its rectangle, and the curve's height at its edge.

    `Decimal` has the same logarithms everywhere.
    """
    exact = Context(prec=40)

    def curve(x: float) -> float:
        return float(Decimal(-0.5 * x * x).exp(exact))

    edges = [0.0] * STRIPS
    edges[-1], edges[0] = TAIL, AREA / curve(TAIL)
    for k in range(STRIPS - 2, 0, -1):
        edges[k] = sqrt(-2.0 * float(Decimal(curve(edges[k + 1]) + AREA / edges[k + 1]).ln(exact)))
        if k == ODD_EDGE[0]:
            edges[k] = ODD_EDGE[1]
    inside = [round(TAIL * curve(TAIL) / AREA * FRACTION), 0]
    inside += [round(edges[k - 1] / edges[k] * FRACTION) for k in range(2, STRIPS)]
    heights = [1.0, *(curve(edge) for edge in edges[1:])]
    return [edge / FRACTION for edge in edges], inside, heights


def _hashed(entropy: Sequence[int]) -> list[int]:
    """Return four numbers of 64 bits, hashed from whole numbers."""
    words: list[int] = []
    for number in entropy:
        words.append(number & _32)
        while number := number >> 32:
            words.append(number & _32)
    constant, factor = 0x43B0D7E5, 0x931E8875

    def hashed(value: int) -> int:
        nonlocal constant
        value ^= constant
        constant = constant * factor & _32
        value = value * constant & _32
        return value ^ value >> 16

    def mixed(one: int, other: int) -> int:
        value = (0xCA01F9DD * one - 0x4973F715 * other) & _32
        return value ^ value >> 16

    pool = [hashed(words[k] if k < len(words) else 0) for k in range(POOL)]
    for source in range(POOL):
        for k in range(POOL):
            if k != source:
                pool[k] = mixed(pool[k], hashed(pool[source]))
    for word in words[POOL:]:
        pool = [mixed(each, hashed(word)) for each in pool]
    constant, factor = 0x8B51F9DD, 0x58F38DED
    halves = [hashed(pool[k % POOL]) for k in range(2 * POOL)]
    return [low | high << 32 for low, high in zip(halves[::2], halves[1::2], strict=True)]
