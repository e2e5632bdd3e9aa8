"""Wire integers and SI values (thesis 3.5), and the ranges of parameters.

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
"""Makes a NamedTuple without its class's `__new__`, which stays interpreted in a compiled wheel."""

# acceleration of free fall, m/s^2
GRAVITY: Final = 9.81

# wire counts per m, m/s, rad, rad/s, V, or 1 of a gain
PER_UNIT: Final = 1000


def to_thousandths(value: float) -> int:
    """Return the whole number of thousandths nearest to `value`, m -> mm and so on; a tie goes to the even number.

    It is exact. In floating point, a binary fraction times 1000 can become a tie although it is none (0.0005 is a
    little more than half a thousandth), so the arithmetic is done in integers.

    Raises ValueError: the value is not finite.
    """
    if not isfinite(value):
        raise ValueError(f"{value} is not finite")
    numerator, denominator = value.as_integer_ratio()
    below, rest = divmod(numerator * PER_UNIT, denominator)
    return below + (2 * rest > denominator or (2 * rest == denominator and below % 2 == 1))


def from_thousandths(count: int) -> float:
    """Return the float nearest to `count` thousandths, mm -> m and so on: 1127 gives the float written 1.127."""
    return count / PER_UNIT
