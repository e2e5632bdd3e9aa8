"""Wheels and gyro beside one another: what a turn, and standing still, tells of the gyro's bias."""

from collections.abc import Callable

import numpy as np

from txt1.estimation.settings import EstimationConfig
from txt1.estimation.task import Estimator, Wheels
from txt1.model.estimate import Estimate
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import ImuReading

BIAS = 0.01  # rad/s
NOISE = 0.006  # rad/s
CYCLE = 0.02  # s
LARGEST = 0.001  # rad/s


def missed(
    seconds: float,
    rate: Callable[[float], float],
    *,
    v: float = 0.5,
    late: float = 0.0,
    slip: Callable[[float], float] = lambda _: 0.0,
    sensors: tuple[str, ...] = ("imu", "encoders"),
) -> list[tuple[float, float]]:
    """By how much the bias is missed (rad/s), and the heading (of its sigma), in each cycle.

    With a yaw rate (rad/s) and a slip over time, and a late gyro (s).
    """
    rng = np.random.default_rng(1)
    car = Geometry(steering="front")
    kinds = {each: ImuReading for each in sensors if each == "imu"}
    estimator = Estimator(EstimationConfig(sensors=sensors), kinds, car)
    found, theta = [], 0.0
    for cycle in range(1, round(seconds / CYCLE) + 1):
        now = cycle * CYCLE
        for time in (now - 0.5 * CYCLE, now):
            told = rate(time - late) + BIAS + NOISE * float(rng.normal())
            if kinds:
                estimator.take("imu", Reading(time, ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, told))))
        omega = rate(now - 0.5 * CYCLE) / (1.0 - slip(now))
        # readings that are all the same would be those of a broken sensor
        wheels = Wheels(Odometry(0.0, 0.0, 0.0, v + 1e-9 * (v > 0.0) * (cycle % 2), omega), now, None, v)
        theta += CYCLE * rate(now - 0.5 * CYCLE)
        estimate = estimator.step(now, wheels)
        found.append((estimate.bias - BIAS, wrap_angle(estimate.theta - theta) / estimate.sigma(2)))
    return found


def test_a_car_that_stands_tells_the_gyros_bias_as_well_as_the_gyros_noise_lets_it() -> None:
    mean = NOISE / np.sqrt(100.0 * 3.0)
    assert abs(missed(4.0, lambda _: 0.0, v=0.0)[-1][0]) < 4.0 * mean


def test_a_gyro_that_is_late_by_half_its_period_seems_to_have_little_bias_besides() -> None:
    # it stands, then turns to one side and the other: a late clock makes each change of side look like a bias
    turns = lambda time: 0.0 if time < 5.0 else 1.2 if int(time / 1.7) % 2 else -1.2  # noqa: E731
    apart = np.subtract(missed(20.0, turns, late=0.005), missed(20.0, turns))[:, 0]
    assert np.abs(apart).max() < LARGEST


def test_slip_that_begins_in_the_second_curve_is_not_surely_a_gyros_bias() -> None:
    turns = lambda time: 1.0 if time < 2.5 else -0.35  # noqa: E731
    found = missed(8.0, turns, slip=lambda time: 0.15 if time > 2.5 else 0.0)
    assert max(abs(heading) for _, heading in found) < 3.0


def test_wheels_alone_that_slip_in_left_curves_only_do_not_make_the_heading_sure() -> None:
    turns = lambda time: 1.0 if int(time) % 2 else -1.0  # noqa: E731
    found = missed(12.0, turns, slip=lambda time: 0.1 * (int(time) % 2), sensors=("encoders",))
    assert max(abs(heading) for _, heading in found[100:]) < 3.0


def wheels_alone(
    seconds: float, turned: Callable[[float], float], *, slip: float
) -> tuple[Estimate, tuple[float, float]]:
    """The estimate after wheels that slip told 1 m/s and a yaw rate (rad/s) over time, and the true place, m."""
    estimator, (x, y, theta) = (
        Estimator(EstimationConfig(sensors=("encoders",)), {}, Geometry(steering="front")),
        (0.0,) * 3,
    )
    for cycle in range(1, round(seconds / CYCLE) + 1):
        now = cycle * CYCLE
        omega = turned(now)
        estimate = estimator.step(now, Wheels(Odometry(0.0, 0.0, 0.0, 1.0, omega + 1e-9 * (cycle % 2)), now, None, 1.0))
        way, turn = (1.0 - slip) * CYCLE, (1.0 - slip) * omega * CYCLE
        x, y, theta = x + way * np.cos(theta + 0.5 * turn), y + way * np.sin(theta + 0.5 * turn), theta + turn
    return estimate, (x, y)


def test_a_place_on_the_arc_of_an_uncertain_heading_is_expected() -> None:
    # three circles, then straight on: the heading is off by one standard deviation, and the place on an arc
    estimate, (x, y) = wheels_alone(38.0, lambda time: 1.0 if time < 6.0 * np.pi else 0.0, slip=0.05)
    spread, error = np.reshape(estimate.covariance, (5, 5))[:2, :2], np.array([estimate.x - x, estimate.y - y])
    assert abs(error[0]) > 3.0  # m, along the way by the wheels
    assert error @ np.linalg.solve(spread, error) < 5.99


def test_wheels_alone_do_not_know_less_of_their_slip_than_at_first() -> None:
    (early, _), (late, _) = (wheels_alone(seconds, lambda _: 0.0, slip=0.0) for seconds in (1.0, 60.0))
    assert late.sigma(3) < 1.01 * early.sigma(3)


def test_wheels_that_stand_still_in_a_curve_outvote_no_gyro_and_teach_it_no_bias() -> None:
    rng, car = np.random.default_rng(1), Geometry(steering="front")
    estimator = Estimator(EstimationConfig(sensors=("imu", "encoders")), {"imu": ImuReading}, car)
    v, omega = 0.5, 0.7
    counts = STEERING_MAX * np.arctan(omega / v * car.lever) / car.steering_max
    theta, biases = 0.0, []
    for cycle in range(1, round(20.0 / CYCLE) + 1):
        now = cycle * CYCLE
        # from 10 s on, when another speed is asked for, the wheels tell the curve that ended then
        rate, shaken, asked = (omega, 1e-9 * (cycle % 2), v) if now <= 10.0 else (0.0, 0.0, 0.6)
        for time in (now - 0.5 * CYCLE, now):
            told = rate + BIAS + NOISE * float(rng.normal())
            estimator.take("imu", Reading(time, ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, told))))
        theta += CYCLE * rate
        estimate = estimator.step(now, Wheels(Odometry(0.0, 0.0, 0.0, v + shaken, omega), now, counts, asked))
        biases.append(estimate.bias)
    assert {each.name: each.believed for each in estimator.trusts()} == {"imu": True, "encoders": False}
    assert abs(biases[-1] - biases[499]) < LARGEST
    assert abs(wrap_angle(estimate.theta - theta)) < 3.0 * estimate.sigma(2)


def test_a_car_that_stands_for_a_minute_learns_no_slip_from_the_gyros_noise() -> None:
    rng, estimator = (
        np.random.default_rng(1),
        Estimator(EstimationConfig(sensors=("imu", "encoders")), {"imu": ImuReading}, Geometry(steering="front")),
    )
    slips = []
    for cycle in range(1, round(80.0 / CYCLE) + 1):
        now = cycle * CYCLE
        v, rate = (0.5, 0.7) if now < 18.0 else (0.0, 0.0)
        for time in (now - 0.5 * CYCLE, now):
            told = rate + BIAS + NOISE * float(rng.normal())
            estimator.take("imu", Reading(time, ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, told))))
        wheels = Odometry(0.0, 0.0, 0.0, v / 0.9 + 1e-9 * (v > 0.0) * (cycle % 2), rate / 0.9)
        slips.append(estimator.step(now, Wheels(wheels, now, None, v)).slip)
    assert np.abs(np.subtract(slips[-1], slips[round(20.0 / CYCLE)])) < 0.01
