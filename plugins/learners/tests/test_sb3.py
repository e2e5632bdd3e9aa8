"""The learning task as Stable-Baselines3 sees it, and PPO that learns in it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from tests.patience import LIMIT
from txt1.config import load
from txt1.errors import ConfigError
from txt1.installing import installs_plugin
from txt1.learning.trial import Start, starts


def test_without_stable_baselines3_one_line_names_the_extra() -> None:
    program = "import sys; sys.modules['stable_baselines3'] = None; import txt1_learners.studies.sb3"
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=LIMIT, check=False)
    assert installs_plugin("learners", "sb3") in shown.stderr.splitlines()[-1]


class TestWithIt:
    @pytest.fixture(autouse=True)
    def its_extra(self) -> None:
        pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 (extra sb3) is not installed")

    def test_an_episode_that_has_ended_begins_anew_at_once_and_says_how_it_ended(self) -> None:
        from txt1_learners.studies.sb3 import DECISION, LightSeekingVecEnv

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
        from txt1_learners.studies.sb3 import LightSeekingVecEnv

        def drive(seed: int) -> list[float]:
            env = LightSeekingVecEnv(load().config, 2, seed)
            env.reset()
            return [float(env.step(np.array([k % 3, 1]))[0].sum()) for k in range(5)]

        assert drive(1) == drive(1) != drive(2)

    def test_a_delay_is_in_what_is_observed_and_in_what_happens(self) -> None:
        from txt1_learners.studies.sb3 import LightSeekingVecEnv

        env = LightSeekingVecEnv(load(None, ["learning.delay=0.3"]).config, 1, seed=1)
        env.reset()
        speeds = []
        for _ in range(6):
            seen, *_ = env.step(np.array([1]))
            speeds.append(float(seen[0][-5]))
        assert speeds[:3] == [0.0, 0.0, 0.0] and speeds[-1] > 0.05
        assert seen[0].reshape(5, -1)[:, 7].tolist() == [1.0] * 5, "the last five actions"

    @pytest.mark.parametrize("actions", [[-1, 0], [0, 3], [0.0, 1.0], [1.7, 0.0], [0], [[0, 1]]])
    def test_actions_outside_the_space_are_refused(self, actions: list[float]) -> None:
        from txt1_learners.studies.sb3 import LightSeekingVecEnv

        env = LightSeekingVecEnv(load().config, 2, seed=1)
        env.reset()
        with pytest.raises(ValueError, match="give 2 of 0 to 2"):
            env.step(np.array(actions))

    def test_a_post_that_is_touched_ends_an_episode(self) -> None:
        from txt1_learners.studies.sb3 import LightSeekingVecEnv

        post = "sim.obstacles=[{kind: post, x: 0.75, y: 0, radius: 0.05}]"
        env = LightSeekingVecEnv(load(None, [post]).config, 1, seed=1)
        env.place([Start(0.0, np.pi)])  # the light is straight ahead, behind the post
        for _ in range(30):
            _, (reward,), (over,), (told,) = env.step(np.array([1]))
            if over:
                break
        assert over and not told["success"] and reward < -5.0

    def test_a_world_moves_the_goal_turns_commands_round_and_takes_odometry_away(self) -> None:
        from txt1_learners.studies.sb3 import DECISION, LightSeekingVecEnv

        def drive(options: str, action: int = 1) -> tuple[float, float]:
            env = LightSeekingVecEnv(load(None, ["learning.world=composed", options]).config, 1, seed=1)
            env.place([Start(0.0, np.pi)])
            for k in range(1, 80):
                seen, _, (over,), _ = env.step(np.array([action]))
                if over or (k == 20 and action != 1):
                    break
            return k * DECISION, float(seen[0][-4])

        usual, _ = drive("learning.world_options={}")
        assert drive("learning.world_options={lamps: [{velocity: [0.1, 0.0]}]}")[0] < usual - 0.3
        assert (
            drive("learning.world_options={}", 2)[1] > 0.3 > -0.3 > drive("learning.world_options={turning: -1}", 2)[1]
        )
        assert drive("learning.world_options={odometry: {missing: true}}", 2)[1] == 0.0

    @pytest.mark.parametrize(
        ("setting", "told"),
        [
            ("learning.changes=[{episode: 2, set: {learning.delay: 0.1}}]", "learning.changes: .* do not model it"),
            ("learning.drift={sim.vehicle.slip: [0.0, 0.1]}", "learning.drift"),
            ("learning.goal_period=0.5", "learning.goal_period: 0.5"),
            ("sensors.laser.driver=sim_laser", "sensors.laser.driver"),
            ("learning.goal_radius=2", "learning.goal_radius: 2: every start"),
        ],
    )
    def test_what_it_does_not_model_and_what_cannot_be_solved_is_refused(self, setting: str, told: str) -> None:
        from txt1_learners.studies.sb3 import LightSeekingVecEnv

        with pytest.raises(ConfigError, match=told):
            LightSeekingVecEnv(load(None, [setting]).config, 2)

    @pytest.mark.long
    def test_ppo_reaches_the_light_more_often_the_longer_it_learns(self) -> None:
        from txt1_learners.studies import sb3

        config, where, found = load().config, starts(1, 1, 20), []
        times = [100.0, 6_000.0]
        sb3.train("ppo", config, 3, times, lambda driven, model: found.append(sb3.drive(model, config, where, 5)))
        early, late = (sum(success for _, success in some) for some in found)
        assert late > early + 2, "not that all do: of three trials of 20 000 s one came so far"
