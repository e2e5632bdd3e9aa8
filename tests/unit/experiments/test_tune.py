"""Identification finds the vehicle it is shown, and tuning scales one loop over the whole schedule."""

from itertools import pairwise
from math import exp

import pytest

from txt1.control.pid import Gains
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, Schedule
from txt1.experiments.identify import HeldOutputs, Plant, identify, speed_response, yaw_response
from txt1.experiments.tune import angular_gains, linear_gains
from txt1.model.vehicle import Geometry

PLANT = Plant(0.00033, 300.0, 0.3, 9.4e-5, 0.03)
GEOMETRY = Geometry()


def hold(motor: int, steering: int, v: float, before_v: float, before_omega: float) -> HeldOutputs:
    """What an ideal vehicle does, mean speeds of every tick."""
    omega = PLANT.steering_gain * v * steering
    times = [0.02 * k for k in range(200)]
    return HeldOutputs(
        motor,
        steering,
        tuple(v + (before_v - v) * exp(-t / PLANT.time_constant) for t in times),
        tuple(omega + (before_omega - omega) * exp(-t / PLANT.steering_lag) for t in times),
    )


def test_the_vehicle_is_found_in_its_drive() -> None:
    holds = []
    for motor in (900, 1800, -900, -1800):
        v = PLANT.speed_gain * (abs(motor) - PLANT.dead_band) * (1 if motor > 0 else -1)
        holds += [hold(motor, 0, v, 0.0, 0.0), hold(0, 0, 0.0, v, 0.0)]
    v = PLANT.speed_gain * 1500.0
    holds.append(hold(1800, 0, v, 0.0, 0.0))
    omega = 0.0
    for steering in (6000, 0, -6000, 0):
        holds.append(hold(1800, steering, v, v, omega))
        omega = PLANT.steering_gain * v * steering
    found = identify(holds)
    assert found.speed_gain == pytest.approx(PLANT.speed_gain, rel=0.01)
    assert found.dead_band == pytest.approx(PLANT.dead_band, rel=0.02)
    assert found.time_constant == pytest.approx(PLANT.time_constant, abs=0.015)
    assert found.steering_gain == pytest.approx(PLANT.steering_gain, rel=0.01)
    assert found.steering_lag == pytest.approx(PLANT.steering_lag, abs=0.015)


def test_the_model_ends_at_the_set_points() -> None:
    speed = speed_response(PLANT, LINEAR_GAINS, 0.5, 4.0, GEOMETRY, 1, 8000)
    assert speed[-50:].mean() == pytest.approx(0.5, abs=0.01)
    yaw = yaw_response(PLANT, Gains(0.0, 130.0, 0.0), 0.5, 0.3, 0.4, 4.0, GEOMETRY, 1)
    assert yaw[0] == pytest.approx(0.3, abs=0.03)
    assert yaw[-50:].mean() == pytest.approx(0.4, abs=0.01)


@pytest.mark.long
def test_a_weaker_motor_gets_higher_gains() -> None:
    weaker = PLANT._replace(speed_gain=0.5 * PLANT.speed_gain)
    assert linear_gains(weaker, GEOMETRY, LINEAR_GAINS, 8000).kp > linear_gains(PLANT, GEOMETRY, LINEAR_GAINS, 8000).kp


@pytest.mark.long
def test_the_schedule_keeps_its_borders_and_its_loop_gain() -> None:
    sets = angular_gains(PLANT, GEOMETRY, Schedule(ANGULAR_GAINS))
    assert [each.v_max for each in sets] == [each.v_max for each in ANGULAR_GAINS]
    highest = [1.5, *(max(abs(a.v_max), abs(b.v_max)) for a, b in pairwise(sets[:-1])), 1.5]
    loop_gains = [v * each.gains.ki for v, each in zip(highest, sets, strict=True)]
    assert loop_gains == pytest.approx([loop_gains[0]] * 14, rel=1e-3)
