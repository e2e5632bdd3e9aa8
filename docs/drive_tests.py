"""Makes docs/results/drive-tests.md and its figures: `python -m docs.drive_tests --real-time` drives everything again.

Every number in the page is measured here, in seven minutes on two quiet processors. `--real-time` also drives
against boards on pseudo-terminals, each in a process of its own. `--only Tuning` (or battery-run) makes that section
anew, all in virtual time, and leaves the rest of the page as it is. Every step, leg and gain goes to out/drive-tests.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import date
from math import hypot
from pathlib import Path
from typing import Any, Final, NamedTuple

from benchmarks.poses import Trip, sentence, trips
from txt1.cli import execute
from txt1.config import Config, load
from txt1.experiments import figures, report, run_folder
from txt1.experiments.command.experiment import ENDLESS, drive
from txt1.experiments.command.tune import TESTS, repeated
from txt1.experiments.metrics import QUANTUM, Deviation, difference, measure, paths_apart
from txt1.experiments.profile import Profile, ProfileStep, load_profile
from txt1.experiments.run_folder import Run
from txt1.kernel.loop import run as run_loop
from txt1.robot import Robot
from txt1.sim.room import Room

HERE = Path(__file__).parent / "results"
PAGE = HERE / "drive-tests.md"
FIGURES = HERE / "drive-tests"
DETAILS: Final = HERE.parents[1] / "out" / "drive-tests"
SERIAL = ("hal=serial", "serial.port=virtual")
WEAK = (
    "sim.vehicle.speed_gain=0.000231",
    "sim.vehicle.speed_time_constant=0.6",
    "sim.vehicle.servo_rate=3.490658503988659",
)
LOCK = Profile(
    title="Full lock at 0.5 m/s",
    figure="velocities",
    steps=tuple(
        ProfileStep(v=0.5 if omega is not None else 0.0, omega=omega or 0.0, seconds=4.0)
        for omega in (None, 0.0, 0.5 / 0.56, 0.0)
    ),
)
SEEN: Final = {
    "velocities": "speed and yaw rate over time, beside their set-points",
    "battery": "the voltage over time, and the lines through it",
    "steps": "the response to each step, with old and with new gains",
}
"""By a figure's layout, for readers who do not see it."""
REPEATS: Final = 30
"""Runs of a test with each set of gains."""
OTHER_SEED: Final = 1001
"""The first of the seeds on which tuned gains are tried again."""
PAIRS: Final = 1000
"""Random pose pairs for `go_to`."""


def detailed(name: str, runs: Sequence[Run]) -> None:
    """Keep the tables of some runs beside the page."""
    lines = []
    for title, head, rows in report.tables(runs):
        lines += [f"**{title}**", "", f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
        lines += [f"| {' | '.join(row)} |" for row in rows]
        lines.append("")
    keep(name, "\n".join(lines))


def keep(name: str, text: str) -> None:
    """Write a text that the page leaves out."""
    DETAILS.mkdir(parents=True, exist_ok=True)
    (DETAILS / f"{name}.md").write_text(text, encoding="utf-8")


def main() -> None:
    """Drive, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--real-time", action="store_true", help="also drive against boards on pseudo-terminals")
    parser.add_argument("--only", choices=ALONE, help="make this section alone anew")
    arguments = parser.parse_args()
    FIGURES.mkdir(exist_ok=True)
    if arguments.only is not None:
        renew(arguments.only, ALONE[arguments.only]())
        return
    pty = on_ptys() if arguments.real_time else {}
    sim = {name: run(load_profile(name), "sim", "seed=1") for name in NAMES}
    again = {name: run(load_profile(name), "sim, another seed", "seed=2") for name in DRIVES}
    serial = {name: run(load_profile(name), "serial, virtual", "seed=1", *SERIAL) for name in NAMES}
    empty = emptied()
    lock = run(LOCK, "lock", "seed=1")
    parts = [INTRODUCTION, beside_the_thesis(sim, empty, lock), picture("angular-steps", [sim["angular-steps"]])]
    for name in DRIVES:
        detailed(name, [sim[name]])
        detailed(f"{name}-serial", run_folder.alike([sim[name], serial[name], *([pty[name]] if name in pty else [])]))
    parts.append(battery_run(sim["battery-run"], serial["battery-run"], empty))
    parts.append(behind_the_wire(sim, [again, serial, pty], BEHIND_THE_WIRE))
    parts.append(f"## To a pose\n\n{POSES}\n{paragraph(f'{sentence(pose_trips())}.')}")
    parts.append(tunings())
    PAGE.write_text("\n".join(parts).rstrip() + "\n")


def renew(heading: str, text: str) -> None:
    """Put another text in place of the page's section of this heading."""
    before, _, rest = PAGE.read_text().partition(f"\n## {heading}\n")
    _, mark, after = rest.partition("\n## ")
    PAGE.write_text(f"{before}\n{text.rstrip()}\n{mark}{after}")


def emptied() -> Run:
    """The battery run until the packs cut off."""
    return run(load_profile("battery-run"), "stop disabled", "seed=1", safe_end=False)


def battery_run(sim: Run, serial: Run, empty: Run) -> str:
    """The section on the battery run."""
    whole, wired = sim._replace(label="stop at the safe end"), serial._replace(label="the same, serial, virtual")
    runs = [whole, wired, empty]
    detailed("battery-run", runs)
    ends = "\n".join(f"- {ending(each)}" for each in runs)
    return "\n".join([BATTERY, f"{ends}\n", picture("battery-run", runs)])


def battery_runs() -> str:
    """The same, driven again."""
    profile = load_profile("battery-run")
    return battery_run(run(profile, "sim", "seed=1"), run(profile, "serial, virtual", "seed=1", *SERIAL), emptied())


def tunings() -> str:
    """The section on tuning."""
    parts = [TUNING]
    for title, key, settings in (("The nominal vehicle", "nominal", ()), (WEAK_TITLE, "weak", WEAK)):
        parts.append(f"### {title}\n")
        parts += tuning(key, settings)
    return "\n".join(parts)


def configured(*settings: str) -> Config:
    """The configuration of every run here: no walls."""
    return load(None, [*ENDLESS, *settings], {}).config


def run(profile: Profile, label: str, *settings: str, safe_end: bool = True) -> Run:
    """A profile, driven and measured."""
    print(f"{profile.title}: {label}", file=sys.stderr)
    outcome, _ = drive(configured(*settings), profile, "max", safe_end=safe_end)
    assert outcome is not None
    return Run(label, profile, outcome.recording, measure(outcome, profile))


def on_ptys() -> dict[str, Run]:
    """The drives in real time, each against a board in another process, side by side: each takes 4 % of a processor."""
    print("in real time, on pseudo-terminals", file=sys.stderr)
    room = [word for setting in ENDLESS for word in ("--set", setting)]
    txt1 = [sys.executable, "-m", "txt1"]
    with tempfile.TemporaryDirectory() as folder, ExitStack() as ending_boards:
        for name in DRIVES:
            board = subprocess.Popen(  # noqa: S603
                [*txt1, "board", "--pty", f"{folder}/{name}-board", "--seed", "1", "--json", *room],
                stdout=subprocess.DEVNULL,
            )
            ending_boards.callback(board.wait)
            ending_boards.callback(board.terminate)
        while not all(Path(folder, f"{name}-board").exists() for name in DRIVES):
            time.sleep(0.1)
        hosts = [
            subprocess.Popen(  # noqa: S603
                [
                    *txt1,
                    "experiment",
                    name,
                    "--hal",
                    "serial",
                    "--port",
                    f"{folder}/{name}-board",
                    "--arm",
                    "--out",
                    f"{folder}/{name}",
                    "--no-figure",
                ],
                stdout=subprocess.DEVNULL,
            )
            for name in DRIVES
        ]
        assert [host.wait() for host in hosts] == [0] * len(hosts)
        return {name: run_folder.read(Path(folder, name))._replace(label="serial, pty, real time") for name in DRIVES}


def behind_the_wire(sim: dict[str, Run], others: Sequence[dict[str, Run]], introduction: str) -> str:
    """How far runs behind the wire lie apart from those in simulation, beside two simulations."""
    lines = ["| test | run | v: later by | rms, mm/s | ω: later by | rms, mrad/s | paths: rms |", "|---" * 7 + "|"]
    speeds: list[tuple[str, Deviation]] = []
    for name in DRIVES:
        for other in others:
            if name not in other:
                continue
            first, second = (
                each._replace(recording=each.recording.without_truth()) for each in (sim[name], other[name])
            )
            cells = []
            for channel in ("v", "omega"):
                each = difference(first.recording, second.recording, channel) if name != "waypoints" else None
                if each is not None:
                    speeds.append((second.label, each))
                cells += ["–"] * 2 if each is None else report.difference_cells(each)[1:3]
            apart, _ = paths_apart(first.recording, second.recording)
            path = "–" if name.endswith("steps") else f"{1000.0 * apart:.1f} mm"
            if not second.label.startswith("sim"):  # the sentence below tells of two simulations
                lines.append(f"| {' | '.join([name, second.label, *cells, path])} |")

    def most(channel: str, figure: str, simulated: bool) -> float:
        return max(
            1000.0 * float(getattr(each, figure))
            for label, each in speeds
            if each.channel == channel and label.startswith("sim") is simulated
        )

    told = " ".join(
        f"Behind the wire, {name} differ by {most(channel, 'rms', False):.1f} {unit} at most (rms; "
        f"{most(channel, 'largest', False):.0f} {unit} at a single sample). Two simulations differ by "
        f"{most(channel, 'rms', True):.1f} {unit} ({most(channel, 'largest', True):.0f} {unit}). A count is "
        f"{1000.0 * QUANTUM[channel]:.0f} {unit}."
        for channel, name, unit in (("v", "speeds", "mm/s"), ("omega", "yaw rates", "mrad/s"))
    )
    keep("behind-the-wire", "\n".join(lines))
    return "\n".join([introduction, paragraph(told)])


def pose_trips() -> list[Trip]:
    """Trips between random pose pairs in the thesis's room, by odometry."""
    print(f"{PAIRS} trips between random poses", file=sys.stderr)

    async def drive_them() -> list[Trip]:
        async with Robot.open("sim", seed=1, settings=("sim.battery.used_1=null",)) as robot:
            await robot.load_gains()
            return await trips(robot, PAIRS, Room(5.0, 5.0), seed=11)

    return run_loop(drive_them(), speed="max")


class Pair(NamedTuple):
    """The same drives with old and with new gains."""

    old: Run
    new: Run


def tuning(key: str, settings: Sequence[str]) -> list[str]:
    """What `txt1 tune` makes of a vehicle, and its gains on other seeds."""
    words = ["tune", "--seed", "1", "--repeats", str(REPEATS), *(w for each in settings for w in ("--set", each))]
    parts = [f"`txt1 {' '.join(words)}`\n"]
    with tempfile.TemporaryDirectory() as folder:
        gains = Path(folder, "gains.yaml")
        assert execute([*words, "--out", folder, "--write", str(gains)]) == 0
        keep(f"gains-{key}", gains.read_text())
        pairs = [Pair(*(run_folder.read(Path(folder, f"{test}-{which}")) for which in Pair._fields)) for test in TESTS]
        for test, pair in zip(TESTS, pairs, strict=True):
            keep(f"{test}-tuned-{key}", old_and_new(pair))
        if key == "nominal":
            drawn = f"{TESTS[0]}-tuned-{key}"
            figures.draw(pairs[0], FIGURES / f"{drawn}.png", "steps")
            parts.append(shown(drawn, SEEN["steps"]))
        parts.append(paragraph(gain(pairs)))
        seeds = range(OTHER_SEED, OTHER_SEED + REPEATS)
        others = [Pair(*(over(seeds, test, file, settings) for file in (None, gains))) for test in TESTS]
        told = f"On the seeds {seeds[0]} to {seeds[-1]}, which tuning did not use: {gain(others)}"
        parts.append(paragraph(told))
    return parts


def over(seeds: Sequence[int], test: str, gains: Path | None, settings: Sequence[str]) -> Run:
    """A test driven with some gains, None: the thesis's, once with every seed."""
    profile, outcomes = load_profile(test), []
    for seed in seeds:
        config = load(gains, [*ENDLESS, *settings, f"seed={seed}"], {}).config
        outcome, _ = drive(config, profile, "max")
        assert outcome is not None
        outcomes.append(outcome)
    return repeated(test, profile, outcomes)


def gain(pairs: Sequence[Pair]) -> str:
    """By how much the new gains are better, in words."""
    steps = [both for pair in pairs for both in zip(*(each.metrics["steps"] for each in pair), strict=True)]
    sooner = [old["settling"] - new["settling"] for old, new in steps]
    more, error = max(
        (
            (new["overshoot"] - old["overshoot"], hypot(new["overshoot_error"], old["overshoot_error"]))
            for old, new in steps
        ),
        key=lambda each: each[0] / each[1],
    )
    return (
        f"{sum(each > 0.0 for each in sooner)} of {len(steps)} steps settle sooner, by {min(sooner):.3f} to "
        f"{max(sooner):.2f} s; overshoot {100.0 * more:+.2f} ± {100.0 * error:.2f} %."
    )


def paragraph(text: str) -> str:
    """Text in lines."""
    return f"{textwrap.fill(text, 120)}\n"


def picture(name: str, runs: list[Run]) -> str:
    """Draw runs into a file, and the line that shows it."""
    figures.draw(runs, FIGURES / f"{name}.png")
    return shown(name, SEEN[runs[0].profile.figure])


def shown(name: str, seen: str) -> str:
    """The line that shows a figure, and says in words what is seen there."""
    return f"![{name}: {seen}](drive-tests/{name}.png)\n"


def ending(each: Run) -> str:
    """How a run ended, in a sentence."""
    told = each.metrics
    warned = told["battery_warning_s"]
    warning = "" if warned is None else f" The battery warning came after {warned / 60.0:.1f} min."
    return f"{each.label}: ended by {told['stopped_by']} after {told['duration_s'] / 60.0:.1f} min.{warning}"


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


def old_and_new(pair: Pair) -> str:
    """Settling time and overshoot of every step, old beside new."""
    lines = ["| step | settling: old | new | overshoot: old | new |", "|---|---|---|---|---|"]
    for old, new in zip(*(each.metrics["steps"] for each in pair), strict=True):
        lines.append(
            f"| {report.step_name(old)} | {old['settling']:.2f} s | {new['settling']:.2f} s "
            f"| {report.overshoot(old)} | {report.overshoot(new)} |"
        )
    return "\n".join(lines) + "\n"


DRIVES = ("linear-steps", "angular-steps", "circle-slow", "circle-fast", "waypoints")
NAMES = (*DRIVES, "battery-run")
WEAK_TITLE = "30 % less motor gain, and twice the lag of motors and servos"

INTRODUCTION = f"""\
# The drive tests

Three tests of the thesis, in simulation and with the thesis's gains: the controllers (4.4), the path along waypoints,
and the battery run (3.6.3). `python -m docs.drive_tests --real-time` drives them, and writes this page and its figures;
each step, leg and gain goes to out/drive-tests ({date.today()}). `txt1 experiment NAME --seed 1` repeats a single test.

Responses are means over 0.2 s of the simulator's true motion. A response has settled when it stays within 5 % of the
step around its end value.
"""

DIFFERENCES = """\
Four results differ from the thesis:

- The encoders sit on the steered front wheels. In a curve they read 1 / cos φ of the speed and cos φ of the yaw rate,
  so the true circle is smaller than v / ω. The thesis draws its circles from odometry, which hides this.
- The thesis's robot lost traction in the faster steps. Here the tyres hold, but for a moment of the stop from 1 m/s; on
  a board as the originals the wheels spin by up to 0.95 m/s ([Stops](stops.md)).
- This floor is even, except for 3 % of drag, so laps lie closer together than on tile.
- The safe end comes early: the robot reads its voltage with 10 mV of noise.
"""

BATTERY = """\
## battery-run

The robot stops by itself when its voltage says that no time is left (`--no-safe-end` switches this off). The full load
drains the packs whenever the motors turn, as in the thesis. [Energy](energy.md#the-battery-run-with-it) has the run
with a consumption by speed.
"""

BEHIND_THE_WIRE = """\
## Behind the wire

`--hal serial` beside the simulation, by the encoders of both. The board runs in virtual time (`--port virtual`), or as
a process on a pseudo-terminal in real time. Set-points and readings wait for the next message, so responses come up to
70 ms later; each is compared after it is moved by its delay. The path is late by this delay, too.
"""

POSES = f"""\
`go_to` drives from {PAIRS} random poses to {PAIRS} random goals, all at least 0.6 m from the walls of the 5 x 5 m room,
by odometry. `POSE_PAIRS={PAIRS} pytest tests/e2e/test_navigation.py -k anywhere -s` repeats it:
"""

TUNING = f"""\
## Tuning

[`txt1 tune`](../calibrate.md) identifies the vehicle from its encoders and chooses gains. Old and new gains then drive
both step tests, {REPEATS} seeds each. Overshoot: the largest addition, by its standard errors,
and ± one of these, in % of the step.
"""

ALONE: Final = {"battery-run": battery_runs, "Tuning": tunings}  # sections that need nothing of the others


if __name__ == "__main__":
    main()
