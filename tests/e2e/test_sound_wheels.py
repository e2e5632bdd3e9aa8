"""Wheels of a sound car that spin or lock, or are in the air, are not taken for dead encoders."""

import pytest

from benchmarks.sound_wheels import CASES, taken_for
from txt1.control.limits import LOST


@pytest.mark.parametrize(("kind", "seed"), [("sim", 13), ("sim", 23), ("original", 28)])
def test_wheels_that_swing_on_ice_and_come_to_rest_are_not_lost_sight_of(kind: str, seed: int) -> None:
    """A motor's output against them acts up to a period later, and a car that rolls back stands before it goes."""
    assert LOST not in taken_for(kind, "ice", seed)


# they come down to 0.1 m/s and truly stand for 0.35 s; a longer look would let dead encoders go on (docs/stops.md)
STANDS = {("original", "steps"): [64], ("ours", "patches of ice"): [70]}


@pytest.mark.long
@pytest.mark.parametrize(("kind", "what"), CASES)
def test_sound_cars_that_are_lost_sight_of_in_a_thousand_drives_are_known(kind: str, what: str) -> None:
    assert [seed for seed in range(72) if LOST in taken_for(kind, what, seed)] == STANDS.get((kind, what), [])
