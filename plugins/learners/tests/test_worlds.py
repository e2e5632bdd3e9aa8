"""Learners in other worlds: the suite's files and figures, the floor, and the learner that survives a change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from txt1.config import Config, completed, load
from txt1.errors import ConfigError
from txt1.learning import thesis
from txt1.learning.best_time import Floor
from txt1.learning.experiment import KEPT
from txt1.learning.qtable import StoredTable
from txt1.learning.registry import make
from txt1.learning.settings import TURN, LearningConfig
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.trial import Start, Trial, starts, task_of
from txt1.learning.world_presets import ours, worlds
from txt1.trials.provenance import provenance
from txt1_learners import pilot
from txt1_learners.studies import suite
from txt1_learners.studies.floor import MovingFloor, floor_of
from txt1_learners.studies.lockstep import trials, world_at
from txt1_learners.worlds import every, groups


def raw(times: list[list[float]], won: list[list[int]]) -> dict[str, Any]:
    """A result with an optimum of 4 s and a floor of 5 s."""
    rows = [
        [[0.0, 0.0, t, w, 4.0, 5.0] for t, w in zip(ts, ws, strict=True)] for ts, ws in zip(times, won, strict=True)
    ]
    return {
        "agent": "a",
        "world": "w",
        "seed": 1,
        "trials": len(times),
        "episodes": len(times[0]),
        "results": rows,
        "provenance": {"code": "0"},
        "config": completed(Config()).model_dump(mode="json"),
    }


def test_there_are_at_least_24_worlds_and_each_is_a_sound_configuration() -> None:
    found = suite.worlds("usual", [])
    assert len(found) >= 24
    for world in found:
        assert all(world_at(world.config, episode, 31).section(LearningConfig).actions for episode in (1, 16, 31))


def test_the_seed_of_the_day_draws_four_more_and_the_same_again() -> None:
    first, again, other = (suite.drawn(Config(), seed) for seed in (5, 5, 6))
    assert len(first) == 4 and first == again
    assert all(one.config != two.config for one, two in zip(first, other, strict=True))


def test_failures_are_counted_apart_and_in_no_ratio() -> None:
    times = [[30.0] * 7 + [6.0, 300.0], [30.0] * 7 + [6.0, 6.0]]
    one = suite.figures(raw(times, [[1] * 8 + [0], [1] * 9]))
    assert (one["failures"], one["success"]) == (1, 0.75)
    assert one["to_floor"] == pytest.approx(1.2) and one["to_optimum"] == pytest.approx(1.5)


def test_a_change_after_the_last_episode_is_none() -> None:
    result = raw([[5.0] * 9], [[1] * 9])
    result["config"]["learning"]["changes"] = [{"episode": 16, "set": {}}]
    assert "back_after" not in suite.figures(result)


def test_who_does_not_believe_the_sensors_has_no_figures() -> None:
    result = {**raw([[5.0]], [[1]]), "results": [], "refused": "light sensor FL is dead"}
    assert suite.cell(suite.figures(result)) == "refuses the sensors"
    assert "| w | refuses the sensors |" in suite.table([result])


def test_many_trials_are_kept_by_blocks_and_carried_on(tmp_path: Path) -> None:
    world, asked = suite.SuiteWorld("w", Config()), list[list[int]]()

    def each(
        work: Callable[[Any], Any], trials: Mapping[Any, Any], keep: Callable[[Any, Any], None], last: int = 2
    ) -> int:
        for key, told in list(trials.items())[-last:][::-1]:  # as they come
            _, _, _, first, count, episodes, seed = told
            asked.append([first, count])
            rows = [[[0.0, 0.0, float(first + k), 1, 4.0, 5.0]] for k in range(count)]
            one = raw([[5.0]], [[1]]) | {"seed": seed, "trials": count, "episodes": episodes, "results": rows}
            keep(key, {**one, "refused": None, "provenance": provenance()})
        return 0

    suite.run_all([world], ["a"], 250, 1, 7, tmp_path, each, False, lambda _: None)
    assert asked == [[201, 50], [101, 100]]
    with pytest.raises(ConfigError, match="--resume carries on"):
        suite.run_all([world], ["a"], 250, 1, 7, tmp_path, each, False, lambda _: None)
    ((done,), _) = suite.run_all([world], ["a"], 250, 1, 7, tmp_path, each, True, lambda _: None)
    assert asked[2:] == [[1, 100]]
    assert done["trials"] == 250 and [trial[0][2] for trial in done["results"]] == [*range(1, 251)]
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["w.json"]
    first = lambda work, trials, keep: each(work, dict([*trials.items()][:2]), keep)  # noqa: E731
    suite.run_all([world], ["a"], 250, 1, 7, tmp_path / "b", first, False, lambda _: None)
    ((done,), _) = suite.run_all([world], ["a"], 200, 1, 7, tmp_path / "b", each, True, lambda _: None)
    assert done["trials"] == 200 and len(asked) == 5, "those that are there are enough"
    for broken in ("x", "[]", "{}"):
        (tmp_path / "a" / "w.json").write_text(broken)
        with pytest.raises(ConfigError, match="is no result of this program; delete it"):
            suite.run_all([world], ["a"], 250, 1, 7, tmp_path, each, True, lambda _: None)


def test_a_change_is_in_force_from_its_episode_on_and_a_drift_goes_evenly() -> None:
    config = load(
        None,
        [
            "learning.changes=[{episode: 3, set: {sim.vehicle.scrub: 0.2}}]",
            "learning.drift={sim.vehicle.slip: [0, 0.4]}",
        ],
    ).config
    worlds = [world_at(config, episode, 5).sim.vehicle for episode in range(1, 6)]
    assert [one.scrub for one in worlds] == [0.06, 0.06, 0.2, 0.2, 0.2]
    assert [one.slip for one in worlds] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])


def learned(agent: str, *settings: str, count: int = 4, episodes: int = 10) -> list[Trial]:
    config = load(None, settings).config
    return trials(config, lambda rng: make(agent, config, rng), range(1, count + 1), episodes, 3)


@pytest.mark.long
def test_nobody_is_quicker_than_the_floor_which_is_above_the_optimum() -> None:
    floor, task = floor_of(Config()), task_of(Config())
    some = [start for number in range(1, 20) for start in starts(1, number, 31)]
    ratio = sum(floor.time(one) for one in some) / sum(one.optimal_time(task) for one in some)
    assert floor.exists and 1.09 < ratio < 1.12
    assert all(floor.way(one) < task.speed * floor.exact(one) <= task.speed * floor.time(one) for one in some)
    late = [one for trial in learned("sweeps") for one in trial.episodes[3:]]
    assert sum(one.time for one in late) > 0.995 * sum(floor.time(one.start) for one in late)


@pytest.mark.long
def test_the_floor_of_a_start_is_that_of_its_bearing_where_the_light_stands() -> None:
    config = Config()
    of_bearing, of_start = floor_of(config), MovingFloor(config, lambda since: config.sim.room.light)
    some = starts(1, 1, 8)
    # between two bearings the one is interpolated
    assert [of_start.time(one) for one in some] == pytest.approx([of_bearing.time(one) for one in some], abs=0.11)


def test_the_floor_follows_the_light_from_the_first_decision_on() -> None:
    settings = ("learning.world=composed", "learning.world_options={lamps: [{velocity: [0.1, 0.0]}]}")
    (floor,) = suite.floors(load(None, settings).config, 1)
    assert isinstance(floor, MovingFloor)
    # the robot has rested for half a second by then
    assert floor.goal(1.0) == pytest.approx((0.15, 0.0))


@pytest.mark.long
def test_a_floor_knows_what_becomes_of_commands_on_their_way() -> None:
    def of(turning: float) -> Floor | MovingFloor:
        told = f"learning.world_options={{turning: {turning}, turning_from: 3.0}}"
        config = suite.asked_alike(load(None, ("learning.world=composed", told)).config)
        assert not suite.leaves_out(config)
        return suite.floors(config, 1)[0]

    as_told, weakens, swaps = of(1.0), of(0.6), of(-1.0)
    ahead, behind = Start(0.0, pi), Start(0.0, 0.1)
    assert weakens.time(ahead) == swaps.time(ahead) == as_told.time(ahead)
    # most of the way is one turn, which takes 1 / 0.6 as long after 3 s; who knows of a swap steers the other way
    turn = as_told.time(behind)
    assert 3.0 + 0.8 * (turn - 3.0) / 0.6 < weakens.time(behind) < 3.0 + (turn - 3.0) / 0.6
    assert swaps.time(behind) == pytest.approx(turn, abs=0.11)


@pytest.mark.long
def test_a_world_whose_floor_no_file_knows_has_it_searched_for() -> None:
    (usual,), (slow,) = (
        suite.floors(suite.worlds("usual", [], [name])[0].config, 1) for name in ("thesis", "servo-slow")
    )
    assert usual.time(Start(0.0, 2.0)) < slow.time(Start(0.0, 2.0)) < 1.1 * usual.time(Start(0.0, 2.0))


@pytest.mark.long
def test_from_a_light_that_flees_faster_than_the_robot_no_floor_is_made_up() -> None:
    flees = MovingFloor(Config(), lambda since: (-since, 0.0))
    assert flees.time(Start(0.0, pi)) == np.inf and not flees.exists


@pytest.mark.long
def test_a_light_that_comes_is_reached_earlier_and_one_that_goes_later() -> None:
    config = Config()
    task, ahead = task_of(config), Start(0.0, pi)
    stands, comes, goes = (
        MovingFloor(config, lambda since, v=v: (v * since, 0.0)).time(ahead) for v in (0.0, 0.1, -0.1)
    )
    way, speed = task.start_radius - task.goal_radius, task.speed
    assert stands - comes == pytest.approx(way / speed - way / (speed + 0.1), abs=0.3)
    assert goes - stands == pytest.approx(way / (speed - 0.1) - way / speed, abs=0.3)


@pytest.mark.long
@pytest.mark.parametrize("world", ["thesis", "sensors-turned", "sensor-dead", "steering-reversed", "speed-half"])
def test_the_pilot_finds_the_light_whatever_its_sensors_and_its_steering_mean(world: str) -> None:
    config = suite.worlds("usual", [], [world])[0].config
    every = trials(config, lambda rng: make("pilot", config, rng), range(1, 5), 10, 3)
    late = [one for trial in every for one in trial.episodes[4:]]
    assert all(one.success for one in late)
    assert sum(one.time for one in late) < 1.25 * sum(one.optimal_time for one in late)


@pytest.mark.parametrize("name", [pytest.param("pilot", marks=pytest.mark.long), "sweeps", "thesis"])
def test_what_a_learner_tells_of_its_table_survives_the_file_of_its_trial(name: str) -> None:
    about = make(name, Config(), np.random.default_rng(0)).table().about
    assert not {*about} & {*KEPT, "learned", "paths"}


@pytest.mark.long
def test_the_pilot_carries_on_from_what_it_kept() -> None:
    agent = learned("pilot", count=1, episodes=3)[0].agent
    again = make("pilot", Config(), np.random.default_rng(0))
    again.recall(agent.memory())
    assert again.memory() == agent.memory()
    agent.begin()
    agent.void()
    assert again.memory() == agent.memory()


@pytest.mark.long
def test_the_picture_of_the_pilot_turns_towards_the_light_on_either_side() -> None:
    table = learned("pilot", count=1, episodes=4)[0].agent.table()
    right, left = pilot.courses(table, np.array([[0.5, -2.0], [0.5, 2.0]]))
    assert right < 0.0 < left


def test_the_picture_of_the_thesiss_table_takes_its_best_action_in_each_sector() -> None:
    best = np.array([0, 0, 0, 0, 1, 2, 2, 2])  # right, straight on, left
    places = np.array([[-2.0, -0.5], [0.5, -2.0], [2.0, 0.0], [0.5, 2.0]])
    assert list(thesis.courses(StoredTable(np.eye(3)[best]), places)) == [-TURN, -TURN, 0.0, TURN]


@pytest.mark.long
def test_the_pilot_is_back_in_the_episode_after_its_sensors_have_changed_places() -> None:
    config = suite.worlds("usual", [], ["change-sensors"])[0].config
    every = trials(config, lambda rng: make("pilot", config, rng), range(1, 5), 19, 3)
    assert all(one.success for trial in every for one in trial.episodes[15:])
    after = [one for trial in every for one in trial.episodes[16:]]
    # in one of eight trials one more episode is slow
    assert sum(one.time for one in after) < 1.35 * sum(one.optimal_time for one in after)


def test_the_table_tells_times_and_when_the_model_did_not_fit() -> None:
    result = raw([[6.0] * 9], [[1] * 9])
    result["results"][0] = [[*row, 2.5 if k == 3 else None] for k, row in enumerate(result["results"][0])]
    assert suite.cell(suite.figures(result)).endswith("; 6.00 s; model does not fit in 1 of 9 episodes, after 2.5 s")


def test_the_table_tells_how_many_slow_episodes_were_said_in_time() -> None:
    result = raw([[6.0] * 8 + [60.0] * 3], [[1] * 10 + [0]])
    told = {8: 5.0, 9: 5.1}
    result["results"][0] = [[*row, told.get(k)] for k, row in enumerate(result["results"][0])]
    assert suite.cell(suite.figures(result)).endswith("; 3 of 4 slow, said in 1 within 5 s")


def test_there_are_38_usual_worlds_that_can_be_solved_and_82_hostile_ones() -> None:
    assert {name: len(suite.worlds(name, [])) for name in groups()} == {"usual": 38, "hostile": 82}
    for world in suite.worlds("usual", []):
        refuse_unsolvable(world.config)


def test_each_world_is_found_by_its_name_and_says_what_it_is_about() -> None:
    assert set(every()) == set(worlds()) > set(ours())
    assert all(one["about"] for one in every().values())


def test_a_group_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"nowhere: no .*yaml there; give usual or hostile, or a directory"):
        suite.worlds("nowhere", [])
