"""Readings of a fast sensor that arrive together count as one, as their errors are independent.

So the filter has half the work (preintegration: T. Lupton, S. Sukkarieh, IEEE T-RO 28(1), 2012).
"""

from math import sqrt
from typing import Final

from txt1.estimation.ekf import THETA
from txt1.estimation.measurement import KIND_GYRO, Measurement
from txt1.model.kinematics import wrap_angle
from txt1.units import new

# s within which readings of a sensor are averaged that arrive together
SLOT: Final = 0.02
# the same of positions in time: the newest tells most of where the car is now
NEWEST: Final = 0.005
# s between readings of one instant, to which clocks and sums of times are rounded
SAME_INSTANT: Final = 1e-6


def alike(one: Measurement, two: Measurement, within: float) -> bool:
    """Whether two readings of a sensor may be averaged, within so many seconds."""
    time, _, kind, rows, _, _, at = one
    time_too, _, kind_too, rows_too, _, _, at_too = two
    return abs(time - time_too) < within - SAME_INSTANT and kind is kind_too and rows == rows_too and at == at_too


def averaged(mean: Measurement, count: int, more: Measurement) -> Measurement:
    """The mean of `count` readings and one more, with independent errors."""
    share = 1.0 / (count + 1)
    less = sqrt(1.0 - share)
    time, sensor, kind, rows, values, sigmas, at = mean
    time += share * (more.time - time)
    if kind is KIND_GYRO:
        (one,), (two,), (sigma,) = values, more.values, sigmas
        return new(Measurement, (time, sensor, kind, rows, (one + share * (two - one),), (less * sigma,), at))
    if rows == (0, 1, 2):
        (x, y, theta), (x_too, y_too, theta_too), (sigma_x, sigma_y, sigma_theta) = values, more.values, sigmas
        pose = x + share * (x_too - x), y + share * (y_too - y), theta + share * wrap_angle(theta_too - theta)
        wide = less * sigma_x, less * sigma_y, less * sigma_theta
        return new(Measurement, (time, sensor, kind, rows, pose, wide, at))
    means = [one + share * (two - one) for one, two in zip(values, more.values, strict=True)]
    if rows[-1] == THETA:
        means[-1] = values[-1] + share * wrap_angle(more.values[-1] - values[-1])
    return Measurement(time, sensor, kind, rows, tuple(means), tuple([less * sigma for sigma in sigmas]), at)
