"""The TXT-1's dimensions and command ranges (thesis 2.2.3, 3.2, 3.7.1, 4.2, 4.3)."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

PWM_MAX: Final = 24000
"""Counts from neutral (1.5 ms) to either end (1 ms, 2 ms) of a channel's pulse."""

STEERING_MAX: Final = 18000
"""Counts at which the steering linkage is at its stop; more only makes the servo draw current (thesis 4.3)."""


class Geometry(NamedTuple):
    """Lengths of the vehicle, in metres.

    Attributes:
        radius_min: minimum turning radius R_min (thesis 2.2.3).
        wheelbase: L, between the axles; assumed.
        track_width: W, between the encoder wheels.
        circumference: of a tyre (thesis 3.7.1).
        counts_per_rev: encoder counts per wheel revolution: 400 CPR in quadrature.
        length: of the body.
        width: of the body.

    """

    radius_min: float = 0.56
    wheelbase: float = 0.34
    track_width: float = 0.25
    circumference: float = 0.5125
    counts_per_rev: int = 1600
    length: float = 0.510
    width: float = 0.385

    @property
    def tan_steering_max(self) -> float:
        """Tangent of the steering angle at full lock: (2.13) solved for R_min = v / omega."""
        return self.wheelbase / (2.0 * self.radius_min)

    @property
    def steering_max(self) -> float:
        """Steering angle phi_max at full lock, rad."""
        return math.atan(self.tan_steering_max)

    @property
    def count_length(self) -> float:
        """Distance a wheel rolls per encoder count, m."""
        return self.circumference / self.counts_per_rev
