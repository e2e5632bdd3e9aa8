"""``python docs/moving_picture.py``: docs/learns.gif, a robot that has learned, drawn from the recording of a real run.

It learns to find the light (`txt1 learn`), then drives to it from one place after another (`txt1 run --policy ... --log
...`); what is drawn is what was recorded: pose, velocity and set-point. Shown at twice the speed.
"""

from contextlib import redirect_stdout
from io import StringIO
from math import cos, sin
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from txt1.cli import execute
from txt1.record.reader import Decoding, FilePass

TARGET: Final = Path(__file__).with_name("learns.gif")
BEGIN, END, STEP = 1.0, 24.0, 0.25  # s: what is shown, and from picture to picture
BLUE, ORANGE, YELLOW, GREY = "#0072B2", "#D55E00", "#F0E442", "#777777"  # told apart by the colour-blind, too
BODY: Final = np.array([(-0.25, -0.19), (0.15, -0.19), (0.26, 0.0), (0.15, 0.19), (-0.25, 0.19)])  # m, of the TXT-1
PLACED: Final = 0.3  # m: it does not drive as far from one message to the next, so it was placed anew


def run(folder: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses (t, x, y, theta) and speeds (t, measured, set-point) of a run, in s, m, rad and m/s."""
    learned, log = folder / "learned", folder / "run.mcap"
    _done("learn", "--agent", "sweeps", "--trials", "1", "--episodes", "31", "--seed", "1", "--out", str(learned))
    _done(
        "run",
        "--policy",
        str(learned / "qtable.json"),
        "--log",
        str(log),
        "--seed",
        "1",
        "--speed",
        "max",
        "--headless",
        "--duration",
        str(END),
    )
    poses, speeds, asked, decoding, reading = [], [], 0.0, Decoding(), FilePass(log)
    for item in reading:
        time = reading.run_time(item)
        match item.name:
            case "/setpoint":
                asked = decoding.message(item).twist.linear.x
            case "/odom":
                speeds.append((time, decoding.message(item).twist.twist.linear.x, asked))
            case "/pose":
                pose = decoding.message(item).pose
                turn = 2.0 * np.arctan2(pose.orientation.z, pose.orientation.w)
                poses.append((time, pose.position.x, pose.position.y, turn))
    return np.array(poses), np.array(speeds)


def _done(*words: str) -> None:
    with redirect_stdout(StringIO()):
        code = execute(words)
    if code:
        raise SystemExit(code)


def draw(poses: NDArray[np.float64], speeds: NDArray[np.float64]) -> None:
    """Write the picture."""
    placed = np.hypot(*np.diff(poses[:, 1:3], axis=0).T) > PLACED
    starts = [0, *(np.flatnonzero(placed) + 1)]
    figure = Figure(figsize=(8.0, 4.1), dpi=72, layout="constrained")
    room, speed = figure.subplots(1, 2)
    room.set(xlim=(-1.9, 1.9), ylim=(-1.9, 1.9), aspect="equal", xlabel="x / m", ylabel="y / m")
    room.add_patch(Circle((0.0, 0.0), 0.12, facecolor=YELLOW, edgecolor="black", zorder=3))
    room.annotate("light", (0.0, 0.0), (0.0, -0.35), ha="center")
    speed.set(xlim=(0.0, END), ylim=(-0.1, 0.4), xlabel="t / s", ylabel="speed / (m/s)", title="its speed")
    speed.grid(alpha=0.3)
    (path,) = room.plot([], [], color=BLUE, linewidth=1.5)
    body = room.add_patch(Polygon(BODY, facecolor=ORANGE, edgecolor="black", zorder=4))
    speed.plot(speeds[:, 0], speeds[:, 2], "--", color=GREY, linewidth=1.2, label="set-point")
    (measured,) = speed.plot([], [], color=BLUE, linewidth=1.5, label="measured")
    speed.legend(loc="lower left", ncols=2, frameon=False)

    def show(time: float) -> None:
        now = int(np.searchsorted(poses[:, 0], time))
        start = max(each for each in starts if each <= now)
        _, x, y, theta = poses[now]
        turn = np.array([(cos(theta), -sin(theta)), (sin(theta), cos(theta))])
        body.set_xy(BODY @ turn.T + (x, y))
        path.set_data(poses[start : now + 1, 1], poses[start : now + 1, 2])
        past = speeds[speeds[:, 0] <= time]
        measured.set_data(past[:, 0], past[:, 1])
        room.set_title(f"drive {starts.index(start)} to the light" if start else "it waits for its gains")

    FuncAnimation(figure, show, list(np.arange(BEGIN, END - STEP, STEP))).save(TARGET, PillowWriter(fps=int(2 / STEP)))


if __name__ == "__main__":
    with TemporaryDirectory() as folder:
        draw(*run(Path(folder)))
