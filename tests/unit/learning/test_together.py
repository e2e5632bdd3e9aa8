"""Tables of several robots: merged by their median, so that one liar changes nothing that matters."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from txt1.config import load
from txt1.kernel.loop import run
from txt1.learning.thesis import create
from txt1.learning.together import Shared, learn_together, merge

ONES = np.ones(8, int)


@given(st.floats(-1e6, 1e6) | st.just(float("nan")) | st.just(float("inf")))
def test_one_liar_of_four_moves_no_value_beyond_those_of_the_others(lie: float) -> None:
    honest = [(np.full((8, 3), value), ONES) for value in (0.9, 1.0, 1.1)]
    merged = merge(honest[0][0], [*honest, (np.full((8, 3), lie), ONES)])
    assert ((merged >= 0.9) & (merged <= 1.1)).all()


def test_who_has_not_been_in_a_state_says_nothing_of_it() -> None:
    been = ONES.copy()
    been[3] = 0
    merged = merge(np.zeros((8, 3)), [(np.full((8, 3), 2.0), been)])
    assert (merged[3] == 0.0).all() and (np.delete(merged, 3, axis=0) == 2.0).all()


def test_who_hears_others_explores_less_and_who_is_lost_goes_on_as_alone() -> None:
    config = load().config
    agents = {name: create(config, np.random.default_rng(0)) for name in ("a", "b", "c")}
    shared = Shared(agents, lost=frozenset({"c"}))
    for name in agents:
        shared.episode_over(name, 1)
    assert [agent.episode for agent in agents.values()] == [0, 1, 0]  # the first to end has heard nobody yet
    for name in agents:
        shared.episode_over(name, 2)
    assert [agent.episode for agent in agents.values()] == [1, 2, 0]


@pytest.mark.long
def test_a_team_that_learns_together_repeats() -> None:
    config = load(None, ["learning.time_limit=10"]).config
    team = ["txt01", "txt02"]
    together = run(learn_together(config, 1, team, 2, Shared), speed="max")
    assert together == run(learn_together(config, 1, team, 2, Shared), speed="max")
    assert [len(each) for each in together.values()] == [2, 2]
