"""The thesis's learner does what chapter 5 says."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from txt1.config import load
from txt1.learning.command.trials import on_robot
from txt1.learning.experiment import Plan
from txt1.learning.light_direction import sector
from txt1.learning.qtable import STATES
from txt1.learning.settings import TURN, LearningConfig, ThesisConfig
from txt1.learning.thesis import TABLE_5_3, ThesisAgent
from txt1.learning.trial import COMMANDS
from txt1.learning.world_presets import ours, world_named
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1.sensors.light import compass
from txt1.sim.lamp import LightSensors, PointLight

LEFT, RIGHT, STRAIGHT = (Odometry(v=0.3, omega=omega) for omega in (TURN, -TURN, 0.0))
REAR_LEFT, FRONT_LEFT, AHEAD = radians(135.0), radians(45.0), 0.0


def agent(**settings: object) -> ThesisAgent:
    one = ThesisAgent(np.random.default_rng(1), COMMANDS, ThesisConfig(**settings))  # type: ignore[arg-type]
    one.begin()
    return one


def _readings(bearing: float) -> Readings:
    """Four readings whose direction is the bearing: a compass, seen from 1 m away with this heading."""
    return compass((1.0, 0.0))((0.0, 0.0, -bearing))


def show(one: ThesisAgent, bearing: float) -> None:
    """Let the filter forget everything but this bearing."""
    one.filter.clear()
    for _ in range(22):
        one.see(_readings(bearing), STRAIGHT)
    assert one.ready
    assert one.state() == sector(bearing)


def test_it_is_not_ready_before_the_filter_has_settled() -> None:
    one = agent()
    for _ in range(21):
        one.see(_readings(0.0), STRAIGHT)
        assert not one.ready
    one.see(_readings(0.0), STRAIGHT)
    assert one.ready


def test_it_decides_twice_a_second() -> None:
    one = agent()
    show(one, AHEAD)
    assert not one.waits(1.0, STRAIGHT)
    one.act(1.0, STRAIGHT)
    assert one.waits(1.45, STRAIGHT)
    assert not one.waits(1.5, STRAIGHT)


@pytest.mark.parametrize(("remedy", "updated"), [("sensed", 2), ("none", None)])
def test_remedy_2_updates_the_action_sensed_and_none_the_one_commanded(remedy: str, updated: int | None) -> None:
    one = agent(remedy=remedy)
    show(one, REAR_LEFT)
    commanded = one.act(0.0, STRAIGHT)
    before = np.array(one.q)
    show(one, FRONT_LEFT)
    one.act(0.5, LEFT)
    [[s, a]] = np.argwhere(np.array(one.q) != before)
    assert s == sector(REAR_LEFT) == 7
    assert a == (commanded if updated is None else updated)
    # (5.1) with the light nearer to straight ahead: r = 1
    expected = before[s, a] + 0.3 * (1.0 + 0.5 * before[5].max() - before[s, a])
    assert one.q[s][a] == pytest.approx(expected)


@pytest.mark.parametrize(("omega", "action"), [(-0.19, 0), (-0.17, 1), (0.0, 1), (0.17, 1), (0.19, 2)])
def test_a_sensed_yaw_rate_is_one_of_three_actions(omega: float, action: int) -> None:
    assert agent().sensed(Odometry(omega=omega)) == action


def test_remedy_1_holds_until_the_command_is_reached_then_reads_the_state() -> None:
    one = agent(remedy="hold", temperature=0.05)
    one.q[:] = [[0.0, 0.0, 9.0] for _ in range(STATES)]  # left it is
    show(one, REAR_LEFT)
    assert one.act(0.0, STRAIGHT) == 2
    assert one.waits(0.7, STRAIGHT), "the robot does not turn yet"
    show(one, FRONT_LEFT)
    assert one.waits(0.75, Odometry(v=0.3, omega=TURN - 0.14))
    assert one.waits(1.2, LEFT)
    assert not one.waits(1.25, LEFT)
    before = np.array(one.q)
    show(one, AHEAD)
    one.act(1.25, LEFT)
    assert np.argwhere(np.array(one.q) != before).tolist() == [[sector(FRONT_LEFT), 2]], (
        "the state it read when it turned"
    )


@pytest.mark.parametrize("world", [None, *ours()])
def test_every_world_and_the_running_robot_read_the_direction_without_compression(world: str | None) -> None:
    config = load(None if world is None else world_named(world)).config
    assert config.section(LearningConfig).thesis.direction == "corrected"


@pytest.mark.parametrize(("way", "seen"), [("summed", 4), ("corrected", 5)])
def test_a_light_at_45_degrees_is_ahead_by_the_sum_and_front_left_if_corrected(way: str, seen: int) -> None:
    one = agent(direction=way)
    sensors = LightSensors(PointLight(), 0.0, np.random.default_rng(1))
    for _ in range(22):
        one.see(sensors.read(-1.25, 0.0, -FRONT_LEFT), STRAIGHT)
    assert one.state() == seen


def test_without_a_direction_nothing_is_learned_and_any_action_may_come() -> None:
    one = agent()
    show(one, AHEAD)
    one.act(0.0, STRAIGHT)
    before = np.array(one.q)
    dark = Readings(1.0, 1.0, 1.0, 1.0)
    one.filter.clear()
    for _ in range(22):
        one.see(dark, STRAIGHT)
    assert one.state() is None
    chosen = {one.act(0.5 * k, STRAIGHT) for k in range(1, 40)}
    assert chosen == {0, 1, 2}
    assert np.array_equal(one.q, before)


def test_reaching_the_light_teaches_and_leaving_the_boundary_does_not() -> None:
    for success in (True, False):
        one = agent()
        show(one, FRONT_LEFT)
        one.act(0.0, STRAIGHT)
        before = np.array(one.q)
        show(one, AHEAD)
        one.end(success, LEFT)
        assert np.array_equal(one.q, before) is not success
        assert one.episode == 1


def test_a_void_episode_leaves_no_trace_in_the_table() -> None:
    one = agent()
    one.begin()
    before = np.array(one.q)
    for k in range(10):
        show(one, (REAR_LEFT, FRONT_LEFT, AHEAD)[k % 3])
        one.act(0.5 * k, LEFT)
    assert not np.array_equal(one.q, before)
    one.void()
    assert np.array_equal(one.q, before)
    assert one.episode == 0


def test_exploration_ends_with_the_temperature_learning_with_the_training() -> None:
    one = agent()
    one.q[:] = [[0.0, 0.5, 0.0] for _ in range(STATES)]
    show(one, AHEAD)
    one.episode = 11  # T = 0.05
    assert {one.choose(4) for _ in range(200)} == {1}
    one.episode = 0
    assert {one.choose(4) for _ in range(200)} == {0, 1, 2}
    trained = agent(training=0, learn_on=False)
    before = np.array(trained.q)
    for k in range(5):
        show(trained, (REAR_LEFT, FRONT_LEFT)[k % 2])
        assert trained.act(0.5 * k, LEFT) == before[(7, 5)[k % 2]].argmax()
    assert np.array_equal(trained.q, before)
    learning = agent(training=0)
    show(learning, REAR_LEFT)
    learning.act(0.0, LEFT)
    show(learning, FRONT_LEFT)
    learning.act(0.5, LEFT)
    assert not np.array_equal(learning.q, before), "it learns on, greedily"


def test_the_random_policy_does_not_look_at_the_table() -> None:
    one = agent(policy="random")
    one.q[:] = [[0.0, 100.0, 0.0] for _ in range(STATES)]
    assert {one.choose(4) for _ in range(100)} == {0, 1, 2}


def test_it_carries_on_from_its_memory_as_if_nothing_had_been() -> None:
    one = agent()
    other = agent()
    other.q[:] = [[0.0] * 3 for _ in range(STATES)]
    for k in range(4):
        show(one, (REAR_LEFT, FRONT_LEFT)[k % 2])
        one.act(0.5 * k, LEFT)
    one.end(True, LEFT)
    other.recall(one.memory())
    one.begin()
    other.begin()
    for k in range(10):
        for each in (one, other):
            show(each, (REAR_LEFT, FRONT_LEFT, AHEAD)[k % 3])
        assert one.act(0.5 * k, LEFT) == other.act(0.5 * k, LEFT)
    assert np.array_equal(one.q, other.q)


@pytest.mark.long
def test_the_thesiss_own_table_always_reaches_the_light() -> None:
    """50 random starts of the 1000 in docs/results/learning.md."""
    config = load().config
    for number in range(1, 6):
        driver = agent(policy="greedy", training=0, learn_on=False)
        driver.q = [list(row) for row in TABLE_5_3]
        episodes = on_robot(Plan("thesis", 5, 10, 1, config), number, agent=driver).episodes
        assert all(one.success for one in episodes)
        assert np.mean([one.time for one in episodes]) < 12.0
