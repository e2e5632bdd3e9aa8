"""Records and replays a drive by LeRobot's own commands, and prints what was recorded. Runs where LeRobot is."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import av
from lerobot.datasets.lerobot_dataset import LeRobotDataset

ROBOT = ["--robot.type=txt1", "--robot.id=car", "--robot.seed=1", "--robot.camera=camera"]
DATASET = ["--dataset.repo_id=me/txt1", "--play_sounds=false"]
DRIVE = "[[2.0, 0.4, 0.3], [2.0, 0.4, -0.3]]"


def lerobot(command: str, *words: str) -> None:
    """Run one of LeRobot's commands."""
    program = Path(sys.executable).with_name(f"lerobot-{command}")
    done = subprocess.run([str(program), *words], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(done.stderr[-3000:])


def main(folder: str) -> None:
    """Record into a folder, load that, and replay it."""
    root = Path(folder) / "dataset"
    shutil.rmtree(root, ignore_errors=True)
    recording = [f"--dataset.root={root}", "--dataset.single_task=drive", "--dataset.num_episodes=1"]
    recording += ["--dataset.episode_time_s=5", "--dataset.reset_time_s=0", "--dataset.fps=10"]
    recording += ["--dataset.push_to_hub=false", "--dataset.vcodec=h264", "--display_data=false"]
    lerobot("record", *ROBOT, "--teleop.type=txt1_keys", f"--teleop.drive={DRIVE}", *DATASET, *recording)
    dataset = LeRobotDataset("me/txt1", root=root)
    rows = dataset.hf_dataset
    (video,) = root.rglob("*.mp4")
    with av.open(str(video)) as opened:
        pictures = [frame.to_ndarray(format="rgb24") for frame in opened.decode(video=0)]
    told = {
        "state": dataset.features["observation.state"]["names"],
        "action": dataset.features["action"]["names"],
        "states": [[round(float(x), 4) for x in row["observation.state"]] for row in rows],
        "actions": [[round(float(x), 4) for x in row["action"]] for row in rows],
        "pictures": [len(pictures), *pictures[0].shape, float(pictures[-1].std())],
    }
    lerobot("replay", *ROBOT, *DATASET, f"--dataset.root={root}", "--dataset.episode=0")
    print(json.dumps(told))


if __name__ == "__main__":
    main(*sys.argv[1:])
