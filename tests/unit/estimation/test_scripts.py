"""The filter under random scripts of readings: whatever comes, its estimate is a number and its covariance one."""

import os
from math import nan, pi
from typing import Any

import numpy as np
import pytest
from numpy.random import Generator

from tests.examples import some
from txt1.estimation.settings import PRESETS, EstimationConfig
from txt1.estimation.task import Estimator, Wheels
from txt1.model.odometry import Odometry
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import FixReading, ImuReading, TrackerReading

PARTS = 12
SCRIPTS = int(os.environ.get("TXT1_SCRIPTS", "120"))
"""How many; the long test has 10 000."""
KINDS: dict[str, type] = {"imu": ImuReading, "gps": FixReading, "vicon": TrackerReading}
CARS = (Geometry(), Geometry(steering="skid"), Geometry(steering="front"), Geometry(counts_per_rev=0))


def reading(rng: Generator, name: str, time: float, pose: tuple[float, float, float]) -> Reading[Any]:
    """A reading: often right, sometimes far off, now and then no number."""
    x, y, theta = (each + float(rng.normal()) * 10.0 ** float(rng.uniform(-4, 2)) for each in pose)
    if rng.random() < 0.03:
        x = nan
    if name == "imu":
        return Reading(time, ImuReading((0.0, 0.0, 9.81), (0.0, 0.0, x if rng.random() < 0.5 else theta)))
    if name == "gps":
        sigma = None if rng.random() < 0.3 else 10.0 ** float(rng.uniform(-3, 2))
        return Reading(time, FixReading(0.0, 0.0, x, y, sigma_x=sigma, sigma_y=sigma))
    seen = (0.0, 0.0, float(np.sin(0.5 * theta)), float(np.cos(0.5 * theta)))
    return Reading(time, TrackerReading(x, y, 0.0, seen))


def script(seed: int) -> None:
    """One script: a car, a preset, rates, ages, drop-outs and jumps of its own."""
    rng = np.random.default_rng(seed)
    names = PRESETS[("encoders", "gyro", "imu-gps", "vicon")[rng.integers(4)]]
    if rng.random() < 0.3:
        names = ("imu", "encoders", "gps", "vicon")
    kinds = {each: KINDS[each] for each in names if each in KINDS}
    estimator = Estimator(EstimationConfig(sensors=names), kinds, CARS[rng.integers(len(CARS))])
    pose = (float(rng.normal()) * 10.0, float(rng.normal()) * 10.0, float(rng.uniform(-pi, pi)))
    now, v, omega, steering = 0.0, 0.0, 0.0, 0.0
    chances = {each: float(rng.random()) for each in kinds}
    for _ in range(int(rng.integers(20, 120))):
        # also cycles that were missed, and clocks that stand still
        now += 0.02 * float(rng.choice([1.0, 1.0, 1.0, 0.0, 3.0, 40.0]))
        if rng.random() < 0.1:
            v, omega = float(rng.uniform(-3.0, 3.0)), float(rng.uniform(-6.0, 6.0))
            steering = float(rng.uniform(-24000.0, 24000.0))
        if rng.random() < 0.02:
            pose = (pose[0] + float(rng.normal()) * 10.0, pose[1], pose[2] + float(rng.normal()))
        for each, chance in chances.items():
            for _ in range(int(rng.integers(1, 4))):
                if rng.random() < chance:
                    age = float(rng.choice([0.0, 0.01, 0.05, 0.3, 2.0, -0.1]))
                    estimator.take(each, reading(rng, each, now - age, pose))
        wheels = Wheels(Odometry(0.0, 0.0, 0.0, v, omega), now, steering, v)
        estimate = estimator.step(now, wheels)
        assert estimator.failure == ""
        covariance = np.reshape(estimate.covariance, (5, 5))
        assert np.isfinite(estimate[:5]).all()
        assert np.isfinite(covariance).all()
        assert (covariance == covariance.T).all()
        scale = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
        assert (np.diag(covariance) > 0.0).all()
        assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > -1e-6, "but for rounding"


@pytest.mark.parametrize("part", some(0, rest=range(1, PARTS)))
def test_any_script_leaves_numbers_and_a_covariance(part: int) -> None:
    for seed in range(part, SCRIPTS, PARTS):
        script(seed)


@pytest.mark.long
@pytest.mark.parametrize("part", range(8))
def test_ten_thousand_scripts_leave_numbers_and_a_covariance(part: int) -> None:
    for seed in range(1000 + part, 11_000, 8):
        script(seed)
