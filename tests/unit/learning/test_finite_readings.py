"""No learner sees a reading that is no number."""

from __future__ import annotations

from math import inf, isfinite, nan

import numpy as np
import pytest

from txt1.config import load
from txt1.errors import LightFault
from txt1.learning.finite_readings import DARK_AFTER, FiniteReadings
from txt1.learning.registry import LEARNERS, make
from txt1.learning.trial import Start, Trial, task_of
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1.sensors.light import eyes

GOOD = Readings(10.0, 20.0, 30.0, 40.0)
SAMPLE = 0.016


def test_numbers_pass_as_they_are() -> None:
    assert FiniteReadings().readings(0.0, GOOD) is GOOD


@pytest.mark.parametrize("bad", [nan, inf, -inf, -1.0])
def test_a_reading_that_is_no_number_now_and_then_repeats_the_last_number(bad: float) -> None:
    gate = FiniteReadings()
    gate.readings(0.0, GOOD)
    assert gate.readings(SAMPLE, Readings(11.0, bad, 31.0, 41.0)) == (11.0, 20.0, 31.0, 41.0)
    assert gate.fault == ""


def test_a_sensor_that_stays_silent_is_dark_and_all_four_are_refused() -> None:
    gate = FiniteReadings()
    gate.readings(0.0, GOOD)
    assert gate.readings(DARK_AFTER + SAMPLE, GOOD._replace(front_right=nan)) == (10.0, 0.0, 30.0, 40.0)
    assert gate.fault == "light sensor FR reads nan, which is no reading"
    gate.readings(DARK_AFTER + 2 * SAMPLE, GOOD)
    assert gate.fault == ""
    with pytest.raises(LightFault, match=r"FL reads nan.*RR reads nan"):
        gate.readings(2.0 * DARK_AFTER + 3 * SAMPLE, Readings(nan, nan, nan, nan))


def test_before_the_first_number_nothing_is_passed() -> None:
    gate = FiniteReadings()
    assert gate.readings(0.0, GOOD._replace(rear_left=nan)) is None
    assert gate.readings(DARK_AFTER + SAMPLE, GOOD._replace(rear_left=nan)) == (10.0, 20.0, 0.0, 40.0)


def test_odometry_that_is_no_number_repeats_the_last() -> None:
    gate = FiniteReadings()
    there = Odometry(1.0, 2.0, 0.5, 0.3, 0.0)
    assert gate.odometry(there) is there
    assert gate.odometry(there._replace(v=nan)) is there
    assert gate.odometry(there._replace(x=inf)) is there


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.long) if each == "pilot" else each for each in LEARNERS.names()]
)  # which is compiled
def test_every_learner_survives_readings_that_are_no_numbers(name: str) -> None:
    """2 % of the readings are NaN or infinite, over two episodes on a circle."""
    config = load(None, ()).config
    rng = np.random.default_rng(7)
    trial = Trial(make(name, config, rng), task_of(config), [Start(0.0, 0.0), Start(1.0, 2.0)])
    seen: list[float] = []
    real = trial.agent.see

    def see(readings: Readings, odometry: Odometry) -> None:
        seen.extend((*readings, *odometry))
        real(readings, odometry)

    trial.agent.see = see  # type: ignore[method-assign]
    look = eyes(config, rng)
    now, lost = 0.0, 0
    for _ in range(2):
        trial.placed(now)
        for k in range(250):
            now += SAMPLE
            angle = 0.02 * k
            lux = np.array(look((np.sin(angle) + 1.2, 1.0 - np.cos(angle), angle)))
            bad = rng.random(4) < 0.02
            lost += int(bad.sum())
            lux[bad] = rng.choice([nan, inf])
            odometry = Odometry(np.sin(angle), 1.0 - np.cos(angle), angle, 0.3, 0.3)
            if rng.random() < 0.02:
                odometry = odometry._replace(omega=nan)
            trial.see(now, Readings(*lux.tolist()), odometry)
            if k % 3 == 0:
                trial.tick(now, True, (2.0, 0.0, 0.0), odometry)
        trial.agent.end(True, odometry)
    assert lost > 20
    assert all(map(isfinite, seen))
