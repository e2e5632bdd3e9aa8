"""Several robots in one room, as PettingZoo has it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from txt1.config import load
from txt1.errors import ConfigError

pytest.importorskip("pettingzoo")

from pettingzoo.test import parallel_api_test, parallel_seed_test

from tests.unit.learning.test_env import steered
from txt1.learning.parallel_env import LightSeekingParallelEnv


def test_pettingzoos_own_tests_pass() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(LightSeekingParallelEnv(robots=3), num_cycles=60)
        parallel_seed_test(lambda: LightSeekingParallelEnv(robots=2), num_cycles=5)


def test_robots_share_the_room_and_an_episode_of_one_ends_alone() -> None:
    env = LightSeekingParallelEnv(load(overrides=["learning.time_limit=60"]).config, robots=4, render_mode="rgb_array")
    seen, _ = env.reset(seed=1)
    ended: dict[str, dict[str, bool]] = {}
    while env.agents:
        actions = {name: np.int64(steered(seen[name])) for name in env.agents}
        seen, _, over, late, told = env.step(actions)
        ended |= {name: told[name] for name in told if over[name] or late[name]}
    assert len(ended) == 4 and any(each["success"] for each in ended.values())
    picture = env.render()
    assert picture is not None and len(np.unique(picture.reshape(-1, 3), axis=0)) >= 6


def test_what_is_no_action_is_refused() -> None:
    env = LightSeekingParallelEnv(robots=1)
    env.reset(seed=1)
    with pytest.raises(ValueError, match="from 0 to 2"):
        env.step({"robot_0": 3})
    with pytest.raises(ValueError, match="robot_9 is not under way"):
        env.step({"robot_9": 0})
    with pytest.raises(ConfigError, match="robots: 0"):
        LightSeekingParallelEnv(robots=0)
