"""A car as the others of its team have to know it: its size, its circle, its speeds."""

from math import ceil, hypot
from typing import Final, NamedTuple, Self

from txt1.control.parameters import Safety
from txt1.model.vehicle import Geometry


class Body(NamedTuple):
    """A car among others; lengths in m, speeds in m/s."""

    radius: float
    """Radius of its smallest circle."""
    v_max: float
    """Its top speed."""
    reach: float
    """Distance of its corners from its body's centre."""
    centre: float = 0.0
    """How far its body's centre is ahead of its pose."""
    least: float = 0.0
    """Slowest speed at which it moves evenly."""
    pivots: bool = False
    """Whether it turns in place."""

    @classmethod
    def of(cls, car: Geometry, safety: Safety) -> Self:
        """Return the body of a car of these dimensions and limits, its reach in whole centimetres."""
        reach = ceil(50.0 * hypot(car.length, car.width)) / 100.0
        return cls(car.radius_min, safety.v_max, reach, car.centre, safety.v_dead_band, car.steering == "skid")

    def speed(self, share: float, given: float | None = None) -> float:
        """Return the speed given, or else a share of the top speed, as the car can drive it, m/s."""
        wanted = self.v_max * share if given is None else given
        return min(max(wanted, self.least), self.v_max)


DEFAULT_BODY: Final = Body.of(Geometry(), Safety())
"""The body of the TXT-1."""
