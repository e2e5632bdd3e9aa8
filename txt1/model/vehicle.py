"""The TXT-1's dimensions and command ranges (thesis 2.2.3, 3.2, 3.7.1, 4.2, 4.3)."""

import math
from dataclasses import dataclass
from typing import Final

from txt1.units import Positive, PositiveInt

PWM_MAX: Final = 24000  # counts from neutral (1.5 ms) to either end (1 ms, 2 ms) of a channel's pulse
SPEED: Final = 0.3  # the learning robot's speed, m/s (table 5.2)
STEERING_MAX: Final = 18000  # counts at which the linkage is at its stop; more only makes the servo draw current (4.3)


@dataclass(frozen=True, slots=True)
class Geometry:
    """Lengths of the vehicle, in metres; a section of the configuration."""

    radius_min: Positive = 0.56
    """Minimum turning radius R_min, m (thesis 2.2.3)."""
    wheelbase: Positive = 0.34
    """Between the axles, m; assumed."""
    track_width: Positive = 0.25
    """Between the encoder wheels, m."""
    circumference: Positive = 0.5125
    """Of a tyre, m (thesis 3.7.1)."""
    counts_per_rev: PositiveInt = 1600
    """Encoder counts per wheel revolution: 400 CPR in quadrature."""
    length: Positive = 0.510
    """Of the body, m."""
    width: Positive = 0.385
    """Of the body, m."""

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
