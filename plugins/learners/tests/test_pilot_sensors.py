"""The pilot finds out which sensors lie, which end their range, how late they are, and whether the light moves."""

from __future__ import annotations

import json
from math import inf

import numpy as np
import pytest
from test_pilot_doubts import done
from test_sensor_map import SURVEY, read

from txt1_learners.pilot import PilotAgent, delayed, unmoved
from txt1_learners.sensor_map import corrected

COMPOSED = "learning.world=composed"


def options(text: str) -> tuple[str, str]:
    return COMPOSED, f"learning.world_options={text}"


def rows(z: np.ndarray, variance: float = 0.01) -> np.ndarray:
    return np.column_stack([np.zeros((len(z), 2)), z, np.full((len(z), 4), variance)])


def test_a_sensor_that_reads_the_same_while_others_vary_is_blind() -> None:
    rng, count = np.random.default_rng(3), 40
    z = np.linspace(0.0, 1.5, count)[:, None] + 0.1 * rng.standard_normal((count, 4))
    assert not unmoved(rows(z)).any()
    z[:, 2] = 4.0 + 0.1 * rng.standard_normal(count)
    assert unmoved(rows(z)).tolist() == [False, False, True, False]


def test_no_sensor_is_blind_while_the_robot_stands_or_has_seen_little() -> None:
    z = 0.1 * np.random.default_rng(4).standard_normal((40, 4))
    assert not unmoved(rows(z)).any()
    z[:, 0] += np.linspace(0.0, 3.0, 40)
    assert unmoved(rows(z)).sum() == 3 and not unmoved(rows(z[:15])).any()


def test_late_readings_stand_beside_the_motion_of_their_time() -> None:
    seen = np.arange(40.0).reshape(4, 10)
    late = delayed(seen, 2)
    assert late[:, :2].tolist() == [[0.0, 0.0], [0.0, 0.0], [0.0, 1.0], [10.0, 11.0]]
    assert (late[:, 2:] == seen[:, 2:]).all() and (delayed(seen, 9)[:, :2] == 0.0).all()


def test_a_dazzled_sensor_says_only_that_the_light_is_not_farther() -> None:
    z, noise = read(1.0, 0.2), np.array([-0.01, inf, inf, inf])
    for ahead, counts in ((0.5, 0), (2.0, 1)):
        (x, y, *_), _, count = corrected((ahead, 0.2, 0.1, 0.1, 0.0), SURVEY, z, noise, 0.0)
        assert count == counts
        assert (x, y) == (0.5, 0.2) if not counts else x < 2.0


def test_a_memory_keeps_what_it_found_of_its_sensors() -> None:
    agent, other = (PilotAgent(np.random.default_rng(1)) for _ in range(2))
    agent.late, agent.moves, agent.flickers, agent.blind = 5, True, True, np.array([True, False, False, True])
    other.recall(json.loads(json.dumps(agent.memory())))
    assert (other.late, other.moves, other.flickers, other.blind.tolist()) == (
        5,
        True,
        True,
        [True, False, False, True],
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("errs", "most"),
    [
        ("{sensors: [{}, {}, {}, {lies: 20.0}]}", 1.1),
        ("{sensors: [{lies: 100.0}, {}, {}, {lies: 100.0}]}", 1.2),
        ("{sensors: [{delay: 0.5}]}", 1.1),
        ("{sensors: [{lag: 1.0}]}", 1.2),
        ("{odometry: {turns: 0.4}}", 1.1),
        ("{lamps: [{circle: 0.5, period: 20.0}]}", 2.0),
        ("{lamps: [{flicker: 0.5, flicker_period: 0.5}]}", 1.2),
        ("{lamps: [{flicker: 0.5, flicker_period: 3.0}]}", 1.2),
    ],
)
def test_it_finds_out_how_a_world_differs_and_drives_nearly_as_quickly(errs: str, most: float) -> None:
    times = [sum(one.time for t in done(8, 12, 21, *more) for one in t.episodes[7:]) for more in ((), options(errs))]
    assert times[1] < most * times[0]


@pytest.mark.long
def test_it_says_at_once_that_one_sensor_alone_tells_of_the_light() -> None:
    for trial in done(2, 4, 22, "sim.light.faults=[dead, none, dead, dead]"):
        assert all(one.unfit is not None and one.unfit <= 1.0 for one in trial.episodes)


@pytest.mark.long
def test_after_an_episode_that_took_too_long_the_next_begins_with_saying_so() -> None:
    pairs = [
        pair
        for trial in done(5, 12, 23, *options("{sensors: [{high: 60.0}]}"))
        for pair in zip(trial.episodes[1:], trial.episodes[2:], strict=False)
        if pair[0].time > 3.0 * pair[0].optimal_time
    ]
    assert pairs
    assert all(after.unfit == 0.0 for _, after in pairs)


@pytest.mark.long
def test_without_odometry_it_drives_on_though_a_moving_light_might_explain_it() -> None:
    trials = done(2, 2, 5, *options("{odometry: {missing: true}}"), "learning.time_limit=20.0")
    assert [len(trial.episodes) for trial in trials] == [2, 2]
