"""The pilot says that its model does not fit where the world is another than it takes it for, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sin
from pathlib import Path

import numpy as np
import pytest

from studies.learners import lockstep
from txt1.config import Config, load
from txt1.learning.agents import make
from txt1.learning.pilot import chi_square
from txt1.learning.planner import Array
from txt1.learning.trial import Pose, Trial
from txt1.model.light_sensors import MOUNT, Readings
from txt1.sim.lamp import PointLight, lux_at, noise_for_jitter

WORLDS = Path(__file__).parents[3] / "config" / "worlds"
SWAPPED = (
    "learning.changes=[{episode: 3, set: {learning.actions: [[0.3, 0.5357142857142857], [0.3, 0.0], "
    "[0.3, -0.5357142857142857]]}}]"
)
Seen = Callable[[Pose, float], Array]  # the four readings without noise, lux, at a pose and a time, s


def flickering(pose: Pose, time: float) -> Array:
    return np.array(lux_at(*pose, PointLight())) * (1.0 + 0.5 * sin(2.0 * pi * 0.5 * time))


class Eyes:
    """Four sensors with the thesis's noise in a light of any kind."""

    def __init__(self, seen: Seen, rng: np.random.Generator) -> None:
        self.seen, self.rng, self.samples = seen, rng, 0

    def __call__(self, pose: Pose) -> Readings:
        self.samples += 1
        noise = 1.0 + noise_for_jitter() * self.rng.standard_normal(len(MOUNT))
        return Readings(*np.clip(self.seen(pose, 0.016 * self.samples) * noise, 1.0, 1000.0).tolist())


def done(count: int, episodes: int, seed: int, *settings: str) -> list[Trial]:
    config = lockstep.asked_alike(load(WORLDS / "thesis.yaml", settings).config)
    return lockstep.trials(config, lambda rng: make("pilot", config, rng), range(1, count + 1), episodes, seed)


def lit(monkeypatch: pytest.MonkeyPatch, seen: Seen) -> None:
    def by_eyes(config: Config) -> bool:
        return True

    def eyes(config: Config, rng: np.random.Generator) -> Eyes:
        return Eyes(seen, rng)

    monkeypatch.setattr(lockstep, "by_eyes", by_eyes)
    monkeypatch.setattr(lockstep, "eyes", eyes)


@pytest.mark.parametrize(("count", "alarm", "tabled"), [(1, 0.05, 3.841), (50, 0.001, 86.661), (200, 0.01, 249.445)])
def test_the_quantile_is_that_of_the_tables(count: int, alarm: float, tabled: float) -> None:
    assert chi_square(count, alarm) == pytest.approx(tabled, rel=0.03)


@pytest.mark.long
def test_in_the_world_that_it_takes_it_for_it_says_nothing() -> None:
    assert [one.unfit for trial in done(2, 2, 11) for one in trial.episodes] == [None] * 4


@pytest.mark.long
def test_in_200_short_trials_it_says_nothing() -> None:
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
def test_a_lamp_that_flickers_is_said_within_5_s_in_each_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    lit(monkeypatch, flickering)
    for trial in done(2, 2, 14):
        assert all(one.unfit is not None and one.unfit <= 5.0 for one in trial.episodes)
