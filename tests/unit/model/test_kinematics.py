"""Kinematics (thesis 2.1, 2.2): angles, yaw rates and arcs."""

from __future__ import annotations

from math import atan, cos, hypot, isclose, isfinite, pi, sin, tan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.model.kinematics import move_along_arc, wrap_angle, yaw_rate_max
from txt1.model.vehicle import Geometry

ANGLE = st.floats(-1e4, 1e4)
STEERING = st.floats(-0.5, 0.5)
SPEED = st.floats(-2.0, 2.0)
BODY = Geometry()


@given(ANGLE)
def test_a_wrapped_angle_points_the_same_way_and_lies_in_the_half_open_circle(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -pi < wrapped <= pi
    assert wrap_angle(wrapped) == wrapped
    assert hypot(cos(wrapped) - cos(angle), sin(wrapped) - sin(angle)) < 1e-11


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(pi, pi), (-pi, pi), (3 * pi, pi), (-3 * pi, pi), (0.0, 0.0), (2 * pi, 0.0), (1.0, 1.0)]
)
def test_the_seam_of_the_circle_belongs_to_plus_pi(angle: float, wrapped: float) -> None:
    assert wrap_angle(angle) == wrapped


def test_full_lock_drives_the_circle_of_r_min() -> None:
    assert BODY.radius_min == 0.56
    omega = 2 * 0.5 * tan(BODY.steering_max) / BODY.wheelbase  # (2.13)
    assert isclose(0.5 / omega, 0.56, rel_tol=1e-12)
    assert isclose(omega, yaw_rate_max(0.5, 0.56), rel_tol=1e-12)
    assert isclose(BODY.steering_max, atan(0.34 / 1.12))


def test_at_standstill_nothing_turns() -> None:
    assert yaw_rate_max(0.0, 0.56) == 0.0
    assert yaw_rate_max(-0.56, 0.56) == yaw_rate_max(0.56, 0.56) == 1.0


@given(ANGLE, st.floats(0.3, 10.0), st.sampled_from([-1.0, 1.0]), STEERING, st.integers(1, 100))
def test_a_lap_closes(theta: float, radius: float, side: float, beta: float, steps: int) -> None:
    x, y, heading = 1.0, -2.0, wrap_angle(theta)
    for _ in range(steps):
        x, y, heading = move_along_arc(x, y, heading, 2 * pi * radius / steps, side / radius, beta)
    assert hypot(x - 1.0, y + 2.0) < 1e-9
    assert abs(wrap_angle(heading - theta)) < 1e-9


def test_a_quarter_of_a_left_circle_ends_one_radius_ahead_and_one_to_the_left() -> None:
    x, y, theta = move_along_arc(0.0, 0.0, 0.0, pi / 2 * 0.56, 1 / 0.56, 0.0)
    assert (x, y, theta) == pytest.approx((0.56, 0.56, pi / 2), abs=1e-12)


@given(ANGLE, st.floats(-1.0, 1.0), STEERING)
def test_without_curvature_the_path_is_straight_along_heading_plus_sideslip(
    theta: float, distance: float, beta: float
) -> None:
    theta = wrap_angle(theta)
    x, y, heading = move_along_arc(0.0, 0.0, theta, distance, 0.0, beta)
    assert (x, y) == pytest.approx((distance * cos(theta + beta), distance * sin(theta + beta)), abs=1e-15)
    assert heading == theta


@given(st.floats(-1.0, 1.0), st.floats(-4e-4, 4e-4))
def test_small_curvatures_join_the_straight_line_smoothly(distance: float, curvature: float) -> None:
    # Taylor's series of the arc; across the switch from series to sine nothing jumps
    x, y, theta = move_along_arc(0.0, 0.0, 0.0, distance, curvature, 0.0)
    turn = distance * curvature
    assert x == pytest.approx(distance * (1 - turn**2 / 6), rel=1e-14, abs=1e-300)
    assert y == pytest.approx(distance * turn / 2 * (1 - turn**2 / 12), rel=1e-12, abs=1e-18)
    assert theta == turn


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), STEERING)
def test_an_arc_in_two_pieces_is_the_same_arc(first: float, second: float, curvature: float, beta: float) -> None:
    whole = move_along_arc(0.0, 0.0, 0.3, first + second, curvature, beta)
    half = move_along_arc(0.0, 0.0, 0.3, first, curvature, beta)
    parts = move_along_arc(*half, second, curvature, beta)
    assert hypot(whole[0] - parts[0], whole[1] - parts[1]) < 1e-12
    assert abs(wrap_angle(whole[2] - parts[2])) < 1e-12
    assert all(map(isfinite, parts))
