"""Stable-Baselines3's PPO learns a task, and its network drives the robot as a policy from elsewhere.

    python -m pip install '.[gym,fast,teach]' stable-baselines3 onnx
    PYTHONPATH=. python examples/ppo_drives.py light 1000000          # writes ppo.onnx and ppo.yaml
    txt1 run --set sensors.light.driver=sim_light --source ppo.onnx --card ppo.yaml

On the robot it sees single samples of the light, in training filtered ones: set sim.light.noise for that.

Not part of the tests, and not run where this was written: it needs PyTorch.
"""

import sys
from pathlib import Path

import numpy as np
import torch
import yaml
from stable_baselines3 import PPO

from txt1.config import load
from txt1.learning.env import DriveVectorEnv
from txt1.learning.stable_baselines import vec_env

ROBOTS, EPISODES = 64, 200


class Actions(torch.nn.Module):  # type: ignore[misc]  # without PyTorch its types are not known
    """The numbers of a policy's actions, for the exporter."""

    def __init__(self, model: PPO) -> None:
        super().__init__()
        self.policy = model.policy

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return a number for each action, the largest of which is taken."""
        return self.policy.get_distribution(seen).distribution.logits


def main(task: str, steps: int) -> None:
    """Learn, drive some episodes, and write the network with its card."""
    robots = DriveVectorEnv(ROBOTS, task, load().config)
    model = PPO("MlpPolicy", vec_env(robots), n_steps=128, batch_size=1024, gamma=0.98, seed=1, device="cpu", verbose=1)
    model.learn(steps)
    seen, _ = robots.reset(seed=2)
    won = ended = 0
    while ended < EPISODES:
        seen, _, terminated, truncated, told = robots.step(model.predict(seen, deterministic=True)[0])
        ended += int((terminated | truncated).sum())
        won += int((told["success"] & terminated).sum())
    print(f"after {steps} decisions it reached the goal in {won} of {ended} episodes")
    if task != "light":
        return
    network = Actions(model).eval()
    torch.onnx.export(network, torch.zeros(1, len(robots.drives.task.low)), "ppo.onnx", dynamo=False)
    commands = np.asarray(robots.drives.task.commands).tolist()
    sees = [{"kind": "light", "sensor": "light"}, {"kind": "odometry"}]
    card = {"sees": sees, "says": {"commands": commands}, "rate": 1.0 / robots.drives.task.period}
    Path("ppo.yaml").write_text(yaml.safe_dump(card), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "light", int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000)
