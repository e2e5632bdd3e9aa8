"""A trial's episodes: where they begin, when they end, what makes them void."""

from __future__ import annotations

from math import atan2, hypot, pi
from typing import Any

import numpy as np
import pytest

from txt1.learning.qtable import StoredTable
from txt1.learning.trial import COMMANDS, Phase, Start, Task, Trial, starts
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1.model.optimal import optimal_time

STILL = Odometry()


class Recorder:
    """An agent that drives straight on, decides every 0.5 s and notes what it is told."""

    name = "recorder"
    ready = True

    def __init__(self) -> None:
        self.told: list[str] = []
        self.due = 0.0

    def begin(self) -> None:
        self.told.append("begin")
        self.due = 0.0

    def see(self, readings: Readings, odometry: Odometry) -> None: ...

    def waits(self, now: float, odometry: Odometry) -> bool:
        return now < self.due

    def act(self, now: float, odometry: Odometry) -> int:
        self.due = now + 0.5
        self.told.append("act")
        return 1

    def end(self, success: bool, odometry: Odometry) -> None:
        self.told.append("success" if success else "failure")

    def void(self) -> None:
        self.told.append("void")

    def table(self) -> StoredTable:
        return StoredTable(np.zeros((1, 3)))

    def memory(self) -> dict[str, Any]:
        return {}

    def recall(self, memory: dict[str, Any]) -> None: ...


@pytest.fixture
def agent() -> Recorder:
    return Recorder()


def begun(agent: Recorder, task: Task | None = None, episodes: int = 2) -> Trial:
    trial = Trial(agent, task or Task(), starts(1, 1, episodes))
    trial.placed(10.0)
    assert trial.tick(10.5, True, trial.start, STILL) == COMMANDS[1]
    assert trial.phase is Phase.DRIVE
    return trial


def test_every_start_is_as_far_from_the_light_as_the_thesis_s() -> None:
    task = Task(light=(0.5, -1.0))
    poses = [start.pose(task) for start in starts(1, 1, 2000)]
    assert all(hypot(x - 0.5, y + 1.0) == pytest.approx(1.25) for x, y, _ in poses)
    bearings = np.array([wrap_angle(atan2(-1.0 - y, 0.5 - x) - theta) for x, y, theta in poses])
    for quarter in range(4):
        share = np.mean((bearings >= -pi + quarter * pi / 2) & (bearings < -pi + (quarter + 1) * pi / 2))
        assert share == pytest.approx(0.25, abs=0.04)


def test_two_trials_start_differently_and_a_longer_one_starts_the_same() -> None:
    assert starts(1, 1, 3) == starts(1, 1, 30)[:3]
    assert starts(1, 1, 3) != starts(1, 2, 3)
    assert starts(1, 1, 3) != starts(2, 1, 3)


def test_the_optimum_is_that_of_the_same_start_around_the_same_light() -> None:
    start, task = Start(0.3, 1.0), Task(light=(2.0, 1.0))
    x, y, theta = start.pose(task)
    assert start.optimal_time(task) == float(optimal_time(x - 2.0, y - 1.0, theta))


def test_it_rests_before_the_first_decision_and_commands_between_decisions(agent: Recorder) -> None:
    trial = Trial(agent, Task(), starts(1, 1, 2))
    assert trial.tick(9.0, True, trial.start, STILL) == (0.0, 0.0), "on its way to the start"
    trial.placed(10.0)
    assert trial.tick(10.45, True, trial.start, STILL) == (0.0, 0.0)
    ticks = [10.5 + 0.05 * k for k in range(20)]
    assert [trial.tick(now, True, trial.start, STILL) for now in ticks] == [COMMANDS[1]] * 20
    assert agent.told == ["begin", "act", "act"]


def test_reaching_the_light_counts_at_the_next_decision(agent: Recorder) -> None:
    trial = begun(agent)
    assert trial.tick(10.75, True, (0.4, 0.0, 0.0), STILL) == COMMANDS[1]
    assert trial.tick(11.0, True, (0.5, 0.0, 0.0), STILL) == (0.0, 0.0)
    [one] = trial.episodes
    assert one.success
    assert one.number == 1
    assert one.time == pytest.approx(0.5)
    assert agent.told[-1] == "success"
    assert trial.phase is Phase.MOVE


@pytest.mark.parametrize("pose", [(8.01, 0.0, 0.0), (0.0, -8.01, 0.0), (-9.0, 9.0, 1.0)])
def test_outside_the_boundary_it_has_failed(agent: Recorder, pose: tuple[float, float, float]) -> None:
    trial = begun(agent)
    trial.tick(11.0, True, pose, STILL)
    assert not trial.episodes[0].success
    assert agent.told[-1] == "failure"


def test_it_fails_when_it_takes_longer_than_anybody_waits(agent: Recorder) -> None:
    trial = begun(agent, Task(time_limit=1.0))
    trial.tick(11.0, True, (1.0, 0.0, 0.0), STILL)
    trial.tick(11.5, True, (1.0, 0.0, 0.0), STILL)
    assert not trial.episodes
    trial.tick(12.0, True, (1.0, 0.0, 0.0), STILL)
    assert [one.success for one in trial.episodes] == [False]


def test_a_disarm_voids_the_episode_which_begins_again_at_the_same_start(agent: Recorder) -> None:
    trial = begun(agent)
    start = trial.start
    assert trial.tick(10.6, False, start, STILL) == (0.0, 0.0)
    assert agent.told[-1] == "void"
    assert trial.phase is Phase.MOVE
    assert trial.start == start
    assert trial.episodes == []
    assert trial.voided == 1


def test_it_is_done_after_the_last_episode(agent: Recorder) -> None:
    trial = begun(agent, episodes=1)
    trial.tick(11.0, True, (0.1, 0.0, 0.0), STILL)
    assert trial.phase is Phase.DONE
    assert trial.tick(11.05, True, (0.1, 0.0, 0.0), STILL) == (0.0, 0.0)


def test_only_the_paths_that_were_asked_for_are_kept(agent: Recorder) -> None:
    trial = Trial(agent, Task(), starts(1, 1, 2), keep_paths=(2,))
    for _ in range(2):
        trial.placed(10.0)
        trial.tick(10.5, True, trial.start, STILL)
        trial.tick(11.0, True, (0.1, 0.2, 0.0), STILL)
    assert list(trial.paths) == [2]
    assert trial.paths[2][-1] == (0.1, 0.2)
