"""The robot on a stretch of path: where it is, how far off, and how it comes back; and what its wheels tell."""

from math import cos, hypot, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.pid import Gains
from txt1.control.schedule import ANGULAR_GAINS, GainSet, Schedule
from txt1.model.kinematics import move_along_arc
from txt1.model.reeds_shepp import Segment
from txt1.model.vehicle import Geometry
from txt1.navigation.goto import FOLLOWS_WITHIN, Stretch, curve_speed, steering_distance
from txt1.navigation.pose_source import encoders_view, step_between, straighten
from txt1.navigation.waypoints import aim, curvature_towards, speed_in_curve

START = (0.3, -0.2, 0.7)
GEOMETRY = Geometry()
THESIS = Schedule(ANGULAR_GAINS)
gears = st.sampled_from((1.0, -1.0))


def stretch(gear: float) -> Stretch:
    return Stretch(START, (Segment(1.5, gear * 0.5), Segment(0.0, gear * 0.4), Segment(-1.5, gear * 0.3)))


@given(gears, st.floats(0.0, 1.2), st.floats(-0.1, 0.1))
def test_a_pose_beside_the_path_is_abreast_of_its_place(gear: float, driven: float, off: float) -> None:
    on = stretch(gear)
    (x, y, theta), _ = on.at(driven)
    pose = (x - off * sin(theta), y + off * cos(theta), theta + 0.1)
    found = on.nearest(pose, driven - 0.02)
    assert found == pytest.approx(driven, abs=1e-3)
    lateral, heading = on.errors(pose, found)
    assert lateral == pytest.approx(off, abs=1e-3)
    assert heading == pytest.approx(0.1, abs=5e-3)


@given(gears, st.floats(-0.1, 0.1), st.floats(-0.3, 0.3))
def test_the_steering_brings_it_back_in_either_gear(gear: float, off: float, turned: float) -> None:
    line = Stretch((0.0, 0.0, 0.0), (Segment(0.0, gear * 10.0),))
    pose, driven = (0.0, off, turned), 0.0
    for _ in range(300):  # 1.5 m
        driven = line.nearest(pose, driven)
        pose = move_along_arc(*pose, gear * 0.005, line.steer(pose, driven, 0.0), 0.0)
    assert abs(pose[1]) < 0.02 + 0.05 * abs(off)
    assert abs(pose[2]) < 0.05


def test_it_goes_straight_on_beyond_its_ends() -> None:
    on = stretch(1.0)
    (x, y, _), _ = on.at(on.length + 0.2)
    assert hypot(x - on.end[0], y - on.end[1]) == pytest.approx(0.2)
    assert on.bends(0.0, 0.1)
    assert not on.bends(0.55, 0.85)


@given(st.floats(-1.0 / 0.56, 1.0 / 0.56), st.floats(0.01, 0.2), gears)
def test_the_wheels_path_is_straightened_to_the_centres(curvature: float, distance: float, gear: float) -> None:
    v, omega = encoders_view(gear * distance, curvature, GEOMETRY)
    centre, turn = straighten(v, omega, GEOMETRY)
    assert centre == pytest.approx(gear * distance, rel=1e-6)
    assert turn == pytest.approx(gear * distance * curvature, abs=1e-6)


def test_at_full_lock_the_encoders_are_4_per_cent_off_either_way() -> None:
    v, omega = encoders_view(1.0, 1.0 / GEOMETRY.radius_min, GEOMETRY)
    assert v == pytest.approx(1.045, abs=0.001)
    assert omega * GEOMETRY.radius_min == pytest.approx(0.957, abs=0.001)


@given(st.floats(-3.0, 3.0), st.floats(-0.1, 0.1), st.floats(-2.0, 2.0))
def test_the_step_between_two_poses_is_the_arc_that_joins_them(theta: float, distance: float, curvature: float) -> None:
    before = (0.5, 0.5, theta)
    found, turn = step_between(before, move_along_arc(*before, distance, curvature, 0.0))
    assert found == pytest.approx(distance, abs=1e-9)
    assert turn == pytest.approx(distance * curvature, abs=1e-9)


def test_with_the_thesis_gains_steering_is_close_forward_and_loose_backward() -> None:
    assert steering_distance(0.3, THESIS, GEOMETRY) < FOLLOWS_WITHIN < steering_distance(-0.3, THESIS, GEOMETRY)
    assert curve_speed(0.4, 1.0, THESIS, GEOMETRY) == 0.4
    assert curve_speed(0.4, -1.0, THESIS, GEOMETRY) == pytest.approx(0.12)


def test_gains_that_follow_backward_too_need_no_slowing_down() -> None:
    alike = Schedule((GainSet(1.5, Gains(6.0, 170.0, 0.0)),))
    assert curve_speed(0.4, -1.0, alike, GEOMETRY) == 0.4


def test_the_aim_is_on_the_leg_a_look_ahead_away() -> None:
    x, y = aim((0.0, 0.3, 0.0), (-1.0, 0.0), (4.0, 0.0), 1.0)
    assert y == 0.0
    assert hypot(x, y - 0.3) == pytest.approx(1.0)
    assert aim((3.9, 0.0, 0.0), (-1.0, 0.0), (4.0, 0.0), 1.0) == (4.0, 0.0), "not beyond the waypoint"
    assert aim((0.0, 2.0, 0.0), (-1.0, 0.0), (4.0, 0.0), 1.0) == (0.0, 0.0), "straight to the leg from far off"


def test_the_yaw_rate_is_2_v_theta_err_over_look_ahead() -> None:
    assert 0.5 * curvature_towards((0.0, 0.0, 0.0), (1.0, 1.0), 1.0) == pytest.approx(2.0 * 0.5 * (pi / 4.0))


@given(st.floats(0.1, 1.5), st.floats(-2.0, 2.0))
def test_no_curve_is_driven_faster_than_its_sideways_acceleration_allows(speed: float, curvature: float) -> None:
    v = speed_in_curve(speed, curvature)
    assert v <= speed
    assert v * v * abs(curvature) <= 0.6 + 1e-9
