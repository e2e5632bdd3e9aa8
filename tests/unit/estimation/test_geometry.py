"""A car that is not as its file says: wheels further apart, a sensor at another place."""

from collections.abc import Callable
from math import cos, hypot, inf, sin
from typing import Any

import numpy as np
import pytest

from benchmarks.others_logs import scrubbing
from txt1.estimation.settings import EstimationConfig, FusedConfig
from txt1.estimation.task import ENCODERS, Estimator, Wheels
from txt1.model.estimate import Estimate
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import FixReading, ImuReading, Mount, TrackerReading

CYCLE = 0.02  # s
BIAS = 0.01  # rad/s
Told = Callable[[float, float, float, float], Reading[Any]]
"""A reading of a sensor of positions at a time and a pose (s, m, m, rad)."""


def drive(
    seconds: float,
    *,
    wider: float,
    positions: type | None = None,
    told: Told | None = None,
    track_sigma: float = 0.05,
    until: float = inf,
    other: float = 0.0,
    curve: float = 2.5,
    marked: bool = False,
    sigma: float | None = None,
) -> tuple[Estimator, Estimate, tuple[float, float, float]]:
    """The filter, its last estimate and the true pose after curves to both sides, with wheels so much wider apart.

    A curve lasts `curve` s; the gyro is heard until so many seconds. By 7.5 s in 15 the wheels seem to be by `other`
    wider apart, as they slip. `marked`: the pose at the start is told. `sigma`: of positions that tell none, m.
    """
    rng, name = np.random.default_rng(1), "place"
    kinds: dict[str, type] = {"imu": ImuReading} | ({name: positions} if positions else {})
    start = (0.0, 0.0, 0.0) if marked else None
    settings = {name: FusedConfig(sigma={"x": sigma, "y": sigma})} if sigma else {}
    config = EstimationConfig(sensors=(*kinds, ENCODERS), track_sigma=track_sigma, start=start, settings=settings)
    estimator = Estimator(config, kinds, Geometry(steering="front"))
    x = y = theta = omega = v = 0.0
    for cycle in range(1, round(seconds / CYCLE) + 1):
        now = cycle * CYCLE
        part = int(now / curve)
        asked, turn = (0.0, 0.0) if now < 2.0 else (0.4 + 0.3 * (part % 2), (0.9, -0.6, 0.0, -0.9, 0.6)[part % 5])
        v += float(np.clip(asked - v, -2.0 * CYCLE, 2.0 * CYCLE))
        omega += float(np.clip(turn - omega, -4.0 * CYCLE, 4.0 * CYCLE))
        middle = theta + 0.5 * omega * CYCLE
        x, y, theta = x + v * CYCLE * cos(middle), y + v * CYCLE * sin(middle), theta + omega * CYCLE
        for time in (now - 0.5 * CYCLE, now):
            rate = omega + BIAS + 0.006 * float(rng.normal())
            if now < until:
                estimator.take("imu", Reading(time, ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, rate))))
        if told is not None and cycle % 5 == 0:
            estimator.take(name, told(now, x + 0.02 * float(rng.normal()), y + 0.02 * float(rng.normal()), theta))
        rolled = v + 0.005 * float(rng.normal()) * (v > 0.0)
        turned = (1.0 + wider + other * (part // 3 % 2)) * omega + 0.03 * float(rng.normal()) * (v > 0.0)
        estimate = estimator.step(now, Wheels(Odometry(0.0, 0.0, 0.0, rolled, turned), now, None, asked))
    return estimator, estimate, (x, y, theta)


@pytest.mark.parametrize("wider", [-0.1, 0.1])
def test_wheels_further_apart_than_measured_tell_of_their_track_and_not_of_the_way(wider: float) -> None:
    estimator, estimate, (x, y, _) = drive(40.0, wider=wider)
    # 0.7 m and more, where the way was blamed
    assert hypot(estimate.x - x, estimate.y - y) < 0.1
    assert estimate.slip == pytest.approx(0.0, abs=0.01)
    share, sigma = estimator.fusion.track
    assert share == pytest.approx(wider, abs=0.02)
    assert sigma < 0.03


def test_a_track_that_seemed_to_change_beside_a_gyro_stays_in_doubt_without_it() -> None:
    def fix(now: float, x: float, y: float, theta: float) -> Reading[Any]:
        return Reading(now, FixReading(0.0, 0.0, x, y, sigma_x=1.0, sigma_y=1.0, mount=Mount(0.0, 0.0, 0.0)))

    _, estimate, (_, _, theta) = drive(56.0, wider=0.0, positions=FixReading, told=fix, until=44.0, other=0.15)
    # by 6 sigma, as if the last curve's track were that of all
    assert abs(wrap_angle(estimate.theta - theta)) < 3.0 * estimate.sigma(2)


def test_a_track_that_is_told_to_be_exact_stays_so() -> None:
    estimator, _, _ = drive(10.0, wider=0.0, track_sigma=0.0)
    assert estimator.fusion.track == (0.0, 0.0)


@pytest.mark.parametrize("scrub", [1.2, 1.9])
def test_a_robot_whose_wheels_scrub_as_it_turns_goes_as_far_as_they_roll(scrub: float) -> None:
    true, told, _ = scrubbing(scrub, 1, 30.0)
    assert told == pytest.approx(true, rel=0.02)


def test_rtk_30_cm_from_where_it_is_stated_is_found_and_stays_believed() -> None:
    def fix(now: float, x: float, y: float, theta: float) -> Reading[Any]:
        at = x + 0.3 * cos(theta), y + 0.3 * sin(theta)
        return Reading(now, FixReading(0.0, 0.0, *at, sigma_x=0.03, sigma_y=0.03, mount=Mount(0.0, 0.0, 0.0)))

    estimator, estimate, (x, y, _) = drive(60.0, wider=0.05, positions=FixReading, told=fix)
    assert all(each.believed for each in estimator.trusts())
    assert estimator.fusion.parameters("place")["x"].value == pytest.approx(0.3, abs=0.08)
    assert hypot(estimate.x - x, estimate.y - y) < 0.15


@pytest.mark.parametrize(
    ("ahead", "curve", "marked"), [(0.3, 2.0, False), (-0.3, 2.0, True), (0.3, 4.0, True), (-0.3, 6.0, False)]
)
def test_rtk_30_cm_off_is_believed_in_curves_of_2_to_6_s(ahead: float, curve: float, marked: bool) -> None:
    """In a curve its antenna goes another way than the car heads: that is no frame that moves."""

    def fix(now: float, x: float, y: float, theta: float) -> Reading[Any]:
        at = x + ahead * cos(theta), y + ahead * sin(theta)
        return Reading(now, FixReading(0.0, 0.0, *at, sigma_x=0.03, sigma_y=0.03, mount=Mount(0.0, 0.0, 0.0)))

    estimator, estimate, (x, y, theta) = drive(
        60.0, wider=0.0, positions=FixReading, told=fix, curve=curve, marked=marked
    )
    assert all(each.believed and each.rejected < 20 for each in estimator.trusts())
    assert hypot(estimate.x - x, estimate.y - y) < 0.05
    assert abs(wrap_angle(estimate.theta - theta)) < 0.04


def test_motion_capture_30_cm_from_where_it_is_stated_is_found() -> None:
    def seen(now: float, x: float, y: float, theta: float) -> Reading[Any]:
        half = 0.5 * theta
        at = x + 0.3 * cos(theta), y + 0.3 * sin(theta)
        return Reading(now, TrackerReading(*at, 0.0, (0.0, 0.0, sin(half), cos(half))))

    estimator, estimate, (x, y, _) = drive(30.0, wider=0.05, positions=TrackerReading, told=seen, sigma=0.02)
    assert all(each.believed for each in estimator.trusts())
    assert estimator.fusion.parameters("place")["x"].value == pytest.approx(0.3, abs=0.03)
    assert hypot(estimate.x - x, estimate.y - y) < 0.08
