"""The sides of a vehicle that steers by them, and back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.model.vehicle import outputs_of, sides

counts = st.floats(-24000.0, 24000.0)


@given(counts, counts)
def test_what_sides_mean_is_what_they_were_made_of(motor: float, steering: float) -> None:
    assert outputs_of(*sides(motor, steering)) == pytest.approx((motor, steering), abs=1e-9)


def test_a_motor_drives_both_sides_and_three_counts_of_steering_are_one_to_the_left() -> None:
    assert sides(3000.0, 0.0) == (3000.0, 3000.0)
    assert sides(0.0, 9000.0) == pytest.approx((3000.0, -3000.0))
