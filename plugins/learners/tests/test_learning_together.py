"""What the pilot and sweeps share, and robots of one process that learn together."""

from __future__ import annotations

import numpy as np
import pytest

from tests.lessons import Lessons
from txt1.config import load
from txt1.fleet.shared_knowledge import learned_of
from txt1.kernel.loop import run
from txt1_learners.action_effects import Effects
from txt1_learners.pilot import PilotAgent
from txt1_learners.sensor_map import HEIGHT
from txt1_learners.sharing import Sharing, sharer
from txt1_learners.studies.team import learn_together
from txt1_learners.sweeps import SweepsAgent


def test_the_pilot_and_sweeps_share() -> None:
    for agent in (SweepsAgent(np.random.default_rng(0)), pilot()):
        assert sharer(agent.name, agent) is agent


def driven(k: float, c: list[float], decisions: int = 200, seed: int = 0) -> Effects:
    """Of a robot whose distance and curvature follow the law."""
    effects, rng = Effects(3, 5), np.random.default_rng(seed)
    distance = curvature = 0.0
    for _ in range(decisions):
        a = int(rng.integers(3))
        after = k * distance + 0.03, k * curvature + c[a]
        effects.learn(np.array([a] * 5), (distance, after[0]), (curvature, after[1]), 0.99)
        distance, curvature = after
    return effects


@pytest.mark.long  # compiles
def test_what_actions_do_is_taken_over_and_learned_on() -> None:
    known, new = driven(0.6, [-0.5, 0.0, 0.5]), Effects(3, 5)
    new.take(known.numbers(5))
    for name in ("k", "c", "error"):
        assert getattr(new, name) == pytest.approx(getattr(known, name))
    for one in (known, new):
        one.learn(np.array([2] * 5), (0.07, 0.07), (0.3, 0.68), 0.99)
    assert new.k == pytest.approx(known.k, abs=1e-3) and new.c == pytest.approx(known.c, abs=1e-3)


def pilot(seed: int = 0) -> PilotAgent:
    return PilotAgent(np.random.default_rng(seed))


def skilled(seed: int = 0) -> PilotAgent:
    agent = pilot(seed)
    agent.survey[:4], agent.survey[5:13] = 7.0, (0.2, 0.1, 0.2, -0.1, -0.2, 0.1, -0.2, -0.1)
    agent.goal, agent.lost = 0.5, False
    agent.effects.k[:], agent.effects.c[..., :3] = 0.6, (-0.5, 0.0, 0.5)
    agent.effects.sums[..., [0, 1, 3]] = 10.0, 1.0, 0.5
    return agent


def test_a_pilot_tells_nothing_while_it_is_lost_and_takes_over_only_then() -> None:
    lost, able = pilot(), skilled()
    assert lost.shared().visits == (0,) and able.shared().visits == (1,)
    assert learned_of(able.shared()._asdict()) == able.shared()
    lessons = Lessons()
    told: list[str] = []
    parts = Sharing(lost, lessons.of("lost"), tell=told.append), Sharing(able, lessons.of("able"))
    before = able.memory()
    for part in parts:
        part.episode_over()
    for part in parts:
        part.episode_begins()
    assert told == ["took over 1 of 1 rows from 1: able"]
    assert not lost.lost and lost.goal == 0.5 and lost.survey.tolist() == able.survey.tolist()
    assert lost.effects.k == pytest.approx(able.effects.k)
    assert able.memory() == before, "what it has measured on itself it keeps"


def test_a_pilot_refuses_a_survey_that_cannot_be() -> None:
    for place, value in [*((place, -1e6) for place in range(21)), (HEIGHT, -1.0)]:
        rows, agent = np.array(skilled().shared().rows), pilot()
        rows[0, place] = value
        assert agent.take(rows, np.array([True]), 0) == 0 and agent.lost


def test_sweeps_takes_over_how_actions_turn_the_robot_that_it_has_not_tried() -> None:
    able, new = (SweepsAgent(np.random.default_rng(seed)) for seed in range(2))
    for _ in range(20):
        for a, (w, after) in enumerate(((0.0, -0.3), (0.2, 0.1), (0.1, 0.4))):
            able.model.learn(a, w, after)
            able.model.learn(a, after, 0.5 * after + (after - 0.5 * w))
    own = new.model
    for _ in range(6):
        own.learn(1, 0.3, 0.2)
    kept = own.sums[1].copy()
    assert new.take(able.model.rows(), np.array([True, True, False]), 3) == 1
    found, meant = np.array(own.coefficients()), np.array(able.model.coefficients())
    assert found[:, 0] == pytest.approx(meant[:, 0], abs=3e-3)
    assert (own.sums[1] == kept).all() and own.count.tolist() == [6, 6, 0]
    assert new.shared().visits == (6, 6, 0) and new.q.any()


# -- on robots -------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("learner", ["thesis", "sweeps", "pilot"])
def test_a_team_that_learns_together_repeats(learner: str) -> None:
    config = load(None, ["learning.time_limit=10"]).config
    team = ["txt01", "txt02"]

    def episodes() -> object:
        lessons = Lessons()
        join = lambda name, agent: Sharing(agent, lessons.of(name))  # noqa: E731
        return run(learn_together(config, 1, team, 2, join, learner), speed="max")

    together = episodes()
    assert together == episodes()
    assert [len(each) for each in together.values()] == [2, 2]  # type: ignore[attr-defined]
