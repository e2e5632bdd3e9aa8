"""The simulation's random streams are repeatable, independent and of the distributions that are asked for."""

from __future__ import annotations

from itertools import pairwise
from statistics import fmean, pstdev

import pytest

from txt1.sim.random_streams import random_stream


def gaussian(count: int, seed: int, *name: str) -> list[float]:
    stream = random_stream(seed, *name)
    return [stream.gauss() for _ in range(count)]


def correlation(one: list[float], other: list[float]) -> float:
    return fmean(a * b for a, b in zip(one, other, strict=True))


def test_a_stream_is_the_same_on_every_computer_and_in_every_process() -> None:
    """Recordings and tables of results hold for these numbers."""
    stream = random_stream(1, "drag")
    assert [stream.random() for _ in range(3)] == [0.6143978639804346, 0.43064431224021726, 0.6261900633020117]


@pytest.mark.parametrize("other", [(2, "drag"), (1, "battery"), (1, "drag", ""), (-1, "drag")])
def test_another_seed_or_name_gives_an_independent_stream(other: tuple[int, str]) -> None:
    count = 20_000
    one, two = gaussian(count, 1, "drag"), gaussian(count, *other)
    for shift in range(3):
        assert abs(correlation(one[shift:], two[: count - shift])) < 4.0 / count**0.5


def test_where_a_name_ends_matters() -> None:
    assert gaussian(1, 1, "a", "bc") != gaussian(1, 1, "ab", "c")
    assert gaussian(1, 1, "1") != gaussian(1, 11, "")


@pytest.mark.parametrize("seed", range(4))
def test_its_noise_is_white_and_of_the_standard_deviation_1(seed: int) -> None:
    count = 20_000
    noise = gaussian(count, seed, "drag")
    assert abs(fmean(noise)) < 4.0 / count**0.5
    assert pstdev(noise) == pytest.approx(1.0, abs=4.0 / (2.0 * count) ** 0.5)
    for lag in (1, 2, 3, 50):
        assert abs(correlation(noise[lag:], noise[: count - lag])) < 4.0 / count**0.5
    assert sum(a < b for a, b in pairwise(noise)) == pytest.approx(0.5 * count, abs=2.0 * count**0.5)
