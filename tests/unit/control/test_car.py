"""Loops that know the car hold the speed and the curve that were asked for; the thesis's trust the encoders."""

from math import atan, cos, hypot, tan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.config import load
from txt1.control.car import true_velocity
from txt1.hal.registry import create_sim
from txt1.learning.env import Car
from txt1.model.vehicle import Geometry

BODY = Geometry()


@given(v=st.floats(-1.5, 1.5).filter(lambda v: abs(v) > 1e-3), curvature=st.floats(-1.7, 1.7))
def test_the_cars_velocities_follow_from_what_its_steered_front_wheels_tell(v: float, curvature: float) -> None:
    phi = atan(0.5 * curvature * BODY.wheelbase)
    told_v = v * (cos(phi) + 0.5 * curvature * BODY.wheelbase * tan(phi) * cos(phi))
    told_omega = v * curvature * cos(phi)
    assert true_velocity(told_v, told_omega, BODY.wheelbase) == pytest.approx((v, v * curvature), rel=1e-9, abs=1e-12)


def driven(known: bool, omega: float, seconds: float) -> tuple[float, float]:
    """Distance along the path after so many seconds at 0.3 m/s from rest, m, and the true speed at the end, m/s."""
    config = load(None, [f"car.known={str(known).lower()}", "sim.noise.drag=0", "sim.room.length=.inf"]).config
    car = Car(create_sim(config), config)
    car.command = (0.3, omega)
    path, last, speed = 0.0, car.pose(0.0), 0.0
    for tick in range(round(seconds * 50)):
        now = tick / 50
        car.control(now)
        pose = car.pose(now)
        step = hypot(pose[0] - last[0], pose[1] - last[1])
        path, last, speed = path + step, pose, 50.0 * step
    return path, speed


def test_a_car_that_its_loops_know_runs_up_sooner() -> None:
    assert driven(True, 0.0, 1.0)[0] > driven(False, 0.0, 1.0)[0] + 0.02


def test_and_keeps_its_true_speed_in_the_sharpest_turn() -> None:
    sharpest = 0.3 / BODY.radius_min
    assert driven(True, sharpest, 4.0)[1] == pytest.approx(0.3, abs=0.002)
    assert driven(False, sharpest, 4.0)[1] == pytest.approx(0.287, abs=0.003), "as the thesis's loops do"
