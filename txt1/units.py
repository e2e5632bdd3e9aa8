"""Wire integers and SI values (thesis 3.5), and the numbers a parameter may be.

The wire counts mm, mm/s, mrad, mrad/s and mV, and carries the gains times 1000: always thousandths of the SI value.
"""

from math import isfinite
from typing import Annotated, Final

from annotated_types import Ge, Gt, Le

Positive = Annotated[float, Gt(0.0)]
PositiveInt = Annotated[int, Gt(0)]
NotNegative = Annotated[float, Ge(0.0)]
Share = Annotated[float, Ge(0.0), Le(1.0)]

new: Final = tuple.__new__
"""Makes a NamedTuple past its class's own `__new__`, which stays interpreted in a compiled wheel."""

PER_UNIT: Final = 1000  # wire counts per m, m/s, rad, rad/s, V, or 1 of a gain


def to_thousandths(value: float) -> int:
    """The whole number of thousandths nearest to `value`, m -> mm and so on; exactly between two, the even one.

    Exact: a binary fraction times 1000 in floating point can land on a tie that it is not on (0.0005 is a little more
    than half a thousandth), so the arithmetic is done in integers.

    Raises ValueError: the value is not finite.
    """
    if not isfinite(value):
        raise ValueError(f"{value} is not finite")
    numerator, denominator = value.as_integer_ratio()
    below, rest = divmod(numerator * PER_UNIT, denominator)
    return below + (2 * rest > denominator or (2 * rest == denominator and below % 2 == 1))


def from_thousandths(count: int) -> float:
    """The float nearest to `count` thousandths, mm -> m and so on: 1127 gives just what is written 1.127."""
    return count / PER_UNIT
