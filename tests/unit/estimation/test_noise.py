"""The noise of a tracker that tells none is learned of its readings while the car drives."""

from math import cos, nan, sin

import numpy as np
import pytest

from txt1.estimation.sensors import SIGMAS, plan
from txt1.estimation.settings import FusedConfig
from txt1.sensors.base import Reading
from txt1.sensors.readings import TrackerReading

ASSUMED = tuple(SIGMAS[TrackerReading][each] for each in ("x", "y", "theta"))


def learned(noise: float, period: float, settings: FusedConfig | None = None, broken: int = -1) -> list[float]:
    """The sigmas (m, m, rad) after 10 s of full lock at 1 m/s, with noise in m, and in rad twice as much."""
    rng = np.random.default_rng(1)
    measure, sigmas = plan("vicon", TrackerReading, settings or FusedConfig()), ()
    for step in range(round(10.0 / period)):
        theta = 1.8 * step * period
        x, y, turned = 0.56 * sin(theta), 0.56 * (1.0 - cos(theta)), theta
        x, y = (each + noise * float(rng.normal()) for each in (x, y))
        half = 0.5 * (turned + 2.0 * noise * float(rng.normal()))
        seen = TrackerReading(nan if step == broken else x, y, 0.0, (0.0, 0.0, sin(half), cos(half)))
        sigmas = measure(Reading(step * period, seen))[0].sigmas
    return list(sigmas)


@pytest.mark.parametrize("noise", [0.001, 0.002, 0.005])
def test_its_noise_is_learned_within_a_tenth_also_after_a_reading_that_is_no_number(noise: float) -> None:
    for broken in (-1, 500):
        assert learned(noise, 0.01, broken=broken) == pytest.approx([noise, noise, 2.0 * noise], rel=0.12)


def test_a_tracker_that_repeats_itself_is_not_taken_for_exact() -> None:
    assert min(np.divide(learned(0.0, 0.01), ASSUMED)) == pytest.approx(0.25)


def test_a_slow_tracker_keeps_the_assumed_noise_for_the_car_s_own_motion() -> None:
    assert learned(0.001, 0.05) == list(ASSUMED)


def test_a_sigma_that_was_configured_stays() -> None:
    settings = FusedConfig(sigma={"x": 0.003, "y": 0.003})
    assert learned(0.001, 0.01, settings) == pytest.approx([0.003, 0.003, 0.002], rel=0.12)
