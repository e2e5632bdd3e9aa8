"""The pose and the velocities, estimated from all sensors."""

from math import sqrt
from typing import NamedTuple


class Estimate(NamedTuple):
    """The robot's pose and velocities, estimated from all sensors."""

    x: float  # m
    y: float  # m
    # rad in (-pi, pi]
    theta: float
    v: float  # m/s
    omega: float  # rad/s
    # covariance of these five, row by row
    covariance: tuple[float, ...]
    # bias of the gyro, rad/s
    bias: float
    # slip: share of the wheels' distance that the vehicle does not move
    slip: float
    # whether the pose is in the frame of the sensors that measure a pose; otherwise it starts at 0
    located: bool

    def sigma(self, place: int) -> float:
        """Return the standard deviation of the value at `place`, one of the five."""
        return sqrt(max(self.covariance[6 * place], 0.0))
