"""The safety gate: what it lets through, what it counts, and how it opens and closes."""

from collections.abc import Callable
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.limits import (
    BLOCKED,
    LARGEST,
    LOST,
    REMEDIES,
    WAY_BACK,
    Fault,
    Gate,
    Outputs,
    RunawayWatch,
    SetpointBounds,
)
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
    once = SetpointBounds(Limits()).nearest(v, omega)
    assert SetpointBounds(Limits()).nearest(*once) == once


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


WIDE = 10**400  # a whole number that no float holds


@pytest.mark.parametrize("v, omega", [(nan, 0.0), (0.5, nan), (inf, 0.0), (0.5, -inf), (WIDE, 0.0), (0.5, -WIDE)])
def test_a_command_that_is_not_finite_is_refused_whole(v: float, omega: float) -> None:
    gate = open_gate()
    assert gate.admit_velocity(v, omega) is None
    assert gate.counts[Fault.NOT_FINITE] == 1
    assert not gate.admit_finite(v, omega)
    assert gate.admit_pwm(v, omega) is None
    assert gate.counts[Fault.NOT_FINITE] == 3


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
    for omega_max in (3.0, 0.05):
        slow = open_gate(Limits(v_dead_band=0.05, omega_max=omega_max))
        assert slow.admit_velocity(0.049, 0.05) == (0.0, 0.0), "a car without speed cannot turn"
    assert gate.admit_velocity(0.05, 0.0) == (0.05, 0.0)


@pytest.mark.parametrize("timeout", [0.1, 0.25, 1.0])
def test_a_command_is_stale_after_the_time_out_that_is_configured(timeout: float) -> None:
    gate = open_gate(Limits(command_timeout=timeout))
    assert gate.passes(0.0, gate.epoch, timeout)
    assert not gate.passes(0.0, gate.epoch, timeout + 0.001)


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


def test_a_command_is_stale_after_its_time_out_and_the_gate_stays_armed() -> None:
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


def test_a_command_of_an_earlier_epoch_never_counts_even_at_the_same_instant() -> None:
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


def test_a_speed_without_a_command_is_a_runaway() -> None:
    gate = driven(3000)
    for _ in range(4):
        gate.watch(130, 130, 2.05, None, 0.02)
    assert gate.armed
    gate.watch(130, 130, 2.05, None, 0.02)
    assert not gate.armed


def test_combined_odometry_against_the_encoders_is_a_runaway_and_a_bias_is_not() -> None:
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


# -- boundaries, and what is forgotten when ---------------------------------------------------------------------------


def test_what_is_exactly_at_a_limit_is_inside_and_not_counted() -> None:
    gate = open_gate(Limits(v_dead_band=0.05))
    assert gate.admit_velocity(1.5, 0.0) == (1.5, 0.0)
    assert gate.admit_velocity(0.01, 0.0) == (0.0, 0.0), "inside the dead band"
    assert gate.admit_pwm(24000, -24000) == (24000, -24000)
    assert not any(gate.counts.values())


def test_the_gate_itself_limits_set_points_whoever_made_them() -> None:
    out = open_gate().outputs(0, 0, 0, SERVOS, 10.0, 50.0)
    assert (out.v, out.omega) == (1.5, 1.5 / 0.56)


@pytest.mark.parametrize("servos", [(1, 0), (0, 1), (12000, -24000)])
def test_servos_follow_while_driving_and_motor_and_steering_stay_neutral_with_them(servos: tuple[int, int]) -> None:
    assert open_gate().outputs(100, 0, 0, servos, 0, 0)[3:5] == servos
    assert open_gate().neutral(servos) == (0, 0, 0, *servos, 0.0, 0.0)


def test_a_gate_says_at_once_why_it_is_closed_and_that_no_fault_closed_it() -> None:
    gate = Gate(LIMITS, on_close=lambda reason: None)
    assert (gate.armed, gate.stopped, gate.reason, gate.closed_by) == (False, False, "not armed yet", None)


@pytest.mark.parametrize("wish", [lambda gate: gate.disarm("by the program"), Gate.stop])
def test_who_stops_or_disarms_after_a_fault_has_the_last_word(wish: Callable[[Gate], None]) -> None:
    gate = open_gate()
    gate.disarm("link lost", Fault.LINK)
    gate.disarm("link lost again", Fault.LINK)
    assert gate.closed_by is Fault.LINK
    wish(gate)
    assert gate.closed_by is None


def test_a_command_goes_stale_once_and_only_where_one_was_fresh() -> None:
    gate = open_gate()
    gate.passes(0.0, gate.epoch, 0.1)
    gate.passes(0.0, gate.epoch, 0.2)
    assert gate.counts[Fault.STALE] == 0
    gate.arm(0.3)
    assert gate.outputs(5000, 0, 0, SERVOS, 1.0, 0.0)[:3] == (0, 0, 0), "what was fresh before arming is so no more"
    gate.passes(None, gate.epoch, 0.3)
    assert gate.counts[Fault.STALE] == 0


def test_a_computer_that_slept_for_as_long_as_five_cycles_disarms() -> None:
    gate = open_gate()
    gate.slept(0.099, 0.02)
    assert gate.armed
    gate.slept(5 * 0.02, 0.02)
    assert not gate.armed
    assert gate.counts[Fault.SLEPT] == 1


def test_a_gate_that_was_just_armed_watches_without_having_driven() -> None:
    gate = Gate(LIMITS, on_close=lambda reason: None)
    gate.arm(0.0)
    assert watched(gate, 0, 0, 100)


def test_suspicions_end_with_arming_and_with_neutral_outputs() -> None:
    gate = driven(2001)
    assert watched(gate, 0, 0, 14)
    gate.arm(0.0)
    gate.passes(0.0, gate.epoch, 0.0)
    gate.outputs(2001, 0, 0, SERVOS, 0.0, 0.0)
    assert watched(gate, 0, 0, 14)
    gate.neutral(SERVOS)
    assert watched(gate, 0, 0, 100)


DT = 0.02


def watch(*steps: tuple[int, int, int, int]) -> str | None:
    """The first reason in so many periods (n) with motor and ticks (motor, right, left)."""
    runaway = RunawayWatch(LIMITS)
    for motor, right, left, n in steps:
        for _ in range(n):
            if (reason := runaway.check(motor, right, left, 0.1, None, DT)) is not None:
                return reason
    return None


@pytest.mark.parametrize("sign", [1, -1])
def test_silence_counts_in_reverse_as_well(sign: int) -> None:
    assert watch((sign * 2001, 0, 0, 14)) is None
    assert watch((sign * 2001, 0, 0, 15)) == "blocked: a wall or an obstacle, or dead encoders"
    assert watch((sign * 500, sign * 10, 0, 15)) is None
    assert watch((sign * 500, sign * 10, 0, 15), (500, sign, 0, 1)) == "the left encoder is silent"
    assert watch((sign * 500, 0, sign * 10, 15)) is None
    assert watch((sign * 500, 0, sign * 10, 15), (500, 0, sign, 1)) == "the right encoder is silent"


def test_a_car_that_trembles_at_a_wall_is_blocked_and_has_no_silent_encoder() -> None:
    blocked = watch((2001, 0, 0, 6), (2001, 0, 1, 1), (2001, 0, 0, 2), (2001, 1, 0, 1), (2001, 0, 0, 14))
    assert blocked is not None and blocked.startswith("blocked: "), "as counted in real time"
    assert watch((2001, 0, 0, 6), (2001, 0, 4, 1), (2001, 0, 0, 8)) == "the right encoder is silent"


def test_one_period_in_which_both_wheels_turn_ends_all_suspicion() -> None:
    assert watch((2001, 0, 0, 14), (2001, 1, 1, 1), (2001, 0, 0, 14)) is None
    assert watch((2001, 0, 0, 14), (2001, -1, -1, 1), (2001, 0, 0, 14)) is None


def test_silence_at_rest_is_no_runaway_and_ends_a_silence_under_power() -> None:
    assert watch((2001, 0, 0, 14), (0, 0, 0, 1), (2001, 0, 0, 14)) is None
    assert watch((2001, 0, 0, 1), (2000, 0, 0, 100)) is None


def test_a_wheel_that_ticks_now_and_then_is_not_silent() -> None:
    assert watch((500, 10, 0, 14), (500, 0, 10, 1), (500, 10, 0, 15)) is None
    assert watch((500, 0, 10, 14), (500, 10, 0, 1), (500, 0, 10, 15)) is None
    assert watch((2001, 3, -3, 1), (2001, 0, 0, 14)) is None


def test_opposite_noise_of_three_counts_is_no_runaway_and_four_counts_are() -> None:
    assert watch((0, 3, -3, 100)) is None
    assert watch((0, -3, 4, 100)) is None
    assert watch((0, 3, -4, 100)) is None
    assert watch((0, -4, 4, 4)) is None
    assert watch((0, -4, 4, 5)) == "the encoders turn against each other"
    assert watch((0, -4, 4, 4), (0, 1, 0, 1), (0, -4, 4, 4)) is None


def test_the_largest_speeds_and_differences_that_are_no_runaway() -> None:
    runaway = RunawayWatch(LIMITS)
    for _ in range(100):
        assert runaway.check(8000, 40, 40, 2.0, 1.5, DT) is None
        assert runaway.check(8000, -40, -40, -2.0, -1.5, DT) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_speed_or_difference_has_to_last_without_a_break(sign: float) -> None:
    runaway = RunawayWatch(LIMITS)
    for _ in range(2):
        for _ in range(4):
            assert runaway.check(8000, 40, 40, sign * 2.01, None, DT) is None
        assert runaway.check(8000, 40, 0, sign * 0.1, None, DT) is None
    for _ in range(2):
        for _ in range(14):
            assert runaway.check(8000, 40, 40, 0.0, sign * 0.51, DT) is None
        assert runaway.check(8000, 40, 0, 0.0, sign * 0.5, DT) is None
    for _ in range(4):
        assert runaway.check(8000, 40, 40, sign * 2.01, None, DT) is None
    assert runaway.check(8000, 40, 40, sign * 2.01, None, DT) == "2.0 m/s is faster than any command"


ROVER = Limits(radius_min=0.0)


def test_of_a_rover_that_turns_in_place_only_two_silent_wheels_are_a_runaway() -> None:
    for right, left in ((10, -10), (10, 0), (0, 10)):
        runaway = RunawayWatch(ROVER)
        assert all(runaway.check(8000, right, left, 0.1, None, DT) is None for _ in range(100))
    assert all(runaway.check(2001, 0, 0, 0.0, None, DT) is None for _ in range(14))
    assert runaway.check(2001, 0, 0, 0.0, None, DT) is not None


def test_a_rover_s_yaw_rate_is_limited_by_itself_alone() -> None:
    assert SetpointBounds(ROVER).nearest(0.0, -7.0) == (0.0, -6.0)
    assert SetpointBounds(ROVER).nearest(1.5, 5.0) == (1.5, 5.0)


def test_a_fast_car_s_yaw_rate_is_limited_like_a_rover_s() -> None:
    fast = Limits(v_max=5.0)
    assert SetpointBounds(fast).nearest(4.0, 7.0) == (4.0, 6.0)
    assert SetpointBounds(fast).nearest(-4.0, -7.0) == (-4.0, -6.0)
    assert SetpointBounds(fast).nearest(3.0, 7.0) == (3.0, 3.0 / 0.56)


def guarded(*allowed: tuple[float, float], limits: Limits = LIMITS) -> tuple[float, float]:
    """What the gate makes of 0.5 m/s and 0.4 rad/s with guards that allow this."""
    gate = open_gate(limits)
    assert gate.guarded(0.5, 0.4, 1.0) == (0.5, 0.4), "nobody guards"
    for answer in allowed:
        gate.guards.append(lambda v, omega, now, answer=answer: answer)
    return gate.guarded(0.5, 0.4, 1.0)


def test_a_guard_may_leave_the_set_point_or_lower_it_within_the_gate_s_limits() -> None:
    assert guarded((0.5, 0.4)) == (0.5, 0.4)
    assert guarded((0.3, -0.1)) == (0.3, -0.1)
    assert guarded((0.14, 5.0)) == (0.14, 0.14 / 0.56), "the yaw rate is limited as ever"
    assert guarded((0.0, 0.4)) == (0.0, 0.0), "a car does not turn on the spot"
    assert guarded((0.0, 0.4), limits=ROVER) == (0.0, 0.4), "and a rover does"
    assert guarded((0.3, 0.0), (0.2, 0.0)) == (0.2, 0.0)
    assert guarded((0.3, 0.0), (0.4, 0.0)) == (0.0, 0.0), "each sees what those before it allow"


@pytest.mark.parametrize("wild", [(0.501, 0.0), (-0.1, 0.0), (nan, 0.0), (0.3, nan), (0.3, inf), (inf, 0.0)])
def test_a_guard_that_is_faster_or_turns_it_round_or_says_no_number_stops_it(wild: tuple[float, float]) -> None:
    assert guarded(wild) == (0.0, 0.0)


def test_a_guard_sees_the_set_point_and_the_time() -> None:
    seen = []

    def guard(v: float, omega: float, now: float) -> tuple[float, float]:
        seen.append((v, omega, now))
        return v, omega

    gate = open_gate()
    gate.guards.append(guard)
    gate.guarded(-0.5, 0.4, 3.0)
    assert seen == [(-0.5, 0.4, 3.0)]


def test_a_command_from_the_future_is_not_fresh_but_one_that_a_late_tick_sees_is() -> None:
    gate = open_gate()
    assert gate.passes(5.1, gate.epoch, 5.0)
    assert not gate.passes(5.2, gate.epoch, 5.0)
    assert not gate.passes(inf, gate.epoch, 5.0)


def test_outputs_are_neutral_unless_something_else_is_said() -> None:
    assert Outputs() == (0, 0, 0, 0, 0, 0.0, 0.0)


@pytest.mark.parametrize("largest", [LARGEST, -LARGEST])
def test_the_largest_number_is_a_number_and_is_limited(largest: float) -> None:
    gate = Gate(Limits(), on_close=lambda reason: None)
    assert gate.admit_velocity(largest, 0.0) is not None
    assert gate.admit_velocity(0.0, largest) is not None
    assert gate.admit_finite(largest)
    assert gate.counts[Fault.NOT_FINITE] == 0


# -- a car that is not seen, and a board that settles -------------------------------------------------------------


def rolling(v: float) -> Gate:
    """A gate whose car was seen at this speed, as commanded."""
    gate = open_gate()
    for _ in range(3):
        gate.sight.turns(v, 0.05)
    return gate


def test_a_car_that_vanished_gets_zeros_at_once_and_is_disarmed_by_the_next_reading() -> None:
    gate = rolling(1.0)
    assert gate.unseen(1.0, 0.05, False)
    assert gate.armed and not gate.passes(0.0, gate.epoch, 0.0)
    assert gate.unseen(1.0, 0.05, False)
    assert (gate.armed, gate.reason, gate.closed_by) == (False, LOST, Fault.RUNAWAY)


def test_a_slow_car_that_is_not_seen_drives_on_for_a_moment_and_is_disarmed_then() -> None:
    gate = rolling(0.3)
    assert not gate.unseen(0.3, 0.05, False) and gate.passes(0.0, gate.epoch, 0.0)
    assert any(gate.unseen(0.3, 0.05, False) for _ in range(10)) and not gate.armed


def test_a_car_that_is_armed_anew_stands_and_its_board_has_settled() -> None:
    gate = rolling(1.0)
    gate.held = True
    gate.arm(1.0)
    assert gate.passes(1.0, gate.epoch, 1.0)
    assert not gate.unseen(1.0, 0.05, False), "nothing is known of a speed from before"


def test_while_a_board_settles_no_command_passes() -> None:
    gate = open_gate()
    gate.held = True
    assert not gate.passes(0.0, gate.epoch, 0.0) and gate.armed
    gate.held = False
    assert gate.passes(0.0, gate.epoch, 0.0)


def test_a_new_gate_holds_nothing_back_and_no_guard_limits_it() -> None:
    gate = Gate(LIMITS, on_close=lambda reason: None)
    assert not gate.limited and not gate.held


def test_both_wheels_silent_is_told_as_blocked_and_one_of_them_as_a_runaway() -> None:
    reasons = []
    for right in (0, 5):
        gate = open_gate()
        gate.outputs(LIMITS.runaway_motor + 100.0, 0.0, 0.0, SERVOS, 1.0, 0.0)
        for _ in range(100):
            gate.watch(right, 0, 0.0, None, 0.02)
        reasons.append(gate.reason)
    assert reasons == [BLOCKED, "runaway: the left encoder is silent"]


@pytest.mark.parametrize("fault", REMEDIES)
def test_each_fault_that_disarms_is_told_with_its_remedy_in_the_first_60_columns(fault: Fault) -> None:
    gate = open_gate()
    gate.disarm("the cause", fault)
    assert gate.told == f"{REMEDIES[fault]}: the cause" and len(REMEDIES[fault]) <= 60
    gate.disarm("by the program")
    assert gate.told == "the cause", "whoever disarmed it since needs no remedy"


def test_at_a_wall_the_remedy_is_to_drive_back() -> None:
    gate = open_gate()
    gate.disarm(BLOCKED, Fault.RUNAWAY)
    assert gate.told == f"{WAY_BACK}: {BLOCKED}" and len(WAY_BACK) <= 60
