"""The pilot says that its model does not fit where the world is another than it takes it for, and seldom elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from txt1.config import load
from txt1.learning.registry import make
from txt1.learning.trial import Trial
from txt1.learning.world_presets import world_named
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1_learners.pilot import PilotAgent, chi_square, create
from txt1_learners.studies import lockstep

SWAPPED = (
    "learning.changes=[{episode: 3, set: {learning.actions: [[0.3, 0.5357142857142857], [0.3, 0.0], "
    "[0.3, -0.5357142857142857]]}}]"
)
FAST_LAMP = "learning.world_options={lamps: [{velocity: [0.09, 0.12]}]}"
SWINGS = "learning.world_options={lamps: [{height: 2.0, swing: [0.3, 0.3], period: 2.8}]}"


def done(count: int, episodes: int, seed: int, *settings: str) -> list[Trial]:
    config = lockstep.asked_alike(load(None, settings).config)
    return lockstep.trials(config, lambda rng: make("pilot", config, rng), range(1, count + 1), episodes, seed)


@pytest.mark.parametrize(("count", "alarm", "tabled"), [(1, 0.05, 3.841), (50, 0.001, 86.661), (200, 0.01, 249.445)])
def test_the_quantile_is_that_of_the_tables(count: int, alarm: float, tabled: float) -> None:
    assert chi_square(count, alarm) == pytest.approx(tabled, rel=0.03)


@pytest.mark.long
def test_in_its_own_world_it_says_so_in_few_of_800_episodes() -> None:
    episodes = [one for trial in done(200, 4, 12) for one in trial.episodes]
    # after a slow one it says so at the starts of five
    said = [one.time > 1.5 * one.optimal_time for one in episodes if one.unfit]
    again = [one for one in episodes if one.unfit == 0.0]
    assert len(said) <= 10 and len(again) <= 15
    assert sum(said) > 0.5 * len(said)


@pytest.mark.long
def test_actions_that_are_swapped_are_said_mostly_within_5_s_and_soon_learned_anew() -> None:
    swapped = []
    for trial in done(8, 3, 13, SWAPPED):
        *before, last = trial.episodes
        assert [one.unfit for one in before] == [None, None]
        swapped.append(last)
    assert sum(one.unfit is not None and one.unfit <= 5.0 for one in swapped) >= 6
    # about a hundred decisions were forgotten before what is new counted more
    assert np.median([one.time - one.optimal_time for one in swapped]) < 10.0


@pytest.mark.long
def test_after_left_and_right_are_swapped_it_knows_both_again() -> None:
    for trial in done(8, 5, 14, SWAPPED):
        effects = trial.agent.effects
        delay = int(effects.error.argmin())
        left, _, right, _ = effects.c[delay, 1] / (1.0 - effects.k[delay, 1])
        assert left > 1.0 and right < -1.0


@pytest.mark.long
def test_most_episodes_that_a_lamp_that_swings_far_makes_slow_are_said_within_5_s() -> None:
    episodes = [one for trial in done(4, 12, 14, "learning.world=composed", SWINGS) for one in trial.episodes[1:]]
    slow = [one.unfit is not None and one.unfit <= 5.0 for one in episodes if one.time > 1.5 * one.optimal_time]
    assert len(slow) >= 5 and sum(slow) >= 0.75 * len(slow)


@pytest.mark.long
def test_most_episodes_that_a_lamp_on_the_move_makes_slow_are_said() -> None:
    episodes = [one for trial in done(4, 12, 15, "learning.world=composed", FAST_LAMP) for one in trial.episodes[1:]]
    slow = [one.unfit is not None for one in episodes if one.time > 15.0]
    assert len(slow) >= 5
    assert sum(slow) > 0.5 * len(slow)


@pytest.mark.long
def test_a_goal_that_is_nearer_to_the_light_than_it_thought_is_found_soon() -> None:
    config = lockstep.asked_alike(load(world_named("actions-reverse")).config)

    def taught(goals: float) -> float:
        """Time of episodes of a pilot that takes the goal's distance for so many times what it is, s."""

        def agent(rng: np.random.Generator) -> Any:
            table = pupil.agent.table()
            table.about["knows"]["goal"] *= goals
            return create(config, rng, table)

        return sum(one.time for each in lockstep.trials(config, agent, range(1, 7), 4, 24) for one in each.episodes)

    (pupil,) = lockstep.trials(config, lambda rng: make("pilot", config, rng), [1], 12, 24)
    assert taught(1.4) < 1.2 * taught(1.0)


@pytest.mark.long
def test_after_readings_that_fit_nothing_it_goes_by_what_led_to_the_goal_before() -> None:
    class Dazed(PilotAgent):
        """A taught pilot whose sensors show noise after a second of each episode, until it is lost."""

        def __init__(self, rng: np.random.Generator) -> None:
            super().__init__(rng)
            self.recall(taught)
            self.seen, self.was_lost, self.since = 0, False, 0

        def see(self, readings: Readings, odometry: Odometry) -> None:
            self.seen += 1
            self.was_lost = self.was_lost or self.lost
            self.since += self.was_lost
            if self.seen > 60 and not self.was_lost:
                readings = Readings(*np.exp(self._rng.uniform(2.0, 7.0, 4)))
            super().see(readings, odometry)

        def end(self, success: bool, odometry: Odometry) -> None:
            # a second to survey in, and half the readings by which it judges
            if self.since > 210:
                ends.append(not self.lost)
            super().end(success, odometry)

    config = lockstep.asked_alike(load().config)
    (pupil,) = lockstep.trials(config, lambda rng: make("pilot", config, rng), [1], 12, 24)
    taught, ends = pupil.agent.memory(), list[bool]()
    lockstep.trials(config, Dazed, range(1, 33), 1, 24)
    assert len(ends) >= 12 and sum(ends) >= 0.9 * len(ends)
