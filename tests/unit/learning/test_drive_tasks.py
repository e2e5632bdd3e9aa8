"""A task is defined once, and its returns are ordered as its times."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest

from txt1.config import load
from txt1.errors import ConfigError
from txt1.learning.drive_tasks import COSTS, PAYS, RAYS, TASKS, AlongTrack, DriveTask, TaskView, task_named
from txt1.model.kinematics import move_along_arc

CONFIG = load(None, ()).config
OVAL = load(None, ["sim.room.map=oval"]).config


def seen(pose: tuple[float, float, float], touched: bool = False) -> TaskView:
    lux, ranges = np.full((1, 4), 50.0), np.full((1, len(RAYS)), 2.0)
    return TaskView(np.array([pose]), np.zeros((1, 2)), lux, ranges, np.array([touched]))


def drive(task: DriveTask, pose: tuple[float, float, float], v: float, omega: float, turns: float = 0.0) -> float:
    """Return the sum of the rewards until the end, by v after so many circles; the time limit ends it, too."""
    task.begun(seen(pose), np.ones(1, bool))
    total, time = 0.0, 0.0
    while time < task.time_limit:
        circles = time < turns * 2.0 * pi * 0.56 / v
        pose = move_along_arc(*pose, v * task.period, omega / v if circles else 0.0, 0.0)
        rewards, success, lost = task.judged(seen(pose))
        total, time = total + float(rewards[0]), time + task.period
        if success[0] or lost[0]:
            break
    return total


def test_returns_are_ordered_as_times_for_a_fast_a_slow_and_a_circling_driver() -> None:
    ahead = (-1.25, 0.0, 0.0)
    fast = drive(task_named("light", CONFIG), ahead, 0.3, 0.0)
    slow = drive(task_named("light", CONFIG), ahead, 0.15, 0.0)
    once = drive(task_named("light", CONFIG), ahead, 0.3, 0.3 / 0.56, turns=1.0)
    always = drive(task_named("light", CONFIG), ahead, 0.3, 0.3 / 0.56, turns=99.0)
    assert fast > slow > once > always
    # the way has paid for itself, so a return is what the goal pays less the seconds that were wasted
    assert fast == pytest.approx(PAYS, abs=0.5)
    assert fast - slow == pytest.approx(2.5, abs=0.51)


def test_to_be_lost_is_worse_than_to_be_late() -> None:
    late = drive(task_named("light", CONFIG), (-1.25, 0.0, 0.0), 0.3, 0.3 / 0.56, turns=99.0)
    lost = drive(task_named("light", CONFIG), (-1.25, 0.0, pi), 0.3, 0.0)
    assert lost < -COSTS < late + 1.0


def test_a_lap_earns_the_goal_and_the_wrong_way_round_does_not() -> None:
    for way, sign in ((1, 1.0), (-1, -1.0)):
        task = task_named("track", OVAL)
        line = task.line[::way]  # type: ignore[attr-defined]
        edges = np.diff(line, axis=0)
        headings = np.arctan2(edges[:, 1], edges[:, 0])
        task.begun(seen((*line[0], headings[0])), np.ones(1, bool))
        total, won = 0.0, False
        for place, theta in zip(line[1:], headings, strict=True):
            judged = task.judged(seen((*place, theta)))
            total, won = total + float(judged.rewards[0]), won or bool(judged.success[0])
        judged = task.judged(seen((*line[0], headings[0])))
        assert (won or bool(judged.success[0])) is (sign > 0.0)
        assert total * sign > 0.0


def test_touching_something_ends_the_episode_and_costs() -> None:
    task = task_named("clear", CONFIG)
    task.begun(seen((0.0, 0.0, 0.0)), np.ones(1, bool))
    judged = task.judged(seen((0.1, 0.0, 0.0), touched=True))
    assert judged.lost[0] and judged.rewards[0] < -COSTS + 1.0


def test_to_a_pose_the_heading_counts() -> None:
    task = task_named("pose", CONFIG)
    task.begun(seen((1.0, 0.0, pi)), np.ones(1, bool))
    assert not task.judged(seen((0.0, 0.0, pi))).success[0]
    assert task.judged(seen((0.1, 0.0, 0.1))).success[0]
    ahead, left, c, s, *_ = task.observed(seen((-1.0, -2.0, pi / 2.0)))[0].tolist()
    assert (ahead, left, c, s) == pytest.approx((2.0, -1.0, cos(pi / 2.0), -sin(pi / 2.0)), abs=1e-6)


@pytest.mark.parametrize("name", TASKS)
def test_observations_and_starts_of_many_robots_are_within_bounds(name: str) -> None:
    task = task_named(name, OVAL if name == "track" else CONFIG, 50)
    poses = task.begin(50, np.random.default_rng(1))
    assert poses.shape == (50, 3) and np.isfinite(poses).all()
    many = TaskView(
        poses, np.full((50, 2), 99.0), np.zeros((50, 4)), np.full((50, len(RAYS)), np.inf), np.zeros(50, bool)
    )
    observed = task.observed(many)
    assert (observed >= task.low - 1e-6).all() and (observed <= task.high + 1e-6).all()
    assert np.isfinite(observed).all()


def test_actions_that_are_none_are_refused() -> None:
    light, pose = task_named("light", CONFIG), task_named("pose", CONFIG)
    for wrong in (np.array([3]), np.array([-1]), np.array([0.5]), np.array(1), np.array([1, 1])):
        with pytest.raises(ValueError, match="1 numbers from 0 to 2"):
            light.driven(wrong)
    with pytest.raises(ValueError, match="1 finite pairs"):
        pose.driven(np.array([[np.nan, 0.0]]))
    v, omega = pose.driven(np.array([[1.0, -1.0]]))[0]
    assert omega == pytest.approx(-v / CONFIG.geometry.radius_min)


@pytest.mark.parametrize("track", ["oval", "kidney", "grand-prix"])
def test_there_is_time_for_a_lap_on_a_long_track_too(track: str) -> None:
    task = task_named("track", load(None, [f"sim.room.map={track}"]).config)
    assert isinstance(task, AlongTrack)
    assert task.time_limit > 1.5 * task.length / task.speed


def test_a_task_that_is_none_and_a_track_without_a_line_are_refused() -> None:
    with pytest.raises(ConfigError, match="no such task; choose light, pose, track, clear"):
        task_named("fly", CONFIG)
    with pytest.raises(ConfigError, match=r"set sim\.room\.map=oval"):
        task_named("track", CONFIG)
    with pytest.raises(ConfigError, match="centre line cannot be read"):
        task_named("track", load(None, ["sim.room.map=flat"]).config)
