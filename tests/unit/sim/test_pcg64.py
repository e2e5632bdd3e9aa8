"""The generator of random numbers without numpy draws what numpy's draws."""

import json

import numpy as np
import pytest

from txt1.sim.pcg64 import FRACTION, MULTIPLIER, STRIPS, Pcg64, _ziggurat

SEEDS = [(0,), (1, 1, 3), (2**32, 5), (777, 2**70, 0, 1, 9, 12), ()]


def numpys(seed: tuple[int, ...]) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed))


@pytest.mark.parametrize("seed", SEEDS)
def test_it_draws_what_numpy_draws_in_any_order(seed: tuple[int, ...]) -> None:
    ours, theirs = Pcg64(seed), numpys(seed)
    for _ in range(300):
        assert ours.random() == theirs.random()
        for count in (1, 2, 3, 1000, 3 * 2**30, 2**32):
            assert ours.integers(count) == theirs.integers(count)
        assert ours.uniform(-0.1, 0.3, 5) == theirs.uniform(-0.1, 0.3, 5).tolist()
        assert ours.standard_normal(50) == theirs.standard_normal(50).tolist()
    assert ours.state == theirs.bit_generator.state


def test_normal_numbers_are_numpys_in_every_strip_at_both_ends_of_its_rectangle() -> None:
    ours, theirs = Pcg64((1,)), numpys((1,))
    state, back = ours.state, pow(MULTIPLIER, -1, 2**128)
    _, inside, _ = _ziggurat()
    for strip in range(STRIPS):
        for place in (0, 1, inside[strip] - 1, inside[strip], inside[strip] + 1, FRACTION - 1):
            for sign in (0, 256):
                # of this state's bits the next number is made
                bits = max(place, 0) << 9 | sign | strip
                state["state"]["state"] = (bits - state["state"]["inc"]) * back % 2**128
                ours.state = theirs.bit_generator.state = state
                assert ours.standard_normal(2) == theirs.standard_normal(2).tolist()


def test_a_stream_goes_on_from_its_state_here_and_in_numpy() -> None:
    one = Pcg64((4, 2))
    one.integers(3)
    kept = json.loads(json.dumps(one.state))
    other = Pcg64((0,))
    other.bit_generator.state = kept
    numbers = one.numpy()
    drawn = [(one.integers(7), one.random()) for _ in range(5)]
    assert [(other.integers(7), other.random()) for _ in range(5)] == drawn
    assert [(numbers.integers(7), numbers.random()) for _ in range(5)] == drawn
