"""The learner that fits the place of the light finds it with sensors it knows nothing of, and says when it is late."""

from __future__ import annotations

from math import cos, exp, nan, sin

import numpy as np
import pytest

from txt1.config import load
from txt1.learning import locator
from txt1.learning.locator import LocatorAgent
from txt1.learning.trial import COMMANDS, Episode, Task, Trial, starts
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import LUX_MAX, LUX_MIN, MOUNT, Readings
from txt1.model.odometry import Odometry

MOUNTED = np.array(MOUNT)
SAMPLE = 0.0125


def agent(alarm: float = 0.02) -> LocatorAgent:
    return LocatorAgent(load(None, (f"learning.locator.alarm={alarm}",)).config)


def episodes(
    one: LocatorAgent,
    count: int,
    *,
    mount: np.ndarray = MOUNTED,
    bad: str = "",
    brightness: float = 135.0,
    commands: tuple[tuple[float, float], ...] = COMMANDS,
) -> list[Episode]:
    """Drive a car that follows its commands within 0.3 s; readings have 30 % noise, and one sensor may be `bad`."""
    rng = np.random.default_rng(3)
    trial = Trial(one, Task(goal_period=0.1), starts(2, 1, count), commands)
    now = 0.0
    while len(trial.episodes) < count:
        number = len(trial.episodes)
        x, y, theta = trial.start
        trial.placed(now)
        v = curvature = ox = oy = heading = 0.0
        command, first = (0.0, 0.0), None
        while len(trial.episodes) == number:
            for _ in range(4):
                now += SAMPLE
                v += (command[0] - v) * SAMPLE / 0.25
                bend = command[1] / command[0] if command[0] else 0.0
                curvature += (bend - curvature) * SAMPLE / 0.15
                way, turn = v * SAMPLE, curvature * v * SAMPLE
                theta, heading = theta + turn, wrap_angle(heading + turn)
                x, y, ox, oy = (
                    x + way * cos(theta),
                    y + way * sin(theta),
                    ox + way * cos(heading),
                    oy + way * sin(heading),
                )
                light = np.array([-cos(theta) * x - sin(theta) * y, sin(theta) * x - cos(theta) * y])
                lux = brightness / ((light - mount) ** 2).sum(axis=1) * (1.0 + 0.3 * rng.standard_normal(4))
                lux = np.clip(lux, LUX_MIN, LUX_MAX)
                first = lux[2] if first is None else first
                if bad:
                    lux[2] = {"nan": nan, "frozen": first, "saturated": LUX_MAX, "dead": 0.0}[bad]
                trial.see(now, Readings(*lux.tolist()), Odometry(ox, oy, heading, v, curvature * v))
            command = trial.tick(now, True, (x, y, theta), Odometry(ox, oy, heading, v, curvature * v))
    return trial.episodes


def ratio(some: list[Episode]) -> float:
    return sum(one.time for one in some) / sum(one.optimal_time for one in some)


@pytest.mark.parametrize("mount", [MOUNTED, MOUNTED * [1.0, -1.0]], ids=["as usual", "left and right swapped"])
def test_from_the_third_episode_on_it_drives_nearly_as_fast_as_can_be(mount: np.ndarray) -> None:
    done = episodes(agent(), 7, mount=mount)
    assert all(one.success for one in done)
    assert ratio(done[2:]) < 1.4


@pytest.mark.parametrize("speed", [1.0, 0.25])
def test_it_learns_what_its_actions_do_and_how_they_lag(speed: float) -> None:
    one = agent()
    episodes(one, 3, commands=tuple((speed * v, speed * omega) for v, omega in COMMANDS))
    (stays, *ways, _), (_, *curvatures, _) = one.memory()["effects"]
    assert stays == pytest.approx(exp(-0.1 / 0.25), abs=0.05)
    assert ways == pytest.approx([0.1 * speed * v for v, _ in COMMANDS], rel=0.05)
    assert curvatures == pytest.approx([omega / v for v, omega in COMMANDS], rel=0.1, abs=0.1)


@pytest.mark.parametrize("bad", ["nan", "frozen", "saturated", "dead"])
def test_it_lives_with_a_sensor_that_tells_nothing(bad: str) -> None:
    done = episodes(agent(), 4, bad=bad)
    assert all(one.success for one in done)
    assert ratio(done[2:]) < 1.6


def test_it_says_in_the_episode_that_it_is_late_and_begins_the_next_without_doubt() -> None:
    one = agent()
    episodes(one, 3)
    one.begin()
    odometry = Odometry()
    for k in range(1200):
        one.see(Readings(60.0, 61.0, 59.0, 60.0 + 0.01 * (k % 3)), odometry)
        if k % 8 == 7:
            one.act(0.1 * (k // 8), odometry)
    assert one.unfit == "how long the way takes", "it has not moved for 15 s"
    one.end(False, odometry)
    one.begin()
    assert not one.unfit


def test_its_doubt_is_a_test_with_the_stated_rate() -> None:
    rng = np.random.default_rng(1)
    rates = [
        locator.improbable(float(each), (0.1 * rng.standard_normal(20)).tolist(), 0.05)
        for each in 0.1 * rng.standard_normal(2000)
    ]
    assert 0.01 < sum(rates) / 2000 < 0.08


def test_it_goes_on_from_its_memory_and_forgets_a_void_episode() -> None:
    one, other = agent(), agent()
    episodes(one, 2)
    other.recall(one.memory())
    assert other.memory() == one.memory()
    before = one.memory()
    one.begin()
    for k in range(80):
        one.see(Readings(20.0 + k, 21.0, 19.0, 20.0), Odometry())
        if k % 8 == 7:
            one.act(0.1 * (k // 8), Odometry())
    one.void()
    assert one.memory() == before
    with pytest.raises(ValueError, match="knows 3 actions where 2 are needed"):
        LocatorAgent(load(None, ("learning.actions=[[0.3,-0.5],[0.3,0.5]]",)).config).recall(before)
    table = one.table()
    driver = LocatorAgent(load(None, ()).config, np.random.default_rng(1), table)
    assert driver.memory() == before and table.values.shape == (1, 15)
