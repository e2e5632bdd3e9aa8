"""Policies and schedules."""

from __future__ import annotations

from math import floor, inf, log10

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.learning.thesis import (
    boltzmann,
    choose,
    fading,
    greedy_action,
    state_learning_rate,
)

Q = np.array([0.2, 0.5, 1.0])


def printed(value: float, digits: int = 3) -> float:
    """The first digits of a number, the rest cut off, as the thesis prints them: 0.99298 as 0.992."""
    scale = 10.0 ** (digits - 1 - floor(log10(value)))
    return floor(value * scale) / scale


# -- the Boltzmann distribution ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("t", "row"),
    [
        (0.1, (3.33e-4, 6.69e-3, 0.992)),
        (0.5, (0.128, 0.234, 0.637)),
        (1.0, (0.218, 0.295, 0.486)),
        (5.0, (0.309, 0.328, 0.362)),
    ],
)
def test_table_5_1_to_its_printed_digits(t: float, row: tuple[float, ...]) -> None:
    assert [printed(p) for p in boltzmann(Q, t)] == pytest.approx(row, rel=1e-12)


def test_cold_is_greedy_and_hot_is_uniform() -> None:
    assert boltzmann(Q, 1e-300) == [0.0, 0.0, 1.0]
    assert boltzmann(Q, 1e300) == pytest.approx([1 / 3] * 3)
    assert boltzmann(Q, inf) == pytest.approx([1 / 3] * 3)
    assert boltzmann(np.array([1.0, 1.0, 0.0]), 1e-9) == [0.5, 0.5, 0.0]


@given(
    st.lists(st.floats(-1e300, 1e300), min_size=1, max_size=6),
    st.sampled_from([0.05, 5.0]) | st.floats(1e-300, 1e300),
)
def test_no_q_and_no_temperature_upsets_it(q: list[float], t: float) -> None:
    p = boltzmann(np.array(q) / 2, t)
    assert np.isfinite(p).all()
    assert sum(p) == pytest.approx(1.0)
    assert p[np.argmax(q)] == max(p)


def test_at_the_floor_of_0_05_large_q_values_are_safe() -> None:
    assert boltzmann(np.array([1e6, 1e6 + 0.05, -1e6]), 0.05) == pytest.approx([0.26894, 0.73106, 0.0], abs=1e-4)


# -- choosing ----------------------------------------------------------------------------------------------------


def test_actions_are_drawn_as_often_as_their_probabilities_say() -> None:
    rng = np.random.default_rng(1)
    counts = np.bincount([choose(boltzmann(Q, 1.0), rng) for _ in range(20_000)], minlength=3)
    assert counts / 20_000 == pytest.approx([0.2186, 0.2950, 0.4864], abs=0.012)


def test_what_has_no_probability_is_never_chosen() -> None:
    rng = np.random.default_rng(1)
    assert {choose([0.0, 1.0, 0.0], rng) for _ in range(1000)} == {1}
    assert {choose([0.5 - 1e-12, 0.5 - 1e-12, 0.0], rng) for _ in range(1000)} == {0, 1}


def test_greedy_takes_the_largest_and_draws_among_equals() -> None:
    rng = np.random.default_rng(1)
    assert {greedy_action(Q, rng) for _ in range(50)} == {2}
    assert {greedy_action(np.array([1.0, 0.0, 1.0]), rng) for _ in range(200)} == {0, 2}
    assert {greedy_action(np.zeros(3), rng) for _ in range(200)} == {0, 1, 2}


def test_the_seed_repeats_every_choice() -> None:
    def choices(seed: int) -> list[int]:
        rng = np.random.default_rng(seed)
        return [choose(boltzmann(Q, 5.0), rng) for _ in range(50)]

    assert choices(1) == choices(1)
    assert choices(1) != choices(2)


def test_a_single_best_action_takes_nothing_from_the_generator() -> None:
    one, other = np.random.default_rng(1), np.random.default_rng(1)
    greedy_action(Q, one)
    assert one.random() == other.random()


# -- schedules ---------------------------------------------------------------------------------------------------


def test_the_temperature_falls_from_5_by_0_65_to_its_floor() -> None:
    temperature = [fading(k, 5.0, 0.65, 0.05) for k in (0, 1, 2, 10, 11, 30, 100_000)]
    assert temperature[:4] == pytest.approx([5.0, 3.25, 2.1125, 5 * 0.65**10])
    assert temperature[3] > 0.05
    assert temperature[4:] == [0.05, 0.05, 0.05]


def test_the_learning_rate_is_constant_or_falls() -> None:
    assert {fading(k, 0.3, 1.0) for k in range(31)} == {0.3}
    assert [fading(k, 1.0, 0.5, 0.2) for k in range(4)] == [1.0, 0.5, 0.25, 0.2]


def test_a_states_learning_rate_falls_with_its_visits() -> None:
    assert [state_learning_rate(n) for n in (0, 10, 90)] == [1.0, 0.5, 0.1]
