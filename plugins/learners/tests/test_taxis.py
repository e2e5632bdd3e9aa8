"""The learner with synapses: what it learns from, and that it learns wherever its sensors sit."""

from __future__ import annotations

import numpy as np
import pytest

from txt1.config import load
from txt1.learning.registry import make
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1_learners import taxis
from txt1_learners.studies.lockstep import trials
from txt1_learners.taxis import TaxisAgent, TaxisSettings

SWAPPED = "sim.light.mount=[[0.2286, -0.127], [0.2286, 0.127], [-0.2286, -0.127], [-0.2286, 0.127]]"


def driven(agent: TaxisAgent, decisions: int, better: int) -> float:
    """Let it drive where one action brightens and the others darken; the share of that action in the second half."""
    agent.begin()
    rng, bright = np.random.default_rng(5), 0.0
    chosen = []
    for k in range(decisions):
        lux = 50.0 * np.exp(bright) * (1.0 + 0.1 * rng.standard_normal(4))
        agent.see(Readings(*lux), Odometry())
        chosen.append(agent.act(0.1 * k, Odometry()))
        bright = float(np.clip(bright + (0.05 if chosen[-1] == better else -0.05), -2.0, 2.0))
    agent.end(True, Odometry())
    return float(np.mean(np.array(chosen[decisions // 2 :]) == better))


@pytest.mark.parametrize("better", [0, 1, 2])
def test_it_comes_to_do_what_brightens(better: int) -> None:
    assert driven(TaxisAgent(np.random.default_rng(1)), 600, better) > 0.5


def test_without_learning_it_does_not() -> None:
    agent = TaxisAgent(np.random.default_rng(1), 3, TaxisSettings(alpha=1e-12, beta=1e-12, longer=0.0))
    assert 0.2 < driven(agent, 600, 1) < 0.47


def test_it_carries_on_from_what_it_kept_and_a_void_episode_leaves_no_trace() -> None:
    one, other = (TaxisAgent(np.random.default_rng(k)) for k in (1, 2))
    driven(one, 50, 1)
    other.recall(one.memory())
    assert other.memory() == one.memory()
    assert driven(one, 50, 1) == driven(other, 50, 1)
    one.begin()
    before = one.memory()
    for k in range(5):
        one.see(Readings(40.0, 50.0, 60.0, 70.0), Odometry())
        one.act(0.1 * k, Odometry())
    assert one.memory() != before
    one.void()
    assert one.memory() == before


def test_stored_synapses_drive_and_change_no_more() -> None:
    one = TaxisAgent(np.random.default_rng(1))
    driven(one, 100, 1)
    driver = taxis.create(load().config, np.random.default_rng(2), one.table())
    driven(driver, 100, 0)
    assert np.array_equal(driver.table().values, one.table().values)


@pytest.mark.long
@pytest.mark.parametrize("setting", ["learning.delay=0", SWAPPED])
def test_after_some_repetitions_it_reaches_the_light_wherever_its_sensors_sit(setting: str) -> None:
    config = load(None, [setting]).config
    every = trials(config, lambda rng: make("taxis", config, rng), range(1, 7), 25, 3)
    late = [one for trial in every for one in trial.episodes[15:]]
    assert sum(one.success for one in late) >= 0.9 * len(late)
