"""Real pictures: a policy taught with the first of them beside donkeycar's linear model, taught with the same.

    python -m benchmarks.teaching pictures FOLDER|FILE.tar.gz [--teach 0:500] [--judge 500:700]

The folder holds records.jsonl, a line a picture in the order of time (image, steering, throttle), and images/. The peer
runs in a Python of its own, which `PEER` makes; without a network it is left out, and that is said.
"""

import json
import subprocess
import sys
import tarfile
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Final

import numpy as np

from txt1.teaching.features import CAMERA_TRUNK, HORIZON_SHARE, PICTURE, Seen, Sight, picture
from txt1.teaching.training import LessonSet, Recipe, train

VENV: Final = Path("build/donkey-venv")
PEER: Final = (
    (sys.executable, "-m", "venv", str(VENV)),
    (
        *(str(VENV / "bin" / "python"), "-m", "pip", "install", "--quiet", "donkeycar==5.3.0", "numpy<2"),
        *("tensorflow-cpu==2.15.*", "opencv-contrib-python-headless==4.9.*", "albumentations", "pandas", "matplotlib"),
    ),
)
"""How the peer is installed: donkeycar 5.3.0 asks for this TensorFlow, which has wheels up to Python 3.11."""
SCRIPT: Final = Path(__file__).parent / "donkeycar_linear.py"


def arguments(parser: ArgumentParser) -> None:
    """Add what the benchmark takes."""
    parser.add_argument("folder", nargs="?", type=Path, default=Path("../shared/data/track/track-700.tar.gz"))
    parser.add_argument("--teach", default="0:500", metavar="FROM:TO", help="lines that are taught")
    parser.add_argument("--judge", default="500:700", metavar="FROM:TO", help="lines that are judged")
    parser.add_argument("--seeds", type=int, default=5, help="trainings of each")
    parser.add_argument("--no-peer", action="store_true", help="without donkeycar")


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The folder with records.jsonl, of a folder or an archive."""
    with TemporaryDirectory() as made:
        root = path
        if path.is_file():
            with tarfile.open(path) as archive:
                archive.extractall(made, filter="data")
            root = Path(made)
        found = sorted(root.glob("**/records.jsonl"))
        if not found:
            raise SystemExit(f"{path}: no records.jsonl in it")
        yield found[0].parent


def lessons_of(folder: Path) -> tuple[list[Sight], LessonSet]:
    """All pictures of a folder, and what the human did."""
    records = [json.loads(line) for line in (folder / "records.jsonl").read_text(encoding="utf-8").splitlines()]
    pictures = [picture((folder / "images" / each["image"]).read_bytes(), *PICTURE, HORIZON_SHARE) for each in records]
    commands = np.array([(each["steering"], each["throttle"]) for each in records], np.float32)
    # the times in the file are those of its making, and 20 a second is what donkeycar records
    times = np.arange(len(records)) / 20.0
    sight = Sight("camera", "camera", (*PICTURE, 3), CAMERA_TRUNK)
    return [sight], LessonSet(Seen((np.stack(pictures),)), commands, np.ones(len(records), np.float32), times)


def score(said: np.ndarray, did: np.ndarray) -> tuple[float, float]:
    """Root mean square error and correlation of the steering."""
    return float(np.sqrt(np.mean((said - did) ** 2))), float(np.corrcoef(said, did)[0, 1])


def peer(folder: Path, given: Namespace, seed: int) -> dict[str, object]:
    """What donkeycar's linear model says."""
    if not (VENV / "bin" / "python").exists():
        for command in PEER:
            subprocess.run(command, check=True)
    with TemporaryDirectory() as made:
        out = Path(made) / "out.json"
        words = [str(folder.resolve()), given.teach, given.judge, str(seed), str(out)]
        command = [str((VENV / "bin" / "python").absolute()), str(SCRIPT), *words]
        subprocess.run(command, check=True, capture_output=True)
        return dict(json.loads(out.read_text()))


def main(given: Namespace) -> None:
    """Print errors and parameters of both."""
    with unpacked(given.folder) as folder:
        sights, lessons = lessons_of(folder)
        taught, held = (lessons.at(slice(*map(int, word.split(":")))) for word in (given.teach, given.judge))
        did = held.commands[:, 0].astype(float)
        print(
            f"{given.folder.name}: taught {len(taught)}, judged {len(held)} pictures; {given.seeds} trainings of each"
        )
        straight = float(np.sqrt(np.mean(did**2)))
        print(f"the human's steering there: deviation {did.std():.4f}; straight on all the time: rms {straight:.4f}")
        rows = []
        for seed in range(given.seeds if not given.no_peer else 0):
            try:
                told = peer(folder, given, seed)
            except (OSError, subprocess.CalledProcessError) as error:
                print(f"donkeycar is left out, as it cannot be run here: {error}")
                break
            rows.append((*score(np.array(told["steering"]), did), int(str(told["parameters"]))))
        show("donkeycar's linear model", rows)
        rows, began = [], perf_counter()
        for seed in range(given.seeds):
            recipe = Recipe(seed=seed)
            ensemble = train(sights, taught, recipe)
            said = ensemble.outputs(held.seen).mean(0)[:, 0].clip(-1.0, 1.0).astype(float)
            rows.append((*score(said, did), sum(each.shape.parameters for each in ensemble.networks)))
        show("txt1", rows)
        print(f"a training takes {(perf_counter() - began) / given.seeds:.1f} s")


def show(name: str, rows: list[tuple[float, float, int]]) -> None:
    """Print a contender's line."""
    if rows:
        rms, correlation, parameters = (np.array(each) for each in zip(*rows, strict=True))
        print(
            f"{name}: rms {rms.mean():.4f} ({rms.min():.4f} to {rms.max():.4f}), correlation {correlation.mean():.3f} "
            f"({correlation.min():.3f} to {correlation.max():.3f}), {parameters[0]} parameters"
        )
