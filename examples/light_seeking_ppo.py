"""Stable-Baselines3's PPO learns to find the light, in Gymnasium's form of the learning task.

    pip install 'txt1[gym]' stable-baselines3
    python examples/light_seeking_ppo.py [STEPS]

Not part of the tests: it needs PyTorch, and some minutes. What it reached is in docs/learning.md.
"""

import sys

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import txt1.learning.env

gymnasium.register_envs(txt1.learning.env)  # importing it has done so

EPISODES = 200
DECISION = 0.5  # s


def main(steps: int) -> None:
    model = PPO(
        "MlpPolicy", make_vec_env("txt1/LightSeeking-v0", n_envs=8, seed=1), n_steps=256, gamma=0.9, seed=1, verbose=1
    )
    model.learn(steps)
    env = gymnasium.make("txt1/LightSeeking-v0")
    reached, times, optima = 0, [], []
    for seed in range(EPISODES):  # starts it has not seen
        seen, info = env.reset(seed=10_000 + seed)
        decisions, over = 0, False
        while not over:
            action, _ = model.predict(seen, deterministic=True)
            seen, _, terminated, truncated, told = env.step(action)
            decisions, over = decisions + 1, terminated or truncated
        reached += told["success"]
        times.append(DECISION * decisions)
        optima.append(info["optimal_time"])
    print(
        f"reached the light in {reached} of {EPISODES} episodes; mean {np.mean(times):.2f} s, "
        f"median {np.median(times):.2f} s, optimum {np.mean(optima):.2f} s, ratio {sum(times) / sum(optima):.3f}"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)
