"""Gain scheduling (thesis 4.3)."""

from __future__ import annotations

from math import inf, nextafter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.control.pid import Gains
from txt1.control.schedule import ANGULAR_GAINS, LINEAR_GAINS, GainSet, Schedule

THESIS = Schedule(ANGULAR_GAINS)


@pytest.mark.parametrize("k", range(14))
def test_a_set_is_in_force_up_to_and_including_its_v_max(k: int) -> None:
    v_max, gains = ANGULAR_GAINS[k]
    assert THESIS.at(v_max) == gains
    assert THESIS.at(nextafter(v_max, -inf)) == gains
    assert THESIS.at(nextafter(v_max, inf)) == ANGULAR_GAINS[min(k + 1, 13)].gains


def test_below_the_first_set_the_first_and_past_the_end_the_last_is_in_force() -> None:
    assert THESIS.at(-9.0) == ANGULAR_GAINS[0].gains
    assert THESIS.at(9.0) == ANGULAR_GAINS[-1].gains


@given(st.floats(-3.0, 3.0), st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=14, unique=True))
def test_the_first_set_whose_v_max_reaches_v_is_in_force(v: float, limits: list[float]) -> None:
    sets = tuple(GainSet(v_max, Gains(float(k), 0.0, 0.0)) for k, v_max in enumerate(sorted(limits)))
    expected = next((s.gains for s in sets if s.v_max >= v), sets[-1].gains)
    assert Schedule(sets).at(v) == expected


def test_the_thesis_gains_are_those_of_table_4_1() -> None:
    v_max = [-1.35, -1.15, -0.95, -0.75, -0.55, -0.35, -0.15, 0.15, 0.35, 0.55, 0.75, 0.95, 1.15, 1.35]
    assert [s.v_max for s in ANGULAR_GAINS] == v_max
    assert [s.gains.kp for s in ANGULAR_GAINS] == [1, 1, 1, 1, 1, 1, 1, 6, 6, 4, 3, 4, 4, 4]
    assert [s.gains.ki for s in ANGULAR_GAINS] == [25, 25, 25, 35, 40, 50, 30, 200, 170, 130, 80, 60, 30, 20]
    assert {s.gains.kd for s in ANGULAR_GAINS} == {0.005}
    assert LINEAR_GAINS == (11.0, 18.0, 0.250)


@given(st.floats(-3.0, 3.0))
def test_an_empty_schedule_steers_nothing(v: float) -> None:
    assert Schedule().at(v) == Gains(0.0, 0.0, 0.0)


def test_more_sets_than_the_board_has_room_for_are_refused() -> None:
    sets = tuple(GainSet(0.1 * k, Gains()) for k in range(15))
    assert Schedule(sets[:14]).sets == sets[:14]
    with pytest.raises(ValueError, match="at most 14 gain sets fit the board, not 15"):
        Schedule(sets)


@pytest.mark.parametrize("limits", [(0.5, 0.5), (0.5, 0.4), (0.1, 0.5, 0.3), (0.1, float("nan"))])
def test_limits_that_do_not_rise_are_refused(limits: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="v_max must rise from set to set"):
        Schedule(tuple(GainSet(v_max, Gains()) for v_max in limits))


def test_schedules_are_equal_when_their_sets_are() -> None:
    assert Schedule(ANGULAR_GAINS) == THESIS
    assert hash(Schedule(ANGULAR_GAINS)) == hash(THESIS)
    assert Schedule() != THESIS
