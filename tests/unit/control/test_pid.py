"""The velocity-form PID (thesis 4.1)."""

from __future__ import annotations

from math import exp

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.pid import CLEAR, Gains, VelocityLoops, at_rest, errors, pid

DT = 0.02


class Pid:
    """A controller that remembers its state."""

    def __init__(self, limit: float) -> None:
        self.limit, self.state = limit, CLEAR

    @property
    def output(self) -> float:
        return self.state[0]

    def step(self, error: float, gains: Gains, dt: float) -> float:
        self.state = pid(self.state, error, gains, dt, self.limit)
        return self.output


ERRORS = st.lists(st.floats(-2000.0, 2000.0), min_size=1, max_size=60)


def test_three_steps_of_4_7_worked_by_hand() -> None:
    loop, gains = Pid(8000.0), Gains(11.0, 18.0, 0.25)
    # e = 100, 80, 70; K_I dt = 0.36, K_D/dt = 12.5
    assert loop.step(100.0, gains, DT) == pytest.approx(11 * 100 + 0.36 * 100 + 12.5 * 100)  # 2386
    assert loop.step(80.0, gains, DT) == pytest.approx(2386 + 11 * -20 + 0.36 * 80 + 12.5 * (80 - 200))  # 694.8
    assert loop.step(70.0, gains, DT) == pytest.approx(694.8 + 11 * -10 + 0.36 * 70 + 12.5 * (70 - 160 + 100))
    assert loop.output == pytest.approx(735.0)


@given(ERRORS)
def test_inside_the_limit_it_is_the_textbook_pid(errors: list[float]) -> None:
    loop, (kp, ki, kd) = Pid(1e9), (3.0, 80.0, 0.005)
    for k, error in enumerate(errors):
        u = loop.step(error, Gains(kp, ki, kd), DT)
        previous = errors[k - 1] if k else 0.0
        expected = kp * error + ki * DT * sum(errors[: k + 1]) + kd / DT * (error - previous)
        assert u == pytest.approx(expected, rel=1e-9, abs=1e-6)


@given(ERRORS, st.floats(0.0, 5000.0))
def test_the_output_stays_inside_the_limit(errors: list[float], limit: float) -> None:
    loop = Pid(limit)
    for error in errors:
        assert abs(loop.step(error, Gains(11.0, 18.0, 0.25), DT)) <= limit


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_it_comes_off_the_limit_at_once(sign: float) -> None:
    loop, gains = Pid(1000.0), Gains(0.0, 50.0, 0.0)
    for _ in range(500):
        assert abs(loop.step(sign * 500.0, gains, DT)) <= 1000.0
    assert loop.output == sign * 1000.0
    assert loop.step(-sign * 100.0, gains, DT) == pytest.approx(sign * 900.0)  # ten seconds of error wound up nothing


def test_after_clearing_it_is_as_at_power_up() -> None:
    fresh, used, gains = Pid(8000.0), Pid(8000.0), Gains(11.0, 18.0, 0.25)
    for error in (500.0, -300.0, 80.0):
        used.step(error, gains, DT)
    used.state = CLEAR
    for error in (10.0, 20.0, -5.0):
        assert used.step(error, gains, DT) == fresh.step(error, gains, DT)


@given(ERRORS)
def test_without_gains_nothing_moves(errors: list[float]) -> None:
    loop = Pid(8000.0)
    assert all(loop.step(error, Gains(), DT) == 0.0 for error in errors)


def test_changed_gains_do_not_make_the_output_jump() -> None:
    loop = Pid(8000.0)
    for _ in range(10):
        loop.step(50.0, Gains(6.0, 170.0, 0.0), DT)
    before = loop.output
    assert loop.step(50.0, Gains(4.0, 130.0, 0.0), DT) - before == pytest.approx(130.0 * DT * 50.0)


def test_a_pi_loop_that_cancels_the_plant_s_pole_closes_like_first_order() -> None:
    # plant v(k+1) = a v(k) + g (1 - a) u(k), a = exp(-dt/tau); kp/(ki dt) = a/(1 - a) cancels its pole, so
    # v(k) = r (1 - (1 - ki dt g)^k)
    a, g, ki = exp(-DT / 0.3), 0.33, 5.0
    gains = Gains(ki * DT * a / (1 - a), ki, 0.0)
    loop, v = Pid(1e9), 0.0
    for k in range(200):
        assert v == pytest.approx(500.0 * (1 - (1 - ki * DT * g) ** k), abs=1e-8)
        v = a * v + g * (1 - a) * loop.step(500.0 - v, gains, DT)


LOOPS = Gains(1.0, 50.0, 0.0), Gains(2.0, 25.0, 0.0)


def test_the_loops_begin_clear_and_are_so_again_when_cleared() -> None:
    loops = VelocityLoops(steers=True)
    first = loops.step(0.5, 0.2, 0.4, 0.1, *LOOPS, DT)
    assert first == pytest.approx((100.0 * (1.0 + 50.0 * DT), 100.0 * (2.0 + 25.0 * DT)))
    assert loops.step(0.5, 0.2, 0.4, 0.1, *LOOPS, DT) != first
    loops.clear()
    assert loops.step(0.5, 0.2, 0.4, 0.1, *LOOPS, DT) == first


def test_without_a_new_measurement_the_outputs_are_held() -> None:
    loops = VelocityLoops(steers=True)
    first = loops.step(0.5, 0.2, 0.4, 0.1, *LOOPS, DT)
    assert loops.step(0.9, 0.9, 0.0, 0.0, *LOOPS, 0.0) == first


def test_the_yaw_rate_error_changes_sign_in_reverse_and_not_at_standstill() -> None:
    assert errors(0.5, 0.25, 0.25, 0.0) == (250.0, 250.0)
    assert errors(0.5, 0.25, 0.0, 0.0) == (500.0, 250.0)
    assert errors(-0.5, 0.25, -0.25, 0.0) == (-250.0, -250.0)


def test_at_rest_is_a_set_point_of_zero_at_standstill() -> None:
    assert at_rest(0.0, 0.0)
    assert not at_rest(0.0, 1.0)
    assert not at_rest(1.0, 0.0)
    assert not at_rest(0.0, -0.016)
