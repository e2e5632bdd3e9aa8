"""The safety gate: what it lets through, what it counts, and how it opens and closes."""

from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.limits import Fault, Gate, limit_velocity
from txt1.control.parameters import Limits
from txt1.model.vehicle import PWM_MAX, STEERING_MAX

LIMITS = Limits()
SERVOS = (0, 0)
anything = st.floats(allow_nan=True, allow_infinity=True)
finite = st.floats(allow_nan=False, allow_infinity=False)


def open_gate(limits: Limits = LIMITS) -> Gate:
    """A gate that is armed and has just seen a fresh command."""
    gate = Gate(limits, on_close=lambda reason: None)
    gate.arm(0.0)
    assert gate.passes(0.0, gate.epoch, 0.0)
    return gate


@given(anything, anything)
def test_no_admitted_set_point_leaves_the_reachable_region(v: float, omega: float) -> None:
    limits = Limits()
    admitted = open_gate().admit_velocity(v, omega)
    if admitted is not None:
        assert abs(admitted[0]) <= limits.v_max
        assert abs(admitted[1]) <= abs(admitted[0]) / limits.radius_min


@given(finite, finite)
def test_limiting_twice_changes_nothing_more(v: float, omega: float) -> None:
    once = limit_velocity(v, omega, Limits())
    assert limit_velocity(*once, Limits()) == once


@given(st.floats(-1.5, 1.5), st.floats(-1.0, 1.0))
def test_a_reachable_set_point_passes_unchanged_and_uncounted(v: float, share: float) -> None:
    gate = open_gate()
    omega = share * abs(v) / 0.56
    assert gate.admit_velocity(v, omega) == (v, omega)
    assert not any(gate.counts.values())


@given(anything, anything, anything, anything, anything, st.booleans(), st.floats(0.0, 1.0))
def test_whatever_anyone_wants_the_outputs_are_inside_the_limits(
    motor: float, front: float, rear: float, v: float, omega: float, armed: bool, age: float
) -> None:
    gate = open_gate()
    if not armed:
        gate.disarm("test")
    gate.passes(0.0, gate.epoch, age)
    out = gate.outputs(motor, front, rear, SERVOS, v, omega)
    assert abs(out.motor) <= Limits().motor_max
    assert abs(out.front) <= STEERING_MAX
    assert abs(out.rear) <= STEERING_MAX
    assert abs(out.v) <= 1.5
    assert abs(out.omega) <= abs(out.v) / 0.56
    if not armed or age > Limits().command_timeout + 1e-9:
        assert (out.motor, out.front, out.rear, out.v, out.omega) == (0, 0, 0, 0.0, 0.0)


@pytest.mark.parametrize("v, omega", [(nan, 0.0), (0.5, nan), (inf, 0.0), (0.5, -inf)])
def test_a_command_that_is_not_finite_is_refused_whole(v: float, omega: float) -> None:
    gate = open_gate()
    assert gate.admit_velocity(v, omega) is None
    assert gate.counts[Fault.NOT_FINITE] == 1


@pytest.mark.parametrize("spoiled", range(5))
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_one_output_that_is_not_finite_makes_all_neutral(spoiled: int, value: float) -> None:
    wanted = [1000.0, 100.0, -100.0, 0.5, 0.1]
    wanted[spoiled] = value
    motor, front, rear, v, omega = wanted
    gate = open_gate()
    assert gate.outputs(motor, front, rear, SERVOS, v, omega)[:3] == (0, 0, 0)
    assert gate.counts[Fault.NOT_FINITE] == 1


def test_10_metres_a_second_is_clipped_to_the_limit_and_counted() -> None:
    gate = open_gate()
    assert gate.admit_velocity(10.0, 0.0) == (1.5, 0.0)
    assert gate.counts[Fault.SPEED] == 1


def test_there_is_no_yaw_rate_at_standstill() -> None:
    gate = open_gate()
    assert gate.admit_velocity(0.0, 30.0) == (0.0, 0.0)
    assert gate.counts[Fault.YAW_RATE] == 1


def test_a_set_point_inside_the_dead_band_is_zero() -> None:
    gate = open_gate(Limits(v_dead_band=0.05))
    assert gate.admit_velocity(0.049, 0.0) == (0.0, 0.0)
    assert gate.admit_velocity(0.05, 0.0) == (0.05, 0.0)


def test_pwm_beyond_the_pulse_range_is_clipped_to_it_and_counted() -> None:
    gate = open_gate()
    assert gate.admit_pwm(30000, -30000, 24000, 0, 0) == (PWM_MAX, -PWM_MAX, 24000, 0, 0)
    assert gate.counts[Fault.PWM] == 1


@pytest.mark.parametrize("motor, passed, counted", [(8000, 8000, 0), (8001, 8000, 1), (-8001, -8000, 1)])
def test_the_motor_limit_at_its_boundary(motor: int, passed: int, counted: int) -> None:
    gate = open_gate()
    assert gate.outputs(motor, 0, 0, SERVOS, 0, 0).motor == passed
    assert gate.counts[Fault.MOTOR] == counted


@pytest.mark.parametrize("steering, passed, counted", [(18000, 18000, 0), (18001, 18000, 1), (-24000, -18000, 1)])
def test_the_steering_limit_at_its_boundary(steering: int, passed: int, counted: int) -> None:
    gate = open_gate()
    assert gate.outputs(0, steering, 0, SERVOS, 0, 0).front == passed
    assert gate.outputs(0, 0, steering, SERVOS, 0, 0).rear == passed
    assert gate.counts[Fault.STEERING] == 2 * counted


def test_a_command_is_fresh_up_to_its_time_out_and_then_stale_but_the_gate_stays_armed() -> None:
    gate = open_gate()
    assert gate.passes(1.0, gate.epoch, 1.25)
    assert not gate.passes(1.0, gate.epoch, 1.251)
    assert gate.armed
    assert gate.counts[Fault.STALE] == 1
    assert not gate.passes(1.0, gate.epoch, 1.3)
    assert gate.counts[Fault.STALE] == 1, "one command goes stale once"
    assert gate.passes(1.31, gate.epoch, 1.32), "the next fresh command resumes"


def test_a_closed_gate_is_neutral_and_opens_by_arming_only() -> None:
    gate = Gate(Limits(), on_close=lambda reason: None)
    assert not gate.passes(0.0, gate.epoch, 0.0)
    gate.arm(0.0)
    assert gate.passes(0.0, gate.epoch, 0.0)
    gate.disarm("link lost", Fault.LINK)
    assert not gate.passes(0.0, gate.epoch, 0.0)
    assert gate.reason == "link lost"
    assert gate.counts[Fault.LINK] == 1


def test_a_command_of_an_earlier_epoch_does_not_count_even_when_given_at_the_same_instant() -> None:
    gate = Gate(LIMITS, on_close=lambda reason: None)
    before = gate.epoch
    gate.arm(1.0)
    assert not gate.passes(1.0, before, 1.0)
    assert gate.passes(1.0, gate.epoch, 1.0)


def test_a_command_from_before_arming_does_not_count() -> None:
    gate = Gate(LIMITS, on_close=lambda reason: None)
    gate.arm(1.0)
    assert not gate.passes(0.9, gate.epoch, 1.0)
    assert gate.passes(1.0, gate.epoch, 1.0)


def test_arming_alone_moves_nothing_before_a_fresh_command() -> None:
    gate = Gate(Limits(), on_close=lambda reason: None)
    gate.arm(0.0)
    assert gate.outputs(5000, 0, 0, SERVOS, 1.0, 0.0)[:3] == (0, 0, 0)


def test_the_emergency_stop_latches_also_while_disarmed_until_armed() -> None:
    reasons: list[str] = []
    gate = Gate(Limits(), on_close=reasons.append)
    gate.stop()
    assert gate.stopped
    gate.disarm("something else")
    assert gate.reason == "emergency stop"
    gate.arm(0.0)
    assert gate.armed
    assert not gate.stopped
    assert reasons == ["emergency stop"]


def test_the_free_servos_follow_while_armed_and_stay_where_they_are_while_not() -> None:
    gate = open_gate()
    assert gate.neutral((12000, -24000))[3:5] == (12000, -24000)
    gate.disarm("test")
    assert gate.neutral((0, 0))[3:5] == (12000, -24000)


def driven(motor: int) -> Gate:
    gate = open_gate()
    gate.outputs(motor, 0, 0, SERVOS, 0.0, 0.0)
    return gate


def watched(gate: Gate, right: int, left: int, ticks: int) -> bool:
    """Whether the gate is still armed after so many periods with these encoder ticks."""
    for _ in range(ticks):
        gate.watch(right, left, 0.1, None, 0.02)
    return gate.armed


def test_silent_encoders_under_power_are_a_runaway_after_0_3_seconds() -> None:
    gate = driven(2001)
    assert watched(gate, 0, 0, 14)
    assert not watched(gate, 0, 0, 1)
    assert gate.counts[Fault.RUNAWAY] == 1


def test_one_silent_encoder_is_enough() -> None:
    assert not watched(driven(2001), 3, 0, 15)
    assert not watched(driven(2001), 0, 3, 15)


def test_silent_encoders_with_the_motor_at_its_threshold_are_no_runaway() -> None:
    assert watched(driven(2000), 0, 0, 1000)


def test_encoders_that_tick_are_no_runaway() -> None:
    assert watched(driven(8000), 1, 1, 1000)
    assert watched(driven(-8000), -1, -1, 1000)


def test_a_wheel_that_is_silent_while_the_other_rolls_is_a_runaway_at_any_power() -> None:
    gate = driven(500)
    assert watched(gate, 10, 0, 15)
    assert not watched(gate, 10, 0, 1)


def test_wheels_that_turn_against_each_other_are_a_runaway() -> None:
    gate = driven(1000)
    assert watched(gate, 20, -20, 4)
    assert not watched(gate, 20, -20, 1)
    assert "against each other" in gate.reason
    assert watched(driven(1000), 2, -2, 100), "a wheel at rest may show a count or two"


def test_a_speed_that_nobody_asked_for_is_a_runaway() -> None:
    gate = driven(3000)
    for _ in range(4):
        gate.watch(130, 130, 2.05, None, 0.02)
    assert gate.armed
    gate.watch(130, 130, 2.05, None, 0.02)
    assert not gate.armed


def test_combined_odometry_that_contradicts_the_encoders_is_a_runaway_and_a_bias_is_not() -> None:
    gate = driven(3000)
    for _ in range(14):
        gate.watch(40, 40, 0.7, 0.0, 0.02)
    assert gate.armed
    gate.watch(40, 40, 0.7, 0.0, 0.02)
    assert not gate.armed
    biased = driven(3000)
    for _ in range(100):
        biased.watch(90, 90, 1.5, 1.65, 0.02)
    assert biased.armed


def test_missing_five_cycles_in_a_row_disarms_and_four_do_not() -> None:
    gate = open_gate()
    gate.missed(4)
    assert gate.armed
    gate.missed(5)
    assert not gate.armed
    assert gate.counts[Fault.MISSED] == 1
