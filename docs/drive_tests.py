"""Makes docs/drive-tests.md and its figures: `python docs/drive_tests.py` drives everything again, in minutes.

Every number in the page is measured here. `--real-time` also drives one circle against a board on a pseudo-terminal.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from txt1.cli import execute
from txt1.config import Config, load
from txt1.experiments import figures, report, run_folder
from txt1.experiments.command import ENDLESS, drive
from txt1.experiments.metrics import measure
from txt1.experiments.profile import Profile, Step, load_profile
from txt1.experiments.run_folder import Run

HERE = Path(__file__).parent
FIGURES = HERE / "drive-tests"
SERIAL = ("hal=serial", "serial.port=virtual")
WEAK = (
    "sim.vehicle.speed_gain=0.000231",
    "sim.vehicle.speed_time_constant=0.6",
    "sim.vehicle.servo_rate=3.490658503988659",
)
LOCK = Profile(
    title="Full lock at 0.5 m/s",
    figure="velocities",
    steps=tuple(Step(v=0.5 if omega is not None else 0.0, omega=omega or 0.0, seconds=4.0)
                for omega in (None, 0.0, 0.5 / 0.56, 0.0)),
)  # fmt: skip


def main() -> None:
    """Drive, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--real-time", action="store_true", help="also drive against a board on a pseudo-terminal")
    arguments = parser.parse_args()
    FIGURES.mkdir(exist_ok=True)
    parts = [INTRODUCTION]
    sim = {name: run(load_profile(name), name) for name in NAMES}
    serial = {name: run(load_profile(name), name, *SERIAL) for name in NAMES if name != "battery-run"}
    empty = run(load_profile("battery-run"), "stop disabled", safe_end=False)
    parts.append(beside_the_thesis(sim, empty, run(LOCK, "lock")))
    for name in NAMES:
        parts.append(f"## {name}\n\n`txt1 experiment {name} --seed 1`\n")
        runs = [sim[name]._replace(label="sim")]
        if name == "battery-run":
            parts.append(BATTERY)
            runs = [sim[name]._replace(label="stop at the safe end"), empty]
        parts.append(picture(name, runs))
        parts.append(report.markdown(runs))
        parts.append("\n".join(ending(each) for each in runs) + "\n")
        if name in serial:
            both = [runs[0], serial[name]._replace(label="serial, virtual")]
            if arguments.real_time and name == "circle-fast":
                both.append(on_a_pty(name))
            both = run_folder.alike(both)
            parts.append("By the encoders, beside the same behind the wire protocol:\n")
            parts.append(picture(f"{name}-serial", both))
            parts.append(report.markdown(both))
    parts.append(TUNING)
    for title, key, settings in (("The nominal vehicle", "nominal", ()), (WEAK_TITLE, "weak", WEAK)):
        parts.append(f"### {title}\n")
        words = [word for setting in settings for word in ("--set", setting)]
        parts.append(f"`txt1 tune --seed 1 --repeats 7 {' '.join(words)}`\n".replace(" `", "`"))
        with tempfile.TemporaryDirectory() as folder:
            execute(
                ["tune", "--seed", "1", "--repeats", "7", "--out", folder, "--write", f"{folder}/gains.yaml", *words]
            )
            parts.append(f"```yaml\n{Path(folder, 'gains.yaml').read_text()}```\n")
            for test in ("linear-steps", "angular-steps"):
                pair = [run_folder.read(Path(folder, f"{test}-{which}")) for which in ("old", "new")]
                parts.append(old_and_new(pair))
                parts.append(picture(f"{test}-tuned-{key}", pair))
    (HERE / "drive-tests.md").write_text("\n".join(parts).rstrip() + "\n")


def configured(*settings: str) -> Config:
    """The configuration of every run here: no walls, seed 1."""
    return load(None, [*ENDLESS, "seed=1", *settings], {}).config


def run(profile: Profile, label: str, *settings: str, safe_end: bool = True) -> Run:
    """A profile, driven and measured."""
    print(f"{label} {' '.join(settings)}", file=sys.stderr)
    outcome = drive(configured(*settings), profile, "max", safe_end=safe_end).outcome
    assert outcome is not None
    return Run(label, profile, outcome.recording, measure(outcome, profile))


def on_a_pty(name: str) -> Run:
    """An experiment in real time, against a board in another process."""
    with tempfile.TemporaryDirectory() as folder:
        room = [word for setting in ENDLESS for word in ("--set", setting)]
        board = subprocess.Popen(  # noqa: S603
            [sys.executable, "-m", "txt1", "board", "--pty", f"{folder}/board", "--json", *room]
        )
        try:
            while not Path(folder, "board").exists():
                time.sleep(0.1)
            words = ["--hal", "serial", "--port", f"{folder}/board", "--arm", "--out", f"{folder}/run", "--no-figure"]
            execute(["experiment", name, *words])
            return run_folder.read(Path(folder, "run"))._replace(label="serial, pty, real time")
        finally:
            board.terminate()
            board.wait()


def picture(name: str, runs: list[Run]) -> str:
    """Draw runs into a file, and the line that shows it."""
    figures.draw(runs, FIGURES / f"{name}.png")
    return f"![{name}](drive-tests/{name}.png)\n"


def ending(each: Run) -> str:
    """How a run ended, in a sentence."""
    told = each.metrics
    warned = told["battery_warning_s"]
    warning = "" if warned is None else f" The battery warning came after {warned / 60.0:.1f} min."
    return f"Ended by {told['stopped_by']} after {told['duration_s'] / 60.0:.1f} min.{warning}"


def beside_the_thesis(sim: dict[str, Run], empty: Run, lock: Run) -> str:
    """The table of what the thesis reports and what these runs show."""
    linear, angular = sim["linear-steps"].metrics["steps"], sim["angular-steps"].metrics
    turns = [step for step in angular["steps"] if step["channel"] == "omega"]
    slow, fast = (sim[f"circle-{name}"].metrics["circle"] for name in ("slow", "fast"))
    battery = sim["battery-run"].metrics["battery"]
    into, _ = lock.metrics["droop"]

    def span(steps: list[dict[str, Any]], key: str, factor: float = 1.0) -> str:
        values = [factor * step[key] for step in steps]
        return f"{min(values):.2f} to {max(values):.2f}"

    rows = [
        ("speed steps (4.2, 4.4)", "quick, little to no overshoot",
         f"rise {span(linear, 'rise')} s, settling {span(linear, 'settling')} s, "
         f"overshoot {span(linear, 'overshoot', 100.0)} %"),
        ("yaw-rate steps (4.3, 4.4)", "tracks well",
         f"rise {span(turns, 'rise')} s, settling {span(turns, 'settling')} s, "
         f"overshoot {span(turns, 'overshoot', 100.0)} %"),
        ("speed while the yaw rate steps (4.4)", "not much droop",
         f"{100.0 * max(each['droop'] for each in angular['droop']):.1f} % at most"),
        ("straight ahead to full lock (4.2)", "droops by up to 10 %", f"{100.0 * into['droop']:.1f} %"),
        ("full lock to straight ahead (4.2)", "overshoots by up to 10 %",
         f"rises by {100.0 * rise_after(lock):.1f} %"),
        ("circle, 2 m (4.5)", "followed accurately, laps overlap",
         f"radius {slow['radius']:.3f} m, laps {1000.0 * slow['lap_to_lap']:.1f} mm apart"),
        ("circle, 1 m (4.6)", "followed accurately, laps overlap",
         f"radius {fast['radius']:.3f} m, laps {1000.0 * fast['lap_to_lap']:.1f} mm apart"),
        ("battery line (3.13)", "12.165769 V - 0.033691 V/min t",
         f"{battery['intercept']:.4f} V - {-battery['slope']:.6f} V/min t"),
        ("safe end (3.6.3)", "46 min", f"{battery['driven']:.1f} min, stopped by itself"),
        ("empty (3.6.3)", "50 min", f"{empty.metrics['duration_s'] / 60.0:.1f} min, {empty.metrics['stopped_by']}"),
    ]  # fmt: skip
    lines = ["| what | the thesis reports | measured here |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {a} | {b} | {c} |" for a, b, c in rows)]) + "\n\n" + DIFFERENCES


def rise_after(lock: Run) -> float:
    """Largest share by which the speed exceeds its steady value in the second after the steering is straightened."""
    recording = lock.recording
    time_, v = recording["time"], recording["true_v"]
    straight = [k for k in range(1, len(time_)) if recording["set_omega"][k] < recording["set_omega"][k - 1]][-1]
    second = (time_ >= time_[straight]) & (time_ <= time_[straight] + 1.0)
    steady = v[time_ > time_[straight] + 2.0].mean()
    return float(v[second].max() / steady - 1.0)


def old_and_new(pair: list[Run]) -> str:
    """Settling time and overshoot of every step, old beside new."""
    lines = ["| step | settling: old | new | overshoot: old | new |", "|---|---|---|---|---|"]
    for old, new in zip(*(each.metrics["steps"] for each in pair), strict=True):
        name = f"{'v' if old['channel'] == 'v' else 'ω'} {old['before']:g} → {old['after']:g}"
        lines.append(
            f"| {name} | {old['settling']:.2f} s | {new['settling']:.2f} s "
            f"| {100.0 * old['overshoot']:.1f} % | {100.0 * new['overshoot']:.1f} % |"
        )
    return "\n".join(lines) + "\n"


NAMES = ("linear-steps", "angular-steps", "circle-slow", "circle-fast", "waypoints", "battery-run")
WEAK_TITLE = "30 % less motor gain, and twice the lag of motors and servos"

INTRODUCTION = """\
# The drive tests

The thesis's tests of its controllers (4.4), the way along waypoints and the battery run (3.6.3), driven again in
simulation with the thesis's gains. `python docs/drive_tests.py --real-time` makes this page: every number and figure in
it is measured by that run.

Responses are judged as means over 0.2 s: by the simulator's true motion, or by the encoders where it says so. A
response has settled when it stays within 5 % of the step around its end value, on hardware within at least one count of
the encoders (16 mm/s, 64 mrad/s). "off" is the end value less the set-point. Set-points are published every 0.1 s.
"""

DIFFERENCES = """\
Where they differ:

- The encoders sit on the steered front wheels. In a curve they read 1 / cos φ of the speed and cos φ of the yaw rate.
  The loops bring what they read to the set-points, so the true circle is smaller than v / ω, the true yaw rate higher
  and the true speed lower; behind the wire, where only the encoders tell, the circles have their radius. The thesis's
  figures 4.5 and 4.6 are drawn from odometry, which cannot show it.
- The thesis's robot lost traction in the faster steps. The simulated tyres do not slip (`sim.vehicle.slip` is 0), so
  the steps to 1 m/s are as clean as the others.
- The simulated floor is even but for 3 % of drag, so laps lie closer together than on tile.
- The safe end comes a little early: the robot judges a voltage that is read with 10 mV of noise.
"""

BATTERY = """\
The robot stops by itself when its voltage says that no time is left (`--no-safe-end` switches that off).
"""

TUNING = """\
## Tuning

`txt1 tune` sets the motor and the steering by hand for a minute, finds the vehicle in what the encoders tell, and tries
gains on a model of it: those that settle soonest with no more overshoot and noise than the gains in force. The yaw
rate's loop is found at one speed and scaled to every set of the schedule by the highest speed it is in force at. Then
old and new gains drive both step tests; a table shows the mean of seven runs with different seeds. In such a mean the
uneven floor leaves 0.1 to 0.2 % of overshoot, also where there is none.
"""


if __name__ == "__main__":
    main()
