"""Stable-Baselines3's PPO learns to find the light, in the learning task as a vector environment.

    python -m pip install . './plugins/learners[sb3]'
    PYTHONPATH=. python examples/light_seeking_ppo.py [STEPS]     # from the root of a source tree

Not part of the tests: it needs PyTorch, and a minute or two. What PPO reaches is in docs/results/compared-learners.md.
"""

import sys

import numpy as np
from stable_baselines3 import PPO

from txt1.config import load
from txt1.learning.trial import starts, task_of
from txt1_learners.studies.sb3 import DECISION, LightSeekingVecEnv, drive

EPISODES = 200


def main(steps: int) -> None:
    config = load().config  # or any world: load(world_named("sensors-swapped")).config
    model = PPO(
        "MlpPolicy",
        LightSeekingVecEnv(config, 16, seed=1),
        n_steps=128,
        batch_size=256,
        gamma=0.99,
        learning_rate=1e-3,
        seed=1,
        device="cpu",
        verbose=1,
    )
    model.learn(steps)
    where = starts(10_000, 1, EPISODES)  # it has not seen them
    outcomes = drive(model, config, where, seed=2)
    times = [time for time, success in outcomes if success]
    optima = [
        start.optimal_time(task_of(config)) for start, (_, success) in zip(where, outcomes, strict=True) if success
    ]
    print(f"after {steps * DECISION:.0f} s of driving it reached the light in {len(times)} of {EPISODES} episodes")
    if times:
        print(
            f"in those: mean {np.mean(times):.2f} s, median {np.median(times):.2f} s, optimum {np.mean(optima):.2f} s, "
            f"ratio {sum(times) / sum(optima):.3f}"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)
