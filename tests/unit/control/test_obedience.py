"""A board that stops obeying is noticed by a car that slows down under a command that does not."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from txt1.control.obedience import FAILS, FAILS_FOR, Obedience
from txt1.control.standstill import envelope

PERIOD = 0.05


def first_failure(v: Callable[[float], float], asked: Callable[[float], float], duration: float = 6.0) -> float | None:
    """When it fails, s; None: never."""
    watch = Obedience()
    times = (PERIOD * k for k in range(round(duration / PERIOD)))
    return next((t for t in times if watch.fails(t, v(t), asked(t))), None)


@pytest.mark.parametrize("c", [0.1, 0.3, 1.0, -0.6])
def test_a_car_that_coasts_under_a_constant_command_fails_it(c: float) -> None:
    sign = 1.0 if c > 0.0 else -1.0
    when = first_failure(lambda t: sign * envelope(abs(c), t - 1.0), lambda t: c)
    below = next(0.01 * k for k in range(600) if envelope(abs(c), 0.01 * k - 1.0) < FAILS * abs(c))
    assert when == pytest.approx(below + FAILS_FOR, abs=2 * PERIOD)


@pytest.mark.parametrize(
    ("v", "asked"),
    [
        (lambda t: min(0.2 * t, 1.0), lambda t: 1.0),  # it starts slowly
        (lambda t: 0.3, lambda t: 0.3 if t < 2.0 else 1.0),  # it does not follow a rise yet
        (lambda t: 1.0 if t < 2.0 else 0.1 if t < 2.4 else 0.4, lambda t: 1.0 if t < 2.0 else 0.4),  # it brakes
        (lambda t: 0.6 if t < 2.0 else max(0.6 - 2.0 * (t - 2.0), -0.6), lambda t: 0.6 if t < 2.0 else -0.6),
        (lambda t: 0.6 if int(t / PERIOD) % 3 else 0.2, lambda t: 0.6),  # a reading now and then
        (lambda t: 0.7, lambda t: 1.0),  # uphill
        (lambda t: 0.0, lambda t: 0.05),
    ],
    ids=["starts", "rises", "brakes", "turns", "noise", "uphill", "slow"],
)
def test_nothing_else_fails(v: Callable[[float], float], asked: Callable[[float], float]) -> None:
    assert first_failure(v, asked) is None


def test_a_command_that_trembles_is_a_constant_one() -> None:
    def asked(t: float) -> float:
        return 1.0 - 0.05 * (int(t / PERIOD) % 2)

    assert first_failure(lambda t: envelope(1.0, t - 1.0), asked) is not None


def test_whoever_begins_anew_has_to_reach_the_command_anew() -> None:
    watch = Obedience()
    assert not watch.fails(0.0, 1.0, 1.0)
    assert not watch.fails(0.1, 1.0, 0.0)
    assert not any(watch.fails(0.2 + PERIOD * k, 0.0, 1.0) for k in range(40))


# -- readings sixteen times a second: (speed, command), m/s -------------------------------------------------------

TICK = 0.0625
COASTS = (1.0, 0.7, 0.55, 0.45, 0.4, 0.4, 0.4)
"""Shares of the command: it is below half of it from the fourth on."""


def fails_at(*rows: tuple[float, float]) -> int | None:
    """The number of the first reading at which it fails, from 0; None: never."""
    watch = Obedience()
    found = [watch.fails(TICK * k, v, asked) for k, (v, asked) in enumerate(rows)]
    return found.index(True) if True in found else None


@pytest.mark.parametrize("asked", [0.1, 0.5, 1.0, -0.6])
def test_a_car_below_half_of_its_command_for_an_eighth_of_a_second_fails(asked: float) -> None:
    assert fails_at(*((share * asked, asked) for share in COASTS)) == 5
    assert fails_at(*((share * asked, asked) for share in (0.8, *COASTS[1:]))) == 5, "80 % is enough"
    assert fails_at(*((share * asked, asked) for share in (0.79, *COASTS[1:]))) is None, "it never got there"


def test_short_falls_do_not_add_up_and_half_of_the_command_is_enough() -> None:
    assert fails_at(*((v, 1.0) for v in (1.0, 0.7, *(0.55, 0.45, 0.45) * 5))) is None
    assert fails_at(*((v, 1.0) for v in (1.0, 0.7, *[0.5] * 20))) is None


def test_a_fall_within_a_tenth_of_a_second_is_a_wall_and_a_slower_one_is_not() -> None:
    assert fails_at(*((v, 1.0) for v in (1.0, 1.0, *[0.4] * 20))) is None
    assert fails_at(*((v, 1.0) for v in (1.0, 0.7, *[0.4] * 20))) == 4
    assert fails_at(*((v, 1.0) for v in (1.0, 0.5, *[0.4] * 20))) == 4


def test_a_command_that_is_too_slow_to_judge_is_not_judged() -> None:
    assert fails_at(*((0.05 * share, 0.05) for share in (*COASTS, *[0.0] * 20))) is None


@pytest.mark.parametrize("later", [0.6, -0.3])
def test_a_command_that_rose_or_turned_round_has_to_be_reached_anew(later: float) -> None:
    before = [(0.3, 0.3), *[(0.23, 0.3)] * 4]
    assert fails_at(*before, *[(0.23, later)] * 30) is None
    assert fails_at(*before, *((share * later, later) for share in COASTS)) == 10


def test_after_a_command_was_lowered_the_loops_may_overshoot_for_half_a_second() -> None:
    before = [(1.0, 1.0), (1.0, 1.0)]
    overshoots = [0.6, 0.45, 0.4, 0.28, 0.2, 0.2, 0.2]
    assert fails_at(*before, *((v, 0.6) for v in (*overshoots, *[0.6] * 20))) is None
    assert fails_at(*before, *((v, 0.6) for v in (*overshoots, *[0.2] * 20))) == 2 + 8 + 2


def test_the_overshoot_begins_when_the_car_has_come_down_however_long_that_takes() -> None:
    before = [(1.0, 1.0), (1.0, 1.0)]
    coasts = [1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.45, 0.4, 0.38]
    overshoots = [0.3, 0.2, 0.14, 0.1, 0.08, 0.1, 0.14, 0.2]
    assert fails_at(*before, *((v, 0.3) for v in (*coasts, *overshoots, *[0.3] * 20))) is None
    stays = [0.3, 0.2, 0.16, *[0.1] * 20]
    assert fails_at(*before, *((v, 0.3) for v in (*coasts, *stays))) == 1 + len(coasts) + 8 + 2
    hardly = [0.37, 0.3, 0.2, 0.16, *[0.1] * 20]
    assert fails_at((0.3, 0.3), *((v, 0.3) for v in hardly)) == 5 + 2


def test_a_command_that_was_lowered_to_less_than_the_car_does_may_be_overshot() -> None:
    before = [(0.4, 0.4), (0.4, 0.4), (0.25, 0.25)]
    assert fails_at(*before, *((v, 0.25) for v in (0.2, 0.15, 0.1, 0.1, 0.1, 0.12, *[0.25] * 20))) is None


def test_a_car_that_turns_round_was_not_faster_than_its_new_command() -> None:
    assert fails_at((1.0, 1.0), (1.0, 1.0), *((-0.6 * share, -0.6) for share in COASTS)) == 2 + 5
