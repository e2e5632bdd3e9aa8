"""Robots that learn together: merged by the median, so that a liar is outvoted and one who is lost is just missing."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.lessons import Lessons
from txt1.config import load
from txt1.errors import ConfigError
from txt1.learning.agent import Learned, PeriodicAgent
from txt1.learning.thesis import ThesisAgent, create
from txt1_learners.sharing import Sharing, merge, sharer

CONFIG = load().config
NUMBERS = st.floats(-1e6, 1e6)


def learned(value: float, visits: int = 1, rows: int = 3, columns: int = 2) -> Learned:
    return Learned("thesis", 1, (visits,) * rows, ((value,) * columns,) * rows)


# -- merging ---------------------------------------------------------------------------------------------------


@given(st.lists(NUMBERS, min_size=2, max_size=9), st.lists(NUMBERS, max_size=4), st.randoms())
def test_fewer_liars_than_half_move_no_value_beyond_those_of_the_honest(
    honest: list[float], lies: list[float], shuffled: Random
) -> None:
    lies = lies[: len(honest) - 1]
    others = [learned(value) for value in (*honest[1:], *lies)]
    shuffled.shuffle(others)
    merged, taken = merge(learned(honest[0]), others, liars=len(lies))
    assert all(taken) and np.min(merged) >= min(honest) and np.max(merged) <= max(honest)


@given(NUMBERS, st.lists(st.tuples(NUMBERS, st.integers(0, 3)), max_size=6), st.integers(0, 3))
def test_a_row_is_taken_only_from_who_knows_it_and_can_outvote_liars(
    own: float, others: list[tuple[float, int]], liars: int
) -> None:
    merged, taken = merge(learned(own), [learned(value, visits) for value, visits in others], liars)
    know = [value for value, visits in others if visits]
    enough = len(know) + 1 > 2 * min(liars, len(others) // 2) and bool(know)
    assert taken == [enough] * len(taken)
    assert np.all(np.array(merged) == (np.median([own, *know]) if enough else own))


def test_one_liar_cannot_speak_of_what_only_he_and_one_other_know() -> None:
    honest, knows_not, liar = learned(1.0), learned(2.0, visits=0), learned(-9.0)
    merged, taken = merge(honest, [knows_not, liar])
    assert not any(taken) and np.all(np.array(merged) == 1.0)
    assert np.all(np.array(merge(knows_not, [honest])[0]) == 1.0), (
        "of two nobody can say who lies, so each believes the other"
    )


# -- the part of one robot -------------------------------------------------------------------------------------


def thesis(seed: int = 0, visits: int = 1, value: float | None = None) -> ThesisAgent:
    agent = create(CONFIG, np.random.default_rng(seed))
    agent.visits[:] = [visits] * len(agent.visits)
    if value is not None:
        agent.q[:] = [[value] * 3 for _ in agent.q]
    return agent


class Team:
    """Learners of one process, and what they were told."""

    def __init__(self, lessons: Lessons, agents: dict[str, ThesisAgent], every: int = 1) -> None:
        self.agents = agents
        self.told: list[str] = []
        self.parts = {name: Sharing(agents[name], lessons.of(name), every, tell=self.hears(name)) for name in agents}

    def hears(self, name: str) -> Callable[[str], None]:
        return lambda text: self.told.append(f"{name} {text}")

    def episode(self) -> None:
        """All have one, and go on to the next."""
        for name, part in self.parts.items():
            self.agents[name].episode += 1
            part.episode_over()
        for part in self.parts.values():
            part.episode_begins()


def test_all_take_over_the_median_explore_less_and_say_from_whom() -> None:
    agents = {name: thesis(value=value) for name, value in (("a", 1.0), ("b", 2.0), ("c", 6.0))}
    team = Team(Lessons(), agents)
    team.episode()
    assert agents["a"].q == [[2.0] * 3] * 8
    assert [agent.episode for agent in agents.values()] == [3, 3, 3], "each of the two others had one, too"
    assert team.told[0] == "a took over 8 of 8 rows from 2: b, c"


def test_every_so_many_episodes_and_who_does_nothing_counts_for_nothing() -> None:
    agents = {"a": thesis(), "b": thesis(1)}
    team = Team(Lessons(), agents, every=2)
    team.parts["b"].episode_over()
    team.parts["a"].episode_over()
    team.parts["a"].episode_begins()
    assert not team.told, "after two only"
    team.parts["a"].episode_over()
    team.parts["a"].episode_begins()
    assert agents["a"].episode == 0, "b has told the 0 episodes that it has had"
    agents["b"].episode = 100
    team.parts["b"].episode_over()
    team.parts["a"].episode_begins()
    team.parts["a"].episode_begins()
    assert agents["a"].episode == 2, "whatever b says, it counts for as many as one's own, and once"


def test_one_who_is_lost_neither_tells_nor_hears() -> None:
    agents = {name: thesis(value=value) for name, value in (("a", 1.0), ("b", 2.0), ("lost", 9.0))}
    Team(Lessons(lost=frozenset({"lost"})), agents).episode()
    assert [agent.q[0][0] for agent in agents.values()] == [1.5, 1.5, 9.0]


@pytest.mark.parametrize(
    "lie",
    [
        pytest.param(lambda own: own._replace(rows=((-1e8,) * 3,) * 8), id="outvoted"),
        pytest.param(lambda own: own._replace(rows=((float("nan"),) * 3,) * 8), id="not a number"),
        pytest.param(lambda own: own._replace(rows=own.rows[:5], visits=own.visits[:5]), id="another shape"),
        pytest.param(lambda own: own._replace(learner="pilot"), id="another learner"),
        pytest.param(lambda own: own._replace(visits=(10**30,) * 8), id="boasting"),
    ],
)
def test_a_liar_is_refused_or_outvoted(lie: Callable[[Learned], Learned]) -> None:
    agents = {name: thesis(value=value) for name, value in (("a", 1.0), ("b", 2.0), ("c", 3.0), ("liar", 4.0))}
    team = Team(Lessons(lies=lambda name, own: lie(own) if name == "liar" else own), agents)
    team.episode()
    team.episode()
    honest = [np.array(agents[name].q) for name in "abc"]
    assert all((q >= 1.0).all() and (q <= 3.0).all() for q in honest)
    assert sum("a takes nothing from liar" in text for text in team.told) <= 1


def test_only_learners_that_can_share_do() -> None:
    agent = thesis()
    assert sharer(agent.name, agent) is agent
    with pytest.raises(ConfigError, match="--share: the learner 'mine' shares nothing; choose thesis"):
        sharer("mine", PeriodicAgent(0.1))
