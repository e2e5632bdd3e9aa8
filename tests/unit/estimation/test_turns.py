"""Wheels and gyro beside one another: what a turn, and standing still, tells of the gyro's bias."""

from collections.abc import Callable

import numpy as np

from txt1.estimation.settings import EstimationConfig
from txt1.estimation.task import Estimator, Wheels
from txt1.model.odometry import Odometry
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import ImuReading

BIAS = 0.01  # rad/s
NOISE = 0.006  # rad/s
CYCLE = 0.02  # s
LARGEST = 0.001  # rad/s


def missed(seconds: float, rate: Callable[[float], float], *, v: float = 0.5, late: float = 0.0) -> list[float]:
    """By how much the bias is missed (rad/s) in each cycle, with a yaw rate (rad/s) over time and a late gyro (s)."""
    rng = np.random.default_rng(1)
    car = Geometry(steering="front")
    estimator = Estimator(EstimationConfig(sensors=("imu", "encoders")), {"imu": ImuReading}, car)
    found = []
    for cycle in range(1, round(seconds / CYCLE) + 1):
        now = cycle * CYCLE
        for time in (now - 0.5 * CYCLE, now):
            told = rate(time - late) + BIAS + NOISE * float(rng.normal())
            estimator.take("imu", Reading(time, ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, told))))
        omega = rate(now - 0.5 * CYCLE)
        wheels = Wheels(Odometry(0.0, 0.0, 0.0, v, omega), now, None, v, None)
        found.append(estimator.step(now, wheels).bias - BIAS)
    return found


def test_a_car_that_stands_tells_the_gyros_bias_as_well_as_the_gyros_noise_lets_it() -> None:
    mean = NOISE / np.sqrt(100.0 * 3.0)
    assert abs(missed(4.0, lambda _: 0.0, v=0.0)[-1]) < 4.0 * mean


def test_a_gyro_that_is_late_by_half_its_period_seems_to_have_little_bias_besides() -> None:
    # it stands, then turns to one side and the other: a late clock makes each change of side look like a bias
    turns = lambda time: 0.0 if time < 5.0 else 1.2 if int(time / 1.7) % 2 else -1.2  # noqa: E731
    apart = np.subtract(missed(20.0, turns, late=0.005), missed(20.0, turns))
    assert np.abs(apart).max() < LARGEST
