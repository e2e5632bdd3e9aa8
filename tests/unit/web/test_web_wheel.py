"""The age of a page's command, its number, its budget, and which page has the wheel."""

from __future__ import annotations

from math import inf, isinf, nan

from hypothesis import example, given
from hypothesis import strategies as st

from txt1.web.budgets import Budget
from txt1.web.wheel import COMMAND_AGE_MAX, IDLE, ROUND_TRIPS, PageClock, PageWheel, Sequence

seconds = st.floats(0.0, 1e6)
delays = st.floats(0.0, 5.0)


@example(offset=1.8115690785925835, trips=[(48567.0, 0.0, 4.0), (999999.9999999999, 4.018848797977823, 0.0)], late=0.0)
@given(offset=st.floats(-1e6, 1e6), trips=st.lists(st.tuples(seconds, delays, delays), min_size=1), late=delays)
def test_a_command_is_never_taken_for_younger_than_it_is(
    offset: float, trips: list[tuple[float, float, float]], late: float
) -> None:
    clock = PageClock()
    now = 0.0
    for pause, there, back in trips:
        sent = now + pause
        now = sent + there + back
        clock.answered(sent, sent + there + offset, now)
    origin = now + 1.0
    age = clock.age(origin + offset, origin + late)
    assert age >= late - 1e-6
    assert age <= late + min(there + back for _, there, back in trips[-ROUND_TRIPS:]) + 1e-6


@given(offset=st.floats(-1e5, 1e5), jump=st.floats(10.0, 1e5), there=st.floats(0.0, 0.1), back=st.floats(0.0, 0.1))
def test_a_page_whose_clock_jumped_is_measured_anew(offset: float, jump: float, there: float, back: float) -> None:
    clock = PageClock()
    clock.answered(0.0, 0.05 + offset, 0.1)
    for sent in (1.0, 2.0):
        clock.answered(sent, sent + there + offset + jump, sent + there + back)
    assert 0.0 <= clock.age(3.0 + offset + jump, 3.0 + 0.01) <= 0.01 + there + back + 1e-3


def test_before_a_page_has_answered_every_command_is_late() -> None:
    clock = PageClock()
    assert isinf(clock.age(1.0, 1.0))
    clock.answered(1.0, 5.0, 1.1)
    assert clock.age(5.0, 1.1) < inf
    for time in (nan, inf, -inf):
        assert isinf(clock.age(time, 1.2))


def test_what_an_answer_cannot_be_is_ignored() -> None:
    clock = PageClock()
    for sent, page, now in ((2.0, 5.0, 1.0), (1.0, nan, 2.0), (1.0, inf, 2.0)):
        clock.answered(sent, page, now)
        assert isinf(clock.age(5.0, 2.0))


def test_half_a_second_that_a_page_s_clock_jumps_is_noticed() -> None:
    clock = PageClock()
    clock.answered(0.0, 0.005, 0.01)
    clock.answered(1.0, 1.505, 1.01)
    assert 0.0 <= clock.age(1.505, 1.01) <= 0.011


def test_a_page_counts_from_zero_as_far_as_it_can_count() -> None:
    exact = 2**53 - 1  # JavaScript's largest
    assert [Sequence().accepts(number) for number in (-1, 0, exact, exact + 1)] == [False, True, True, False]


def test_the_wheel_is_free_at_first_and_again_after_ten_idle_seconds() -> None:
    wheel = PageWheel()
    assert wheel.holder == 0 and wheel.take(2, True, 0.0)
    wheel.drove(5.0)
    assert [wheel.take(3, True, now) for now in (5.0, 14.9, 15.0)] == [False, False, True]


@given(st.lists(st.integers(-5, 50) | st.none() | st.text(max_size=2) | st.booleans() | st.floats()))
def test_only_rising_numbers_pass(numbers: list[object]) -> None:
    sequence, passed = Sequence(), []
    for number in numbers:
        if sequence.accepts(number):
            passed.append(number)
    assert all(isinstance(number, int) and not isinstance(number, bool) for number in passed)
    assert passed == sorted(set(passed))  # type: ignore[type-var]


@given(st.lists(st.floats(0.0, 0.2), max_size=300))
def test_a_budget_is_never_overdrawn(pauses: list[float]) -> None:
    budget, now, spent = Budget(10.0, 20.0), 0.0, 0
    for pause in pauses:
        now += pause
        spent += budget.spend(now)
        assert spent <= 20.0 + 10.0 * now + 1e-6
    assert Budget(10.0, 20.0).spend(0.0)


moves = st.lists(st.tuples(st.sampled_from(["take", "drove", "give"]), st.integers(1, 4), st.floats(0.0, 15.0)))


@given(moves)
def test_the_wheel_changes_hands_only_when_it_is_given_or_idle_or_by_rank(steps: list[tuple[str, int, float]]) -> None:
    wheel, now, last = PageWheel(), 0.0, -inf
    for what, page, pause in steps:
        now += pause
        before = wheel.holder
        operator, operated = page % 2 == 0, before % 2 == 0
        if what == "give":
            wheel.give(page)
            assert wheel.holder == (0 if before == page else before)
        elif what == "drove" and before == page:
            wheel.drove(now)
            last = now
        elif what == "take":
            had = wheel.take(page, operator, now)
            assert had == (wheel.holder == page)
            if before not in (0, page):
                idle = now - last >= IDLE
                assert had == (operator > operated or (operator == operated and idle))
                assert had or wheel.why(operator).startswith(f"page {before} ")
            if had and before != page:
                last = now


def test_a_late_command_is_one_that_the_gate_would_not_obey() -> None:
    from txt1.control.parameters import Safety

    assert Safety().command_timeout == COMMAND_AGE_MAX
