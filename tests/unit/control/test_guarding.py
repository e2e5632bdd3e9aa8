"""A guard that fails closes: from then on the set-point is 0, and its failure is told once."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import pytest

from txt1.control.guarding import contained


def test_a_guard_that_does_its_work_is_let_alone() -> None:
    told: list[tuple[float, str]] = []
    guard = contained("half", lambda v, omega, now: (0.5 * v, omega * now), lambda *event: told.append(event))
    assert [guard(1.0, 2.0, 3.0), guard(0.8, 0.5, 2.0)] == [(0.5, 6.0), (0.4, 1.0)]
    assert told == []


@pytest.mark.parametrize("answer", [None, 1.0, (1.0,), (1.0, 2.0, 3.0), ("a", "b"), (nan, 1.0), (1.0, inf)])
def test_an_answer_that_is_not_two_finite_numbers_stops_the_robot_for_good(answer: Any) -> None:
    told: list[tuple[float, str]] = []
    answers = [answer, (1.0, 1.0)]
    guard = contained("wrong", lambda v, omega, now: answers.pop(0), lambda *event: told.append(event))
    assert [guard(1.0, 1.0, 4.0), guard(1.0, 1.0, 5.0)] == [(0.0, 0.0), (0.0, 0.0)]
    assert told == [(4.0, f"guard 'wrong' failed: it returned {answer!r}; the robot stands for the rest of the run")]
    assert answers == [(1.0, 1.0)], "it is not asked again"


def test_one_that_fails_says_why_once() -> None:
    ends: list[str] = []
    guard = contained("bad", lambda v, omega, now: (0.0, 1 / 0), lambda *event: None, ends.append)
    assert [guard(1.0, 1.0, 4.0), guard(1.0, 1.0, 5.0)] == [(0.0, 0.0), (0.0, 0.0)]
    assert ends == ["ZeroDivisionError: division by zero"]


def test_one_that_raises_stops_it_too() -> None:
    told: list[tuple[float, str]] = []
    speeds = dict.fromkeys((1.0, 2.0), 0.0)
    guard = contained("bad", lambda v, omega, now: (speeds[now], omega), lambda *event: told.append(event))
    assert [guard(1.0, 1.0, 4.0), guard(1.0, 1.0, 5.0)] == [(0.0, 0.0), (0.0, 0.0)]
    assert told == [(4.0, "guard 'bad' failed: KeyError: 4.0; the robot stands for the rest of the run")]
