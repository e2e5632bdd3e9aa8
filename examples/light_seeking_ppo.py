"""Stable-Baselines3's PPO learns to find the light, in Gymnasium's form of the learning task.

    pip install 'txt1[gym]' stable-baselines3
    python examples/light_seeking_ppo.py

Not part of the tests: it needs PyTorch, and some minutes.
"""

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

STEPS = 100_000
EPISODES = 100


def main() -> None:
    model = PPO("MlpPolicy", make_vec_env("txt1/LightSeeking-v0", n_envs=8, seed=1), gamma=0.9, seed=1, verbose=1)
    model.learn(STEPS)
    env = gymnasium.make("txt1/LightSeeking-v0")
    reached, ratios = 0, []
    for seed in range(EPISODES):
        seen, info = env.reset(seed=10_000 + seed)
        steps, over = 0, False
        while not over:
            action, _ = model.predict(seen, deterministic=True)
            seen, _, terminated, truncated, told = env.step(action)
            steps, over = steps + 1, terminated or truncated
        reached += told["success"]
        ratios.append(0.5 * steps / info["optimal_time"])
    print(f"reached the light in {reached} of {EPISODES} episodes, mean ratio to the optimum {np.mean(ratios):.2f}")


if __name__ == "__main__":
    main()
