"""The pilot learns where the range of a sensor ends, and takes no reading from there for a distance."""

import numpy as np
import pytest
from test_pilot_doubts import done

from txt1.model.light_sensors import LUX_MAX
from txt1_learners.pilot import REPEATED, PilotAgent

SATURATED = ("learning.world=composed", "learning.world_options={sensors: [{high: 150.0}]}")


def test_a_largest_reading_that_repeats_ends_the_range_until_a_larger_one_comes() -> None:
    agent = PilotAgent(np.random.default_rng(1))
    shown = np.array([[60.0, 40.0, float("nan"), 30.0]] * REPEATED)
    shown[:, 1] += np.arange(REPEATED)
    shown[0] -= 5.0
    shown = np.vstack([shown, shown[-1:]])
    assert agent.ceilings(shown)[[0, 1, 3]].tolist() == [60.0, LUX_MAX, 30.0]
    assert agent.ceilings(np.array([[70.0, 1.0, 1.0, 29.0]])).tolist() == [LUX_MAX, LUX_MAX, LUX_MAX, 30.0]


def test_a_frozen_sensor_is_not_at_the_end_of_its_range() -> None:
    agent = PilotAgent(np.random.default_rng(1))
    assert agent.ceilings(np.full((3 * REPEATED, 4), 60.0)).tolist() == [LUX_MAX] * 4


def test_no_range_ends_above_that_of_the_board() -> None:
    agent = PilotAgent(np.random.default_rng(1))
    assert agent.ceilings(np.full((REPEATED, 4), 2.0 * LUX_MAX)).tolist() == [LUX_MAX] * 4


def test_a_memory_keeps_where_the_ranges_end() -> None:
    agent, other = (PilotAgent(np.random.default_rng(1)) for _ in range(2))
    agent.ceilings(np.full((1, 4), 59.0))
    agent.ceilings(np.full((REPEATED, 4), 60.0))
    other.recall(agent.memory())
    assert other.ceilings(np.full((1, 4), 50.0)).tolist() == [60.0] * 4


@pytest.mark.long
def test_sensors_that_see_no_brighter_than_at_80_cm_cost_little_time() -> None:
    times = [sum(one.time for t in done(2, 12, 21, *more) for one in t.episodes[6:]) for more in ((), SATURATED)]
    assert times[1] < 1.15 * times[0]
