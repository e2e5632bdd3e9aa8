"""The discharge line (thesis 3.6.3, figure 3.13)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.model.battery import pack_voltage, remaining_time


def test_the_line_has_the_measured_points() -> None:
    assert pack_voltage(0.0) == 12.165769
    assert pack_voltage(10.0) == pytest.approx(12.165769 - 0.33691)
    assert pack_voltage(46.0) == pytest.approx(10.616, abs=5e-4)
    assert pack_voltage(50.0) == pytest.approx(9.25, abs=1e-9)
    assert pack_voltage(48.0) == pytest.approx((10.615983 + 9.25) / 2)
    assert pack_voltage(1000.0) == 9.25


@given(st.floats(0.0, 60.0), st.floats(0.0, 60.0))
def test_a_pack_never_gains_voltage_by_use(one: float, two: float) -> None:
    assert pack_voltage(max(one, two)) <= pack_voltage(min(one, two))


@given(st.floats(0.0, 46.0))
def test_the_remaining_time_is_what_is_left_until_the_safe_end(used: float) -> None:
    assert remaining_time(pack_voltage(used)) == pytest.approx(60 * (46.0 - used), abs=1e-6)


@given(st.floats(0.0, 20.0))
def test_the_remaining_time_is_at_least_nothing_and_at_most_46_minutes(voltage: float) -> None:
    assert 0.0 <= remaining_time(voltage) <= 46 * 60
    if voltage >= 12.165769:
        assert remaining_time(voltage) == 46 * 60
    if voltage <= 10.61:
        assert remaining_time(voltage) == 0.0
