"""The vehicle's dynamics: motor, steering, scrub, wheels, slip."""

from __future__ import annotations

from math import atan, copysign, cos, exp, hypot, pi, radians, sin, tan

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from sim_steps import Parameters, advance

from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import STEERING_MAX, Geometry
from txt1.sim.dynamics import VehicleState

P = Parameters()
BODY = Geometry()
LOCK = BODY.steering_max
COUNT = 0.5125 / 1600


def drive(
    state: VehicleState, motor: float, front: float, rear: float, seconds: float, p: Parameters = P
) -> VehicleState:
    """The state after so many seconds of control ticks without drag."""
    for _ in range(round(seconds * 50)):
        state = advance(state, motor, front, rear, 0.02, 0.0, p)
    return state


# -- motor -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("counts", [500, 1800, 4000, -500, -4000])
def test_the_free_speed_is_a_third_of_a_mm_per_s_per_count_beyond_the_dead_band(counts: int) -> None:
    beyond = counts - 300 if counts > 0 else counts + 300
    assert drive(VehicleState(), counts, 0, 0, 10.0).v == pytest.approx(0.00033 * beyond, rel=1e-9)


@pytest.mark.parametrize("counts", [0, 1, 299, 300, -300])
def test_inside_the_dead_band_nothing_moves(counts: int) -> None:
    assert drive(VehicleState(), counts, 0, 0, 1.0) == VehicleState()


def test_just_beyond_the_dead_band_something_moves() -> None:
    assert advance(VehicleState(), 301, 0, 0, 0.02, 0.0, P).v > 0.0
    assert advance(VehicleState(), -301, 0, 0, 0.02, 0.0, P).v < 0.0


def test_after_one_time_constant_63_percent_of_the_speed_is_reached() -> None:
    share = drive(VehicleState(), 3300, 0, 0, 0.3).v / (0.00033 * 3000)
    assert share == pytest.approx(1 - exp(-1), rel=1e-9)


@given(st.floats(-2.0, 2.0), st.floats(-300.0, 300.0))
@example(8.152263228519404e-10, 0.0)
def test_coasting_comes_to_rest_in_finite_time_and_never_reverses(v: float, motor: float) -> None:
    state, travelled = VehicleState(v=v), 0.0
    for _ in range(200):
        before = state
        state = advance(before, motor, 0, 0, 0.02, 0.0, P)
        assert abs(state.v) <= abs(before.v)
        assert state.v * v >= 0.0
        assert copysign(1.0, v) * (state.x - before.x) >= -1e-15  # m: the sum's rounding
        travelled += abs(state.x - before.x)
    assert state.v == 0.0
    assert travelled == pytest.approx(abs(state.x), abs=1e-9)
    assert advance(state, motor, 0, 0, 0.02, 0.0, P) == state


@pytest.mark.parametrize("counts", [300, -300])
def test_a_moving_vehicle_coasts_up_to_the_very_end_of_the_dead_band(counts: int) -> None:
    moving = VehicleState(v=1.0)
    assert advance(moving, counts, 0, 0, 0.02, 0.0, P) == advance(moving, 0, 0, 0, 0.02, 0.0, P)


def test_without_dry_friction_coasting_only_slows_down() -> None:
    p = P._replace(coast_friction=0.0)
    assert drive(VehicleState(v=1.0), 0, 0, 0, 0.6, p).v == pytest.approx(exp(-1), rel=1e-9)
    assert drive(VehicleState(), 0, 0, 0, 0.6, p) == VehicleState()


def test_the_floor_s_drag_costs_its_share_of_the_speed() -> None:
    state = VehicleState()
    for _ in range(500):
        state = advance(state, 4000, 0, 0, 0.02, 0.1, P)
    assert state.v == pytest.approx(0.00033 * 3700 / 1.1, rel=1e-9)


# -- steering ----------------------------------------------------------------------------------------------------


def test_a_servo_turns_60_degrees_in_150_ms() -> None:
    p = P._replace(steering_max=radians(60))
    almost = advance(VehicleState(), 0, -18000, 18000, 0.149, 0.0, p)
    assert almost.phi_front == pytest.approx(radians(60) * 149 / 150, rel=1e-9)
    assert advance(VehicleState(), 0, -18000, 18000, 0.15, 0.0, p).phi_front == pytest.approx(radians(60), rel=1e-9)


def test_from_lock_to_lock_takes_84_ms() -> None:
    duration = 2 * LOCK / (radians(60) / 0.15)
    assert duration == pytest.approx(0.084, abs=0.001)
    left = VehicleState(phi_front=LOCK, phi_rear=-LOCK)
    assert advance(left, 0, 18000, -18000, duration - 1e-4, 0.0, P).phi_front > -LOCK
    state = advance(left, 0, 18000, -18000, duration + 1e-9, 0.0, P)
    assert (state.phi_front, state.phi_rear) == (-LOCK, LOCK)


@given(st.integers(-24000, 24000), st.integers(-24000, 24000))
def test_front_and_rear_go_independently_where_the_counts_say_and_stop_at_the_lock(front: int, rear: int) -> None:
    state = drive(VehicleState(), 0, front, rear, 0.2)
    assert state.phi_front == pytest.approx(-LOCK * max(-1, min(1, front / STEERING_MAX)), abs=1e-12)
    assert state.phi_rear == pytest.approx(-LOCK * max(-1, min(1, rear / STEERING_MAX)), abs=1e-12)
    assert max(abs(state.phi_front), abs(state.phi_rear)) <= LOCK


@pytest.mark.parametrize(("u", "motor"), [(18000, 3000), (-18000, 3000), (24000, -3000), (-18000, -3000)])
def test_at_full_lock_the_path_is_a_circle_of_0_56_m(u: int, motor: int) -> None:
    state = drive(VehicleState(), motor, -u, u, 6.0)
    points = []
    for _ in range(3):
        points.append((state.x, state.y))
        state = drive(state, motor, -u, u, 0.5)
    (ax, ay), (bx, by), (cx, cy) = points
    sides = hypot(bx - ax, by - ay), hypot(cx - bx, cy - by), hypot(ax - cx, ay - cy)
    area = abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) / 2
    assert sides[0] * sides[1] * sides[2] / (4 * area) == pytest.approx(0.56, rel=1e-9)


@pytest.mark.parametrize("motor", [3000, -3000])
def test_positive_u_turns_left_driving_forward_and_right_reversing(motor: int) -> None:
    state = drive(VehicleState(), motor, -6000, 6000, 0.5)
    assert state.theta * motor > 0.0


@pytest.mark.parametrize("counts", [9000, -18000])
def test_equal_angles_move_sideways_without_turning(counts: int) -> None:
    state = drive(VehicleState(), 3000, counts, counts, 2.0)
    start = drive(VehicleState(), 0, counts, counts, 0.2)
    state = drive(start, 3000, counts, counts, 2.0)
    assert state.theta == 0.0
    assert state.y / state.x == pytest.approx(tan(-LOCK * counts / 18000), rel=1e-9)
    straight = drive(VehicleState(), 3000, 0, 0, 2.0)
    assert hypot(state.x, state.y) == pytest.approx(straight.x, rel=1e-9), "and without scrubbing"


def test_the_scrub_of_full_lock_costs_2_to_10_percent_of_the_free_speed() -> None:
    free = drive(VehicleState(), 3000, 0, 0, 10.0).v
    turning = drive(VehicleState(), 3000, -18000, 18000, 10.0).v
    assert 0.02 < 1 - turning / free < 0.10
    half = drive(VehicleState(), 3000, -9000, 9000, 10.0).v
    assert turning < half < free


# -- encoder wheels ----------------------------------------------------------------------------------------------


def test_a_straight_tyre_circumference_is_1600_counts_of_either_wheel() -> None:
    state = drive(VehicleState(), 3000, 0, 0, 3.0)
    assert state.right == state.left == state.x
    assert state.x / 0.5125 * 1600 == pytest.approx(state.right / COUNT)


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.sampled_from([-1.0, 1.0]))
def test_the_front_wheels_roll_with_the_velocity_of_their_hubs_along_their_heading(
    front: float, rear: float, v: float
) -> None:
    phi_f, phi_r = front * LOCK, rear * LOCK
    state = VehicleState(v=v, phi_front=phi_f, phi_rear=phi_r)
    dt = 1e-4
    after = advance(state, 0, -front * 18000, -rear * 18000, dt, 0.0, P)
    # the hubs' paths over the ground, from the poses alone
    for y, rolled in ((-0.125, after.right), (0.125, after.left)):
        x0, y0 = 0.17, y
        x1 = after.x + 0.17 * cos(after.theta) - y * sin(after.theta)
        y1 = after.y + 0.17 * sin(after.theta) + y * cos(after.theta)
        along = (x1 - x0) * cos(phi_f + after.theta / 2) + (y1 - y0) * sin(phi_f + after.theta / 2)
        assert rolled == pytest.approx(along, abs=1e-10)


def test_in_a_left_turn_the_right_wheel_runs_ahead() -> None:
    turned = drive(VehicleState(), 3000, -18000, 18000, 2.0)
    assert turned.right > turned.left > 0.0


@given(st.floats(0.05, 1.0))
def test_slip_makes_the_encoders_overestimate_by_its_share(slip: float) -> None:
    p = P._replace(slip=slip)
    driven, rolled = (drive(VehicleState(), 3000, -9000, 9000, 1.0, q) for q in (p, P))
    assert driven[:6] == rolled[:6], "slip changes what the wheels turn, not what the vehicle does"
    assert driven.right == pytest.approx(rolled.right * (1 + slip), rel=1e-9)
    assert driven.left == pytest.approx(rolled.left * (1 + slip), rel=1e-9)


def test_coasting_wheels_do_not_slip() -> None:
    p = P._replace(slip=0.2)
    state = drive(VehicleState(v=1.0), 0, 0, 0, 1.0, p)
    assert state.right == pytest.approx(state.x, rel=1e-12)


@pytest.mark.parametrize("understeer", [0.1, 0.5])
def test_understeer_widens_the_circle_with_the_square_of_the_speed(understeer: float) -> None:
    state = drive(VehicleState(), 3000, -18000, 18000, 5.0, P._replace(understeer=understeer))
    after = advance(state, 3000, -18000, 18000, 0.02, 0.0, P._replace(understeer=understeer))
    radius = state.v * 0.02 / wrap_angle(after.theta - state.theta)
    assert radius == pytest.approx(0.56 * (1 + understeer * state.v**2), rel=1e-6)


def test_the_heading_stays_wrapped_over_many_laps_in_one_step() -> None:
    turning = VehicleState(v=1.0, phi_front=LOCK, phi_rear=-LOCK)
    for sign in (1, -1):
        state = advance(turning._replace(v=sign * 1.0), sign * 4000, -18000, 18000, 30.0, 0.0, P)
        assert -pi < state.theta <= pi


def test_no_time_changes_nothing() -> None:
    state = VehicleState(1.0, 2.0, 0.5, 0.7, 0.1, -0.1, 3.0, 4.0)
    assert advance(state, 4000, 18000, 0, 0.0, 0.0, P) == state


def test_the_lock_follows_from_r_min() -> None:
    assert P.steering_max == atan(0.34 / (2 * 0.56))
