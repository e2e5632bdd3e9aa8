"""Stable-Baselines3's PPO learns a task and prints how it drives; its network drives the robot to the light, too.

    python -m pip install '.[gym,fast,teach]' stable-baselines3 onnx
    PYTHONPATH=. python examples/ppo_drives.py light 8        # minutes of processor; writes ppo.onnx and ppo.yaml
    PYTHONPATH=. python examples/ppo_drives.py track 8        # laps on two tracks that it has not seen
    txt1 run --set sensors.light.driver=sim_light --source ppo.onnx --card ppo.yaml

On the robot it sees single samples of the light, in training filtered ones: set sim.light.noise for that.

It needs PyTorch; the long tests run it for a moment where Stable-Baselines3 is installed.
"""

import argparse
import itertools
import time
from pathlib import Path

import numpy as np
import torch
import yaml
from stable_baselines3 import PPO

from txt1.config import load
from txt1.learning.best_time import known_floor
from txt1.learning.env import DriveVectorEnv, start_of
from txt1.learning.stable_baselines import vec_env

ROBOTS, CHUNK = 64, 100_000
SEEN, UNSEEN = ("oval", "clover", "kart"), ("kidney", "chicane")
# of a return a decision later, and the first rate of learning: a lap is long, and gentle changes keep its end in sight
GAMMA, RATE = {"light": 0.98, "track": 0.995}, {"light": 1e-3, "track": 5e-4}
# logarithm of the first deviation of speed and steering: where they are tried at random, each drive ends at a wall, and
# standing is the best that is found
TRIED = -1.0


class Actions(torch.nn.Module):  # type: ignore[misc]  # without PyTorch its types are not known
    """The numbers of a policy's actions, for the exporter."""

    def __init__(self, model: PPO) -> None:
        super().__init__()
        self.policy = model.policy

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Return a number for each action, the largest of which is taken."""
        return self.policy.get_distribution(seen).distribution.logits


def robots(task: str, count: int, track: str | None = None) -> DriveVectorEnv:
    """Return robots for a task, on a track."""
    return DriveVectorEnv(count, task, load(None, [] if track is None else [f"sim.room.map={track}"]).config)


def driven(model: PPO, many: DriveVectorEnv) -> str:
    """Let each robot drive an episode by the best actions; return what came of it."""
    seen, _ = many.reset(seed=2)
    # a copy, as the view changes with the robots
    config, poses = many.bodies.config, many.bodies.seen().poses.copy()
    times, won = np.zeros(many.num_envs), np.zeros(many.num_envs, bool)
    while not times.all():
        seen, _, terminated, truncated, told = many.step(model.predict(seen, deterministic=True)[0])
        over = (terminated | truncated) & (times == 0.0)
        times[over] = many.drives.steps[over] * many.drives.task.period
        won[over] = told["success"][over]
    text = f"{won.sum()} of {len(won)} reached the goal"
    if won.any():
        text += f", in {times[won].mean():.2f} s"
    if won.any() and many.drives.task.light and (floor := known_floor(config)) is not None:
        text += (
            f", {times[won].sum() / sum(floor.time(start_of(each, config)) for each in poses[won]):.3f} of the floor"
        )
    return text


def main(task: str, minutes: float) -> None:
    """Learn, let it drive, and write the network of the light with its card."""
    torch.set_num_threads(1)
    begun = time.process_time()
    learned = itertools.cycle([vec_env(robots(task, ROBOTS, each)) for each in ((None,) if task == "light" else SEEN)])

    def left(_: float) -> float:
        return RATE[task] * max(0.02, 1.0 - (time.process_time() - begun) / (60.0 * minutes))

    model = PPO(
        "MlpPolicy",
        next(learned),
        n_steps=128,
        batch_size=1024,
        gamma=GAMMA[task],
        learning_rate=left,
        policy_kwargs={"log_std_init": TRIED},
        seed=1,
        device="cpu",
    )

    def goes_on(*_: object) -> bool:
        return time.process_time() - begun < 60.0 * minutes

    while goes_on():
        model.set_env(next(learned))
        model.learn(CHUNK, callback=goes_on, reset_num_timesteps=False)
    print(f"{model.num_timesteps} decisions, {(time.process_time() - begun) / 60.0:.1f} min of processor")
    if task != "light":
        for track in UNSEEN:
            print(f"{track}: {driven(model, robots(task, 10, track))}")
        return
    many = robots(task, 1000)
    print(driven(model, many))
    network = Actions(model).eval()
    torch.onnx.export(network, torch.zeros(1, len(many.drives.task.low)), "ppo.onnx", dynamo=False)
    sees = [{"kind": "light", "sensor": "light"}, {"kind": "odometry"}]
    says = {"commands": np.asarray(many.drives.task.commands).tolist()}
    card = {"sees": sees, "says": says, "rate": 1.0 / many.drives.task.period}
    Path("ppo.yaml").write_text(yaml.safe_dump(card), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="PPO learns a task, and prints how it drives.")
    parser.add_argument("task", nargs="?", choices=GAMMA, default="light")
    parser.add_argument("minutes", nargs="?", type=float, default=8.0, help="of processor")
    arguments = parser.parse_args()
    main(arguments.task, arguments.minutes)
