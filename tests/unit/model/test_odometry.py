"""Odometry from two encoder wheels (thesis 2.3, 3.7.1)."""

from __future__ import annotations

from math import hypot, isfinite, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry, advance, body_velocity
from txt1.model.vehicle import Geometry

BODY = Geometry()
ANY = st.floats(-3.0, 3.0)


def wheel_speed(ticks: int, dt: float) -> float:
    """Return the speed of wheels that both turn as far, m/s."""
    return body_velocity(ticks, ticks, dt, BODY.count_length, BODY.track_width)[0]


def test_one_tick_at_50_hz_is_16_mm_per_s_of_wheel_and_64_mrad_per_s_of_yaw() -> None:
    assert BODY.count_length == 0.5125 / 1600
    assert wheel_speed(1, 0.02) == pytest.approx(0.01602, abs=5e-6)
    v, omega = body_velocity(1, 0, 0.02, BODY.count_length, BODY.track_width)
    assert v == pytest.approx(0.00801, abs=5e-6)
    assert omega == pytest.approx(0.064, abs=1e-4)


@given(st.integers(-1000, 1000), st.integers(-1000, 1000))
def test_speed_is_the_mean_of_the_wheels_and_yaw_rate_their_difference_over_w(right: int, left: int) -> None:
    v_right, v_left = wheel_speed(right, 0.02), wheel_speed(left, 0.02)
    v, omega = body_velocity(right, left, 0.02, BODY.count_length, 0.25)
    assert v + omega * 0.125 == pytest.approx(v_right, abs=1e-12)
    assert v - omega * 0.125 == pytest.approx(v_left, abs=1e-12)
    assert (omega > 0) == (right > left), "the right wheel runs ahead in a left turn"


def test_a_wheel_that_turned_once_rolled_its_circumference() -> None:
    assert wheel_speed(1600, 1.0) == pytest.approx(0.5125)
    assert wheel_speed(-1600, 0.5) == pytest.approx(-1.025)


@given(st.floats(0.05, 1.5), st.floats(0.05, 2.0), st.sampled_from([-1, 1]), st.sampled_from([-1, 1]), ANY)
def test_a_lap_brings_odometry_back(v: float, omega: float, ahead: int, side: int, theta: float) -> None:
    odometry = Odometry(1.0, 2.0, theta)
    for _ in range(60):
        odometry = advance(odometry, ahead * v, side * omega, 2 * pi / omega / 60)
    assert hypot(odometry.x - 1.0, odometry.y - 2.0) < 1e-9
    assert abs(wrap_angle(odometry.theta - theta)) < 1e-9
    assert (odometry.v, odometry.omega) == (ahead * v, side * omega)


@given(ANY, st.floats(-1e3, 1e3), ANY)
def test_turning_on_the_spot_moves_only_the_heading(theta: float, omega: float, x: float) -> None:
    odometry = advance(Odometry(x, 0.5, theta), 0.0, omega, 0.02)
    assert (odometry.x, odometry.y) == (x, 0.5)
    assert -pi < odometry.theta <= pi
    assert abs(wrap_angle(odometry.theta - theta - omega * 0.02)) < 1e-12


@given(
    st.one_of(ANY, st.floats(-1e-300, 1e-300), st.floats(-1e-12, 1e-12)),
    st.floats(-100.0, 100.0),
    st.floats(0.001, 1.0),
)
def test_no_velocity_however_small_upsets_odometry(v: float, omega: float, dt: float) -> None:
    odometry = advance(Odometry(), v, omega, dt)
    assert all(map(isfinite, odometry))
    assert hypot(odometry.x, odometry.y) <= abs(v) * dt * (1 + 1e-9)
    assert -pi < odometry.theta <= pi
    assert abs(wrap_angle(odometry.theta - omega * dt)) < 1e-9


@given(st.floats(-1.5, 1.5), st.floats(-2.0, 2.0), st.floats(0.01, 1.0))
def test_driving_back_the_same_way_undoes_it(v: float, omega: float, dt: float) -> None:
    there = advance(Odometry(), v, omega, dt)
    back = advance(there, -v, -omega, dt)
    assert (back.x, back.y, back.theta) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
