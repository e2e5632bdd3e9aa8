"""The pilot among posts and boxes: the worlds that are drawn, the study's file, and that nothing is touched."""

from __future__ import annotations

import json
from math import hypot, isnan
from pathlib import Path

import pytest

from txt1.config import Config, load
from txt1.config.sources import with_values
from txt1.errors import ConfigError
from txt1.learning.registry import make
from txt1.learning.solvability import refuse_unsolvable
from txt1.trials.run import run
from txt1_learners.studies import obstacles, suite
from txt1_learners.studies.lockstep import trials
from txt1_learners.studies.modelled_settings import LOCKSTEP, refuse_others


def test_a_seed_draws_the_same_worlds_again_and_all_can_be_solved() -> None:
    for number in range(1, 40):
        world = obstacles.drawn(load().config, 5, number)
        assert world == obstacles.drawn(load().config, 5, number)
        refuse_unsolvable(world)
        refuse_others(world, LOCKSTEP, "trials in lockstep")
        places = [(each.x, each.y) for each in world.sim.obstacles]
        assert 1 <= len(places) <= 4
        assert all(hypot(a[0] - b[0], a[1] - b[1]) >= obstacles.APART for a in places for b in places if a != b)
    assert obstacles.drawn(load().config, 5, 1) != obstacles.drawn(load().config, 6, 1)


def test_a_learner_that_looks_at_no_laser_refuses_one() -> None:
    world = obstacles.drawn(load().config, 5, 1)
    with pytest.raises(ConfigError, match=r"sensors\.laser: the learner 'thesis' looks at no laser"):
        trials(world, lambda rng: make("thesis", world, rng), [1], 1, 1)


def test_a_world_is_a_line_of_figures() -> None:
    own, known = [[6.0, 1, 0, None, 5.0]] * 9, [[5.5, 1, 0, None, 5.0]] * 9
    lost = [*own[:8], [30.0, 0, 1, 2.0, 5.0]]
    found = obstacles.figures([{"pilot": own, "knowing": known}, {"pilot": lost}])
    assert (found["worlds"], found["episodes"], found["contacts"], found["late_failures"]) == (2, 18, 1, 1)
    assert found["to_floor"] == pytest.approx(1.2)
    assert (found["compared"], found["to_knowing"]) == (2, pytest.approx(6.0 / 5.5))


def test_few_episodes_are_judged_by_the_last_one_and_failures_have_no_ratio() -> None:
    own, lost = [[6.0, 1, 0, None, 5.0]] * 2, [[30.0, 0, 1, 2.0, 5.0]] * 2
    found = obstacles.figures([{"pilot": own, "knowing": lost}])
    assert (found["late_episodes"], found["to_floor"], found["compared"]) == (1, pytest.approx(1.2), 0)
    assert "to_knowing" not in found
    assert isnan(obstacles.figures([{"pilot": lost}])["to_floor"])


def test_a_file_of_something_else_is_not_carried_on(tmp_path: Path) -> None:
    file = tmp_path / "a.jsonl"
    file.write_text(json.dumps({"format": "other"}) + "\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="of something else"):
        obstacles.study(file, Config(), 1, 1, 1, lambda work, told, keep: run(work, told, None, keep), print)


@pytest.mark.long  # compiled; some 40 episodes
def test_the_pilot_touches_nothing_where_it_does_without_a_laser(tmp_path: Path) -> None:
    file = tmp_path / "a.jsonl"
    one = lambda work, told, keep: run(work, told, None, keep)  # noqa: E731
    assert obstacles.study(file, load().config, 3, 12, 77, one, print) == 0
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()[1:]]
    found = obstacles.figures(lines)
    assert (found["contacts"], found["failures"], found["episodes"]) == (0, 0, 36)
    assert found["to_knowing"] < 1.15
    blind = with_values(obstacles.drawn(load().config, 77, 2), {"sensors": {}})
    (trial,) = trials(blind, lambda rng: make("pilot", blind, rng), [2], 12, 77)
    assert any(each.touched for each in trial.episodes)
    assert "0 contacts in 36 episodes" in file.with_suffix(".md").read_text(encoding="utf-8")


@pytest.mark.long  # compiled
def test_a_pilot_that_is_lost_before_a_box_keeps_clear_of_it() -> None:
    # it saw the light now on one side of the box, now on the other, and drove between these ways
    told = obstacles.run_told([Config().model_dump(mode="json"), 11763359, 114, 1])
    ((_, _, touched, *_),) = told["pilot"]
    assert not touched


@pytest.mark.long  # compiled
@pytest.mark.parametrize(("seed", "number"), [(777, 153), (2540066497, 243)])
def test_a_lost_pilot_keeps_clear_by_the_turns_of_odometry(seed: int, number: int) -> None:
    # its first survey told a drift of 0.16 rad/s, so the places that it had seen turned about it
    told = obstacles.run_told([Config().model_dump(mode="json"), seed, number, 1])
    ((_, _, touched, *_),) = told["pilot"]
    assert not touched


@pytest.mark.long  # compiled
def test_a_pilot_that_has_tried_one_action_before_a_box_tries_another() -> None:
    # it knew how to drive straight on, and took the others to be no better
    told = obstacles.run_told([Config().model_dump(mode="json"), 3408533908, 91, 1])
    ((_, _, touched, *_),) = told["pilot"]
    assert not touched


@pytest.mark.long  # a search for it
def test_a_floor_leaves_the_laser_out_with_the_obstacles() -> None:
    least = suite.floors(obstacles.drawn(load().config, 5, 1), 2)
    assert all(each.exists for each in least)
