"""The histogram: percentiles to 3 %, whatever is counted."""

from __future__ import annotations

import sys
from math import ceil

from hypothesis import given
from hypothesis import strategies as st

from txt1.kernel.statistics import Histogram, Percentiles, TaskStatistics

DURATIONS = st.lists(
    st.one_of(st.integers(0, 200), st.integers(0, 10**6), st.integers(0, 10**12), st.integers(0, 2**63)),
    min_size=1,
    max_size=200,
)
SHARES = (0.01, 0.25, 0.5, 0.9, 0.99, 0.999, 1.0)


def histogram_of(samples: list[int]) -> Histogram:
    histogram = Histogram()
    for ns in samples:
        histogram.add(ns)
    return histogram


@given(DURATIONS)
def test_every_percentile_is_the_exact_one_or_at_most_3_percent_above(samples: list[int]) -> None:
    histogram = histogram_of(samples)
    for share in SHARES:
        exact = sorted(samples)[ceil(share * len(samples)) - 1]
        assert exact <= histogram.percentiles_ns(share)[0] <= exact * (1 + 1 / 32)


@given(DURATIONS)
def test_the_maximum_is_exact_and_percentiles_rise_towards_it(samples: list[int]) -> None:
    histogram = histogram_of(samples)
    found = histogram.percentiles_ns(*SHARES)
    assert found == sorted(found)
    assert found[-1] == histogram.max_ns == max(samples)
    assert histogram.count == len(samples)


@given(DURATIONS)
def test_the_summary_agrees_with_the_single_percentiles_in_seconds(samples: list[int]) -> None:
    histogram = histogram_of(samples)
    ns = (*histogram.percentiles_ns(0.5, 0.99, 0.999), histogram.max_ns)
    assert histogram.percentiles() == Percentiles(*(value / 1e9 for value in ns))


@given(st.integers(0, 63))
def test_durations_of_a_few_nanoseconds_are_exact(ns: int) -> None:
    assert histogram_of([ns, 1000]).percentiles_ns(0.5)[0] == ns


def test_without_samples_everything_is_zero() -> None:
    assert Histogram().percentiles() == Percentiles(0.0, 0.0, 0.0, 0.0)
    assert Histogram().percentiles_ns(0.5)[0] == 0
    assert Histogram().count == 0


def test_a_negative_duration_counts_as_none() -> None:
    histogram = histogram_of([-5, -(10**9)])
    assert (histogram.count, histogram.max_ns, histogram.percentiles_ns(1.0)[0]) == (2, 0, 0)


def test_padding_counts_as_many_zeros_as_are_missing() -> None:
    histogram = histogram_of([0, 5, 7])
    histogram.pad(10)
    histogram.pad(10)
    assert (histogram.count, histogram.percentiles_ns(0.8)[0], histogram.percentiles_ns(1.0)[0]) == (10, 0, 7)


def test_a_cycle_whose_lateness_was_not_added_was_in_time() -> None:
    statistics = TaskStatistics()
    statistics.cycles = 100
    statistics.lateness.add(500)
    statistics.cycles += 1
    assert statistics.lateness.count == 101
    assert (statistics.lateness.percentiles_ns(0.5)[0], statistics.lateness.max_ns) == (0, 500)


def room(histogram: Histogram) -> int:
    """Bytes of what it has, but for the numbers themselves."""
    return sum(sys.getsizeof(value) for value in vars(histogram).values() if isinstance(value, list))


def test_a_histogram_never_grows() -> None:
    histogram = Histogram()
    size = room(histogram)
    for bits in range(64):
        histogram.add((1 << bits) - 1)
        histogram.add(1 << bits)
    assert room(histogram) == size


def test_a_task_that_has_not_run_has_done_nothing() -> None:
    statistics = TaskStatistics()
    assert (statistics.cycles, statistics.misses) == (0, 0)
    assert statistics.lateness.percentiles() == statistics.run_time.percentiles() == (0.0, 0.0, 0.0, 0.0)
