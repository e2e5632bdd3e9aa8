"""The learning task as Stable-Baselines3 sees it, and PPO that learns in it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tests.patience import LIMIT
from txt1.config import load
from txt1.installing import installs
from txt1.learning.trial import Start, starts


def test_without_stable_baselines3_one_line_names_the_extra() -> None:
    program = "import sys; sys.modules['stable_baselines3'] = None; import studies.learners.sb3"
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=LIMIT, check=False)
    assert installs("sb3") in shown.stderr.splitlines()[-1]


class TestWithIt:
    @pytest.fixture(autouse=True)
    def its_extra(self) -> None:
        pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 (extra sb3) is not installed")

    def test_an_episode_that_has_ended_begins_anew_at_once_and_says_how_it_ended(self) -> None:
        from studies.learners.sb3 import DECISION, LightSeekingVecEnv

        env = LightSeekingVecEnv(load().config, 4, seed=1)
        env.reset()
        seen = env.place([Start(0.0, np.pi)] * 4)  # the light is straight ahead, 1.25 m away
        assert env.observation_space.contains(seen[0])
        steps, over = 0, np.zeros(4, bool)
        while not over.any():
            seen, rewards, over, told = env.step(np.ones(4, np.int64))
            steps += 1
        assert 2.5 < steps * DECISION < 3.5, "0.75 m to the goal's circle, from rest"
        k = int(over.argmax())
        assert told[k]["success"] and not told[k]["TimeLimit.truncated"]
        assert told[k]["terminal_observation"][-5] > 0.2 > abs(seen[k][-5]), "it drove, and rests on its next start"
        assert rewards[k] > -1.0

    def test_the_same_seed_is_the_same_drive_and_another_is_not(self) -> None:
        from studies.learners.sb3 import LightSeekingVecEnv

        def drive(seed: int) -> list[float]:
            env = LightSeekingVecEnv(load().config, 2, seed)
            env.reset()
            return [float(env.step(np.array([k % 3, 1]))[0].sum()) for k in range(5)]

        assert drive(1) == drive(1) != drive(2)

    def test_a_delay_is_in_what_is_observed_and_in_what_happens(self) -> None:
        from studies.learners.sb3 import LightSeekingVecEnv

        env = LightSeekingVecEnv(load(None, ["learning.delay=0.3"]).config, 1, seed=1)
        env.reset()
        speeds = []
        for _ in range(6):
            seen, *_ = env.step(np.array([1]))
            speeds.append(float(seen[0][-5]))
        assert speeds[:3] == [0.0, 0.0, 0.0] and speeds[-1] > 0.05
        assert seen[0].reshape(5, -1)[:, 7].tolist() == [1.0] * 5, "the last five actions"

    @pytest.mark.long
    def test_ppo_reaches_the_light_more_often_the_longer_it_learns(self) -> None:
        from studies.learners import sb3

        config, where, found = load().config, starts(1, 1, 20), []
        times = [100.0, 6_000.0]
        sb3.train("ppo", config, 3, times, lambda driven, model: found.append(sb3.drive(model, config, where, 5)))
        early, late = (sum(success for _, success in some) for some in found)
        assert late > early + 2, "not that all do: of three trials of 20 000 s one came so far"
