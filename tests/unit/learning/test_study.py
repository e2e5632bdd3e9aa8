"""The study of where the time goes looks on and changes nothing."""

from __future__ import annotations

import pytest

from benchmarks.learning_study import SLOW, is_right, trial, watched, where
from txt1.config import load

CONFIG = load().config


@pytest.mark.long
def test_who_is_watched_does_the_same_and_all_its_time_is_accounted_for() -> None:
    episodes, decisions = watched(1, CONFIG, 1, 12)
    assert episodes == trial(1, "thesis", CONFIG, 1, 12, permute=False)
    found = where(decisions)
    for name, some in (
        ("slow", [one for one in episodes[7:] if one.time > SLOW]),
        ("other", [one for one in episodes[7:] if one.time <= SLOW]),
    ):
        assert found[name]["robot_seconds"] == pytest.approx(sum(one.time for one in some))
        for parts in ("cause: ", "distance: ", "episodes "):
            shares = [part["share_of_time"] for key, part in found[name].items() if key.startswith(parts)]
            assert sum(shares) == pytest.approx(1.0, abs=0.005)


def test_the_right_action_turns_to_the_light_and_goes_straight_when_ahead() -> None:
    right = {state: [action for action in range(3) if is_right(action, state)] for state in range(8)}
    assert right == {0: [0, 2], 1: [0], 2: [0], 3: [0], 4: [1], 5: [2], 6: [2], 7: [2]}
