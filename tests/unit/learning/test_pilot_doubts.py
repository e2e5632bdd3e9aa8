"""The pilot says that its model does not fit where the world is another than it takes it for, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import pytest

from studies.learners import lockstep
from txt1.config import load
from txt1.learning.agents import make
from txt1.learning.pilot import chi_square
from txt1.learning.trial import Trial

WORLDS = Path(__file__).parents[3] / "config" / "worlds"
SWAPPED = (
    "learning.changes=[{episode: 3, set: {learning.actions: [[0.3, 0.5357142857142857], [0.3, 0.0], "
    "[0.3, -0.5357142857142857]]}}]"
)
FLICKERS = "learning.world_options={lamps: [{flicker: 0.5, flicker_period: 2.0}]}"


def done(count: int, episodes: int, seed: int, *settings: str) -> list[Trial]:
    config = lockstep.asked_alike(load(WORLDS / "thesis.yaml", settings).config)
    return lockstep.trials(config, lambda rng: make("pilot", config, rng), range(1, count + 1), episodes, seed)


@pytest.mark.parametrize(("count", "alarm", "tabled"), [(1, 0.05, 3.841), (50, 0.001, 86.661), (200, 0.01, 249.445)])
def test_the_quantile_is_that_of_the_tables(count: int, alarm: float, tabled: float) -> None:
    assert chi_square(count, alarm) == pytest.approx(tabled, rel=0.03)


@pytest.mark.long
def test_in_its_own_world_it_never_says_so_in_800_episodes() -> None:
    said = [one.unfit for trial in done(200, 4, 12) for one in trial.episodes]
    assert said == [None] * 800


@pytest.mark.long
def test_actions_that_are_swapped_are_said_mostly_within_5_s() -> None:
    quick = 0
    for trial in done(2, 3, 13, SWAPPED):
        *before, swapped = trial.episodes
        assert [one.unfit for one in before] == [None, None]
        assert swapped.unfit is not None
        quick += swapped.unfit <= 5.0
    assert quick


@pytest.mark.long
def test_a_lamp_that_flickers_is_said_within_5_s_in_each_episode() -> None:
    for trial in done(2, 2, 14, "learning.world=composed", FLICKERS):
        assert all(one.unfit is not None and one.unfit <= 5.0 for one in trial.episodes)
