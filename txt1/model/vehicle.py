"""A vehicle's dimensions, the TXT-1's by default, and ranges of commands (thesis 2.2.3, 3.2, 3.7.1, 4.2, 4.3)."""

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from annotated_types import Ge, Gt, Le

from txt1.units import Positive

# m, of a vehicle's part; the largest is beyond each such car, so a length in cm or mm is noticed
Length = Annotated[float, Gt(0.0), Le(3.0)]
# counts from neutral (1.5 ms) to either end (1 ms, 2 ms) of a channel's pulse
PWM_MAX: Final = 24000
# the learning robot's speed, m/s (table 5.2)
LEARNING_SPEED: Final = 0.3
# counts of steering for a difference of 1 count between a side and the mean, for sides at two speeds
SIDES: Final = 3.0
# counts at which the linkage is at its stop; beyond it the servo only draws current (4.3)
STEERING_MAX: Final = 18000
# the same as floats, which CPython compares with other floats quickly
PWM_LIMIT: Final = float(PWM_MAX)
STEERING_LIMIT: Final = float(STEERING_MAX)


@dataclass(frozen=True, slots=True)
class Geometry:
    """Lengths of the vehicle, in metres; a section of the configuration.

    The pose is that of a point midway between the axles, or on the rear axle if only the front wheels steer.
    """

    steering: Literal["both", "front", "skid"] = "both"
    """Steered wheels: both axles, as the TXT-1's; front; or skid: none steers, and the sides run at two speeds."""
    radius_min: Positive = 0.56
    """Minimum turning radius R_min, m (thesis 2.2.3); for sides at two speeds that of planned paths."""
    wheelbase: Length = 0.34
    """Distance between the axles, m; assumed."""
    track_width: Length = 0.25
    """Distance between the encoder wheels, m."""
    circumference: Length = 0.5125
    """Circumference of a tyre, m (thesis 3.7.1)."""
    counts_per_rev: Annotated[int, Ge(0)] = 1600
    """Encoder counts per wheel revolution: 400 CPR in quadrature; 0: no encoders."""
    length: Length = 0.510
    """Length of the body, m."""
    width: Length = 0.385
    """Width of the body, m."""
    centre: float = 0.0
    """Distance of the body's centre ahead of the pose, m."""

    @property
    def lever(self) -> float:
        """Distance of a steered axle from the pose, m."""
        return self.wheelbase if self.steering == "front" else 0.5 * self.wheelbase

    @property
    def tan_steering_max(self) -> float:
        """Tangent of the steering angle at full lock: (2.13) solved for R_min = v / omega."""
        return self.lever / self.radius_min

    @property
    def steering_max(self) -> float:
        """Steering angle phi_max at full lock, rad."""
        return math.atan(self.tan_steering_max)

    @property
    def count_length(self) -> float:
        """Distance a wheel rolls per encoder count, m; infinite without encoders."""
        return self.circumference / self.counts_per_rev if self.counts_per_rev else math.inf

    def curvature(self, share: float) -> float:
        """Return the curvature of the path, 1/m, at a share of the steering's range, 1 for full lock on the
        left: (2.13).
        """
        return math.tan(share * self.steering_max) / self.lever

    def steering_share(self, curvature: float) -> float:
        """Return the share of the steering's range, -1 to 1, for a curvature in 1/m: the inverse of `curvature`."""
        return min(max(math.atan(self.lever * curvature) / self.steering_max, -1.0), 1.0)


def sides(motor: float, steering: float) -> tuple[float, float]:
    """Return the counts of the right and the left side, for a vehicle whose sides run at two speeds.

    right = motor + steering / 3, left = motor - steering / 3, where the steering is `Outputs.rear`, left positive. The
    velocity loops, the speed map and the calibration count on this, so each hardware layer takes its sides from here.
    """
    return motor + steering * (1.0 / SIDES), motor - steering * (1.0 / SIDES)


def outputs_of(right: float, left: float) -> tuple[float, float]:
    """Return motor and steering, counts, for these sides: the inverse of `sides`."""
    return 0.5 * (right + left), 0.5 * SIDES * (right - left)
