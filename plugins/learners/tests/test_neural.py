"""The learner of the raw readings: its networks' slopes, and that it learns to reach the light."""

from __future__ import annotations

import numpy as np
import pytest

from txt1.config import load
from txt1.learning.registry import make
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1_learners import neural
from txt1_learners.neural import NeuralAgent, NeuralSettings
from txt1_learners.studies.lockstep import trials

CONFIG = load().config


def driven(agent: NeuralAgent, decisions: int) -> None:
    """The agent, after it has seen a light that grows while it goes straight and else fades."""
    agent.begin()
    rng, bright, a = np.random.default_rng(5), 50.0, 0
    for k in range(decisions):
        for _ in range(6):
            agent.see(Readings(*(bright * (1.0 + 0.1 * rng.standard_normal(4)))), Odometry(x=0.03 * k))
        a = agent.act(0.1 * k, Odometry(x=0.03 * k))
        bright *= 1.05 if a == 1 else 0.97
    agent.end(True, Odometry(x=0.03 * decisions))


def test_the_slopes_of_the_networks_are_those_of_differences() -> None:
    rng = np.random.default_rng(1)
    w = neural.initial(rng, 2, 7, 5, 4, 3)
    seen, given = rng.standard_normal((2, 3, 7)), rng.integers(0, 3, (2, 3, 6))
    came, there = rng.standard_normal((2, 3, 6, neural.SEEN)), (rng.random((2, 3, 6)) < 0.8) * 1.0
    _, slopes = neural.slopes_of(w, seen, given, came, there)

    def error(member: int) -> float:
        course, _ = neural.foretell(w, seen, given)
        square = ((course - came) ** 2).sum(axis=-1) * there
        return float(0.5 * square[member].sum() / there[member].sum())

    for name, each in w.items():
        at = tuple(int(rng.integers(n)) for n in each.shape)
        kept, step = each[at], 1e-6
        each[at] = kept + step
        above = error(at[0])
        each[at] = kept - step
        below = error(at[0])
        each[at] = kept
        assert slopes[name][at] == pytest.approx((above - below) / (2.0 * step), rel=1e-4, abs=1e-8), name


@pytest.mark.long
def test_it_comes_to_foretell_what_its_actions_do_and_takes_the_one_that_brightens() -> None:
    agent = NeuralAgent(np.random.default_rng(1), 3, NeuralSettings(ahead=8, steps=6, blind=60))
    for _ in range(3):
        driven(agent, 60)
    agent.begin()
    chosen = []
    for k in range(20):
        for _ in range(6):
            agent.see(Readings(50.0, 50.0, 50.0, 50.0), Odometry(x=0.03 * k))
        chosen.append(agent.act(0.1 * k, Odometry(x=0.03 * k)))
    assert chosen.count(1) > 12


def test_it_carries_on_from_what_it_kept_and_a_void_episode_leaves_no_trace() -> None:
    settings = NeuralSettings(ahead=6, hidden=8, latent=4)
    one, other = (NeuralAgent(np.random.default_rng(k), 3, settings) for k in (1, 2))
    driven(one, 50)
    other.recall(one.memory())
    assert other.memory() == one.memory()
    one.begin()
    before = one.memory()
    for k in range(5):
        one.see(Readings(40.0, 50.0, 60.0, 70.0), Odometry())
        one.act(0.1 * k, Odometry(theta=0.1 * k))
    assert one.memory() != before
    one.void()
    assert one.memory() == before


def test_stored_networks_drive_as_they_did_and_learn_no_more() -> None:
    settings = NeuralSettings(ahead=6, hidden=8, latent=4)
    one = NeuralAgent(np.random.default_rng(1), 3, settings)
    driven(one, 50)
    config = load(None, ["learning.neural={ahead: 6, hidden: 8, latent: 4}"]).config
    driver = neural.create(config, np.random.default_rng(3), one.table())
    weights = driver.table().values
    assert np.array_equal(weights, one.table().values)
    driven(driver, 10)
    assert np.array_equal(driver.table().values, weights)
    with pytest.raises(ValueError, match="needed"):
        neural.create(CONFIG, np.random.default_rng(3), one.table())


@pytest.mark.long
@pytest.mark.parametrize("setting", ["sim.light.noise=null", "learning.delay=0.2"])
def test_after_some_repetitions_it_reaches_the_light(setting: str) -> None:
    config = load(None, [setting]).config
    every = trials(config, lambda rng: make("neural", config, rng), range(1, 4), 12, 3)
    late = [one for trial in every for one in trial.episodes[7:]]
    assert sum(one.success for one in late) >= len(late) - 1
    assert np.median([one.time / one.optimal_time for one in late]) < 1.6
