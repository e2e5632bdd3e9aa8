"""Gain scheduling (thesis 4.3, table 4.1)."""

from bisect import bisect_left
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, NamedTuple

from txt1.control.pid import Gains

# angular gain sets that fit on the board
SETS_MAX: Final = 14


class GainSet(NamedTuple):
    """Gains in force up to a measured speed v_max, m/s."""

    v_max: float
    gains: Gains


@dataclass(frozen=True)
class Schedule:
    """Gains by speed: the first set whose v_max is at least v; past the end, the last set (thesis 4.3).

    An empty schedule is all zeros: nothing steers.

    Raises ValueError: there are more than 14 sets, or v_max does not rise from set to set.
    """

    sets: tuple[GainSet, ...] = ()
    _v_max: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _gains: tuple[Gains, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.sets) > SETS_MAX:
            raise ValueError(f"at most {SETS_MAX} gain sets fit the board, not {len(self.sets)}")
        for lower, upper in pairwise(self.sets):
            if not lower.v_max < upper.v_max:
                raise ValueError(f"v_max must rise from set to set: {upper.v_max} follows {lower.v_max}")
        object.__setattr__(self, "_v_max", tuple(each.v_max for each in self.sets[:-1]))
        object.__setattr__(self, "_gains", tuple(each.gains for each in self.sets) or (Gains(),))

    def at(self, v: float) -> Gains:
        """The gains for a measured, signed speed v in m/s."""
        return self._gains[bisect_left(self._v_max, v)]


# the thesis's linear gains (4.2)
LINEAR_GAINS: Final = Gains(11.0, 18.0, 0.250)
# the thesis's angular gains (table 4.1)
ANGULAR_GAINS: Final = tuple(
    GainSet(v_max, Gains(kp, ki, 0.005))
    for v_max, kp, ki in (
        (-1.35, 1.0, 25.0),
        (-1.15, 1.0, 25.0),
        (-0.95, 1.0, 25.0),
        (-0.75, 1.0, 35.0),
        (-0.55, 1.0, 40.0),
        (-0.35, 1.0, 50.0),
        (-0.15, 1.0, 30.0),
        (0.15, 6.0, 200.0),
        (0.35, 6.0, 170.0),
        (0.55, 4.0, 130.0),
        (0.75, 3.0, 80.0),
        (0.95, 4.0, 60.0),
        (1.15, 4.0, 30.0),
        (1.35, 4.0, 20.0),
    )
)
