"""Records and replays a drive by LeRobot's own commands, trains a policy with it from nothing, and has that drive.

It prints what was recorded. Runs where LeRobot is.
"""

import json
import re
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import av
from lerobot.datasets.lerobot_dataset import LeRobotDataset

ROBOT = ["--robot.type=txt1", "--robot.id=car", "--robot.seed=1", "--robot.camera=camera"]
QUIET = "--play_sounds=false"
DRIVE = "[[2.0, 0.4, 0.3], [2.0, 0.4, -0.3]]"
RECORDING = ["--dataset.single_task=drive", "--dataset.num_episodes=1", "--dataset.episode_time_s=5"]
RECORDING += ["--dataset.reset_time_s=0", "--dataset.fps=10", "--dataset.push_to_hub=false"]
# options were renamed with LeRobot 0.6
SINCE_06 = tuple(map(int, version("lerobot").split(".")[:2])) >= (0, 6)
CODEC, EVALUATED = ("rgb_encoder.vcodec", "env_eval_freq") if SINCE_06 else ("vcodec", "eval_freq")
# a policy's drive is recorded by `rollout` then, by `record` before; each wants names of its own
DRIVEN = "me/rollout_txt1" if SINCE_06 else "me/eval_txt1"
RECORDING += [f"--dataset.{CODEC}=h264", "--display_data=false"]
# a small network for plain processors; pretrained weights would come from a hub
POLICY = ["--policy.type=act", "--policy.device=cpu", "--policy.push_to_hub=false"]
POLICY += ["--policy.pretrained_backbone_weights=null", "--policy.dim_model=64", "--policy.n_heads=4"]
POLICY += ["--policy.dim_feedforward=128", "--policy.n_encoder_layers=1", "--policy.optimizer_lr=1e-4"]
POLICY += ["--policy.chunk_size=10", "--policy.n_action_steps=10", "--policy.use_vae=false"]
TRAINING = ["--steps=60", "--batch_size=8", "--num_workers=0", "--log_freq=10", "--save_freq=60", "--seed=1"]
# torchcodec, the default, needs FFmpeg on the machine
TRAINING += [f"--{EVALUATED}=0", "--wandb.enable=false", "--dataset.video_backend=pyav"]


def lerobot(command: str, *words: str) -> str:
    """Run one of LeRobot's commands; returns what it printed."""
    program = Path(sys.executable).with_name(f"lerobot-{command}")
    done = subprocess.run([str(program), *words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(done.stderr[-3000:])
    return done.stdout + done.stderr


def rows(root: Path, name: str) -> dict[str, list[list[float]]]:
    """The states and actions of a dataset."""
    table = LeRobotDataset(name, root=root).hf_dataset
    columns = {"states": "observation.state", "actions": "action"}
    return {name: [[round(float(x), 4) for x in row[column]] for row in table] for name, column in columns.items()}


def main(folder: str) -> None:
    """Record into a folder, load that, and replay it; train a policy with it, and record how that drives."""
    root, drives, trained = (Path(folder) / name for name in ("dataset", "eval_dataset", "policy"))
    for each in (root, drives, trained):
        shutil.rmtree(each, ignore_errors=True)
    recorded, driven = (
        ["--dataset.repo_id=me/txt1", f"--dataset.root={root}"],
        [f"--dataset.repo_id={DRIVEN}", f"--dataset.root={drives}"],
    )
    keys = ["--teleop.type=txt1_keys", f"--teleop.drive={DRIVE}"]
    lerobot("record", *ROBOT, *keys, *recorded, *RECORDING, QUIET)
    features = LeRobotDataset("me/txt1", root=root).features
    (video,) = root.rglob("*.mp4")
    with av.open(str(video)) as opened:
        pictures = [frame.to_ndarray(format="rgb24") for frame in opened.decode(video=0)]
    lerobot("replay", *ROBOT, *recorded, "--dataset.episode=0", QUIET)
    told = lerobot("train", *recorded, *POLICY, f"--output_dir={trained}", *TRAINING)
    path = trained / "checkpoints" / "last" / "pretrained_model"
    given = (*ROBOT, f"--policy.path={path}", "--policy.device=cpu", *driven, *RECORDING, QUIET)
    if SINCE_06:
        lerobot("rollout", *given, "--strategy.type=episodic", "--fps=10")
    else:
        lerobot("record", *given)
    came = {
        "state": features["observation.state"]["names"],
        "action": features["action"]["names"],
        **rows(root, "me/txt1"),
        "pictures": [len(pictures), *pictures[0].shape, float(pictures[-1].std())],
        "losses": [float(loss) for loss in re.findall(r"\bloss:([\d.]+)", told)],
        "by the policy": rows(drives, DRIVEN),
    }
    print(json.dumps(came))


if __name__ == "__main__":
    main(*sys.argv[1:])
