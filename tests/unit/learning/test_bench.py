"""The bare simulation is the running robot, to the last bit."""

from __future__ import annotations

import pytest

from txt1.config import load
from txt1.learning.agents import NAMES
from txt1.learning.conduct import Outcome, on_bench, on_robot

CONFIG = load().config


def paths(one: Outcome) -> list[tuple[float, float]]:
    return [point for path in one.paths.values() for point in path]


@pytest.mark.parametrize("agent", NAMES)
def test_a_trial_is_the_same_on_the_robots_tasks_and_on_the_bare_simulation(agent: str) -> None:
    kept = range(1, 6)
    robot = on_robot(agent, CONFIG, 7, 3, 5, keep_paths=kept)
    bare = on_bench(agent, CONFIG, 7, 3, 5, keep_paths=kept)
    assert robot.complete
    assert bare.complete
    assert paths(robot) == paths(bare), "20 true positions a second, without any tolerance"
    assert len(paths(robot)) > 400
    assert robot.episodes == bare.episodes
    assert robot.table.values.tolist() == bare.table.values.tolist()


def test_a_trial_repeats_from_its_seed_and_another_seed_is_another_trial() -> None:
    one, same, other = (on_bench("sweeps", CONFIG, seed, 1, 2) for seed in (5, 5, 6))
    assert one.episodes == same.episodes != other.episodes
