"""The pose and the velocities as all sensors together tell them."""

from math import sqrt
from typing import NamedTuple


class Estimate(NamedTuple):
    """The robot's pose and velocities, by all sensors together."""

    x: float  # m
    y: float  # m
    # rad in (-pi, pi]
    theta: float
    v: float  # m/s
    omega: float  # rad/s
    # of these five, row by row
    covariance: tuple[float, ...]
    # of the gyro, rad/s
    bias: float
    # share of the wheels' way that the ground does not see
    slip: float
    # whether the pose is in the frame of the sensors that tell one; else it is from where it began
    located: bool

    def sigma(self, place: int) -> float:
        """The standard deviation of one of the five."""
        return sqrt(max(self.covariance[6 * place], 0.0))
