"""How good the estimate is: ten laps of the waypoints' rectangle with slip and understeer, a circle, and a step's cost.

    python -m benchmarks.estimation laps --seeds 8 --exact --figure docs/estimation/ten-laps.png
    python -m benchmarks.estimation circle --seeds 10
    python -m benchmarks.estimation step
    python -m benchmarks.estimation drives --folder FOLDER
    python -m benchmarks.estimation draw --folder FOLDER --seeds 10
    python -m benchmarks.estimation random --seeds 50 --vehicle rover
    python -m benchmarks.estimation failures --seeds 3
    python -m benchmarks.estimation wrong --seeds 10
    python -m benchmarks.estimation skid --folder FOLDER
    python -m benchmarks.estimation slow --folder FOLDER

Of laps, random, failures and wrong the filter is told a geometry that a person has measured wrongly
(`benchmarks.mistakes`), or the true one with --exact. A seed's laps are driven once, steered by the true pose, with all
sensors; the filters of the set-ups listen beside one another, each the very one that a robot runs.
"""

import argparse
import asyncio
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from math import hypot, inf, pi
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time_ns
from typing import Any, Final

import numpy as np

from benchmarks import (
    drawn_drives,
    drives,
    failing_sensors,
    mistakes,
    others_logs,
    random_drives,
    seeds,
    wrong_settings,
)
from benchmarks.mistakes import Mistakes
from txt1.errors import ConfigError
from txt1.estimation.settings import EstimationConfig
from txt1.estimation.task import ENCODERS, ESTIMATION_PERIOD, PRIORITY, Estimator
from txt1.estimation.task import wheels as wheels_of
from txt1.experiments.figures import LOOKS
from txt1.kernel.clock import NS_PER_S
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import wrap_angle
from txt1.navigation import follow, true_pose
from txt1.robot import Robot
from txt1.sensors.readings import FixReading, ImuReading, TrackerReading

ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf", "sim.battery.used_1=null")
SLIPPING: Final = (*ENDLESS, "sim.vehicle.slip=0.05", "sim.vehicle.understeer=0.1")
RECTANGLE: Final = [(-1.5, -2.0), (-1.5, 2.0), (1.5, 2.0), (1.5, -2.0)]
SENSORS: Final = (
    "sensors.imu.driver=sim_imu",
    "sensors.vicon.driver=sim_vicon",
    "sensors.gps.driver=sim_gps",
    "sensors.gps.options={slow: 0.0}",
    "sensors.slow.driver=sim_gps",
    "sensors.vicon.options={angle_noise: 0.002}",
)
SETUPS: Final[dict[str, tuple[str, ...]]] = {
    "encoders, filtered": (ENCODERS,),
    "+ gyro": (ENCODERS, "imu"),
    "+ gyro + GPS, 1 m white": (ENCODERS, "imu", "gps"),
    "+ gyro + GPS, slow errors of 1 m besides": (ENCODERS, "imu", "slow"),
    "+ gyro + Vicon": (ENCODERS, "imu", "vicon"),
}
KINDS: Final[dict[str, type]] = {"imu": ImuReading, "gps": FixReading, "slow": FixReading, "vicon": TrackerReading}
RAW: Final = "encoders"
# of the drive on which a step is timed: what a busy machine adds differs from run to run
RUNS: Final = 8
SETTLED: Final = 30.0  # s from the first pose on, which several positions of 1 m have told


@dataclass
class Errors:
    """A set-up's errors in one run."""

    rows: list[tuple[float, float, float]] = field(default_factory=list)  # time s, position m, heading rad

    def add(self, now: float, pose: Sequence[float], true: Sequence[float]) -> None:
        """Note an error."""
        self.rows.append((now, hypot(pose[0] - true[0], pose[1] - true[1]), abs(wrap_angle(pose[2] - true[2]))))

    def result(self) -> dict[str, float]:
        """Root mean squares, final and largest values, the latter also from `SETTLED` after the first estimate on."""
        time, position, heading = np.array(self.rows).T
        return {
            "rms_m": float(np.sqrt(np.mean(position**2))),
            "final_m": float(position[-1]),
            "largest_m": float(position.max()),
            "settled_m": float(position[time > time[0] + SETTLED].max()),
            "rms_rad": float(np.sqrt(np.mean(heading**2))),
            "final_rad": float(heading[-1]),
        }


async def laps(seed: int, count: float, *, exact: bool) -> dict[str, Errors]:
    """The errors of all set-ups on laps of the rectangle."""
    found = {RAW: Errors(), **{name: Errors() for name in SETUPS}}
    async with Robot.open("sim", seed=seed, settings=(*SLIPPING, *SENSORS)) as robot:
        await robot.load_gains()
        mistaken = {name: mistakes.of(names, seed, exact=exact) for name, names in SETUPS.items()}
        estimators = {
            name: Estimator(
                mistakes.told(names, mistaken[name]),
                {each: KINDS[each] for each in names if each in KINDS},
                (mistaken[name] or Mistakes()).geometry(robot.config.geometry),
            )
            for name, names in SETUPS.items()
        }
        for estimator in estimators.values():
            for name in estimator.settings:
                if name != ENCODERS:
                    robot.sensors[name].listeners.append(partial(estimator.take, name))

        async def measure(ticks: Ticks) -> None:
            async for now in ticks:
                true, wheels = robot.pose, wheels_of(robot.runtime)
                assert true is not None
                for name, estimator in estimators.items():
                    estimate = estimator.step(now, (mistaken[name] or Mistakes()).wheels(wheels))
                    if estimate.located:
                        found[name].add(now, estimate, true)
                found[RAW].add(now, wheels.odometry, true)

        robot.add_task("measure", ESTIMATION_PERIOD, measure, PRIORITY)
        await follow(robot, RECTANGLE, laps=count, pose_source=true_pose(robot))
    return found


def tabulated(results: list[dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    """The root mean square over seeds of every number, by set-up."""
    return {
        name: {key: float(np.sqrt(np.mean([result[name][key] ** 2 for result in results]))) for key in results[0][name]}
        | {key: max(result[name][key] for result in results) for key in ("largest_m", "settled_m")}
        for name in results[0]
    }


def show_laps(
    cases: Sequence[str], count: float, kept: Path, minutes: float, file: Path | None, *, exact: bool
) -> None:
    """Drive, print and draw."""

    def case(seed: str) -> dict[str, dict[str, float]]:
        return {name: errors.result() for name, errors in run(laps(int(seed), count, exact=exact), speed="max").items()}

    results = seeds.results(kept, cases, case, minutes)
    table = tabulated(list(results.values()))
    print(f"{count:g} laps, {len(results)} seeds: root mean square over seeds of")
    print(
        "| set-up | rms position m | final position m | largest, of all seeds m "
        f"| largest from {SETTLED:g} s after the first pose on m | rms heading deg | final heading deg |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, row in table.items():
        print(
            f"| {name} | {row['rms_m']:.4f} | {row['final_m']:.4f} | {row['largest_m']:.4f} "
            f"| {row['settled_m']:.4f} | {row['rms_rad'] * 180 / pi:.3f} | {row['final_rad'] * 180 / pi:.3f} |"
        )
    if file is not None:
        draw(run(laps(int(cases[0]), count, exact=exact), speed="max"), file, count)


def draw(found: dict[str, Errors], file: Path, count: float) -> None:
    """The errors of one seed over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for (name, errors), look in zip(found.items(), LOOKS, strict=False):
        time, position, heading = np.array(errors.rows)[::10].T
        above.semilogy(time, np.maximum(position, 1e-4), linewidth=0.9, label=name, **look)
        below.semilogy(time, np.maximum(heading, 1e-5) * 180.0 / pi, linewidth=0.9, **look)
    above.set(ylabel="position error, m", title=f"{count:g} laps with 5 % slip and 0.1 s²/m² of understeer, seed 1")
    below.set(ylabel="heading error, degrees", xlabel="time, s")
    for axes in (above, below):
        axes.grid(alpha=0.3, which="both")
    figure.legend(loc="outside lower center", ncols=2, fontsize="x-small")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)


async def circle(seed: int, settings: Sequence[str]) -> float:
    """The true radius of a circle that was asked to be 1 m, by the least squares of its last two laps."""
    async with Robot.open("sim", seed=seed, settings=(*ENDLESS, *settings)) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.5, 5.0)
        places = []
        for _ in range(502):
            robot.program.insist(0.5, 0.5)
            await asyncio.sleep(0.05)
            assert robot.pose is not None
            places.append(robot.pose[:2])
    x, y = np.array(places).T
    a, b, c = np.linalg.lstsq(np.stack((2 * x, 2 * y, np.ones_like(x)), 1), x**2 + y**2, rcond=None)[0]
    return float(np.sqrt(c + a * a + b * b))


def show_circle(count: int) -> None:
    """Print the radius with the loops by the encoders and by the fused velocities."""
    slips: dict[str, tuple[str, ...]] = {
        "no slip": (),
        "5 % slip, 0.1 understeer": ("sim.vehicle.slip=0.05", "sim.vehicle.understeer=0.1"),
    }
    for slip, settings in slips.items():
        for name, given in {
            "encoders": (),
            "gyro": ("estimation.preset=gyro", "estimation.loops=true"),
            "vicon": ("estimation.preset=vicon", "estimation.loops=true"),
        }.items():
            radii = [run(circle(seed, (*settings, *given)), speed="max") for seed in range(1, count + 1)]
            print(f"{slip}, loops by {name}: radius {np.mean(radii):.4f} m ({min(radii):.4f} to {max(radii):.4f})")


async def cost(delay: float) -> list[float]:
    """Microseconds of processor time of every step of a filter with four sensors at their rates, Vicon's so late.

    The clock's own time is taken off: it is asked some five times in a step, for each reading and the step itself.
    """
    own = clock()
    names = (ENCODERS, "imu", "gps", "vicon")
    taken: list[float] = []
    settings = (*SLIPPING, *SENSORS, f"sensors.vicon.delay={delay}")
    async with Robot.open("sim", seed=1, settings=settings) as robot:
        await robot.load_gains()
        kinds = {each: KINDS[each] for each in names if each in KINDS}
        estimator = Estimator(EstimationConfig(sensors=names), kinds, robot.config.geometry)
        spent = 0

        def take(name: str, reading: Any) -> None:
            nonlocal spent
            began = process_time_ns()
            estimator.take(name, reading)
            spent += process_time_ns() - began - own

        for name in kinds:
            robot.sensors[name].listeners.append(partial(take, name))

        async def step(ticks: Ticks) -> None:
            nonlocal spent
            async for now in ticks:
                wheels = wheels_of(robot.runtime)
                began = process_time_ns()
                estimator.step(now, wheels)
                taken.append((spent + process_time_ns() - began - own) / NS_PER_S * 1e6)
                spent = 0

        robot.add_task("step", ESTIMATION_PERIOD, step, PRIORITY)
        await robot.drive(0.5, 0.3, 30.0)
    return taken[100:]


def clock() -> int:
    """The least time in ns that the clock of the processor's time takes itself."""
    return min(-process_time_ns() + process_time_ns() for _ in range(1000))


def yardstick() -> float:
    """Microseconds of processor time of a prediction and an update of seven states with numpy, as in a textbook."""
    one, p, h = np.eye(7), np.eye(7), np.eye(7)[:3]
    f, r = one + 0.02 * np.eye(7, k=1), np.eye(3)
    times = []
    for _ in range(200):
        began = process_time_ns()
        prior = f @ p @ f.T + one
        gain = np.linalg.solve(h @ prior @ h.T + r, h @ prior).T
        p = prior - gain @ h @ prior
        times.append(process_time_ns() - began)
    return min(times) / NS_PER_S * 1e6


def show_step(runs: int) -> None:
    """Print the cost of a step: the same drive so many times, with the least time of each step, and all of them."""
    print(f"a step with encoders, IMU 100 Hz, GPS 5 Hz, Vicon 100 Hz, the same drive {runs} times, us:")
    for delay in (0.0, 0.01, 0.02, 0.05):
        measured = [(yardstick(), run(cost(delay), speed="max")) for _ in range(runs)]
        yard = min(each for each, _ in measured)
        taken = np.array([each for _, each in measured])
        least = float(np.median(taken.min(0)))
        p10, p50, p99 = np.percentile(taken, (10, 50, 99))
        print(
            f"Vicon {delay * 1000:g} ms late: of each step's least time {least:.0f} p50, "
            f"{least / yard:.1f} yardsticks of {yard:.1f}; "
            f"of all times {p10:.0f} p10, {p50:.0f} p50, {taken.mean():.0f} mean, {p99:.0f} p99"
        )


def show_random(vehicle: str, numbers: Sequence[int], seconds: float, *, exact: bool) -> None:
    """Print how far off the set-ups are on drives as a person makes them, and on two from rest."""

    def show(results: list[dict[str, dict[str, float]]]) -> None:
        print(f"{vehicle}, {len(results)} drives of {seconds:g} s, by the last three quarters of each:\n")
        print(random_drives.table(results))

    seeds.each(numbers, "driving", lambda number: random_drives.random(vehicle, number, seconds, exact=exact), show)
    if vehicle == "txt1":
        print("\n1 m/s and 1 rad/s from rest, 10 s:\n")
        print(random_drives.table([random_drives.from_rest(1)]))


def main(*, quick: bool) -> None:
    """Print the cost of a step, and a short drive's errors."""
    show_step(3 if quick else RUNS)
    with TemporaryDirectory() as folder:
        show_laps(
            ["1"] if quick else ["1", "2", "3"],
            1.0 if quick else 3.0,
            Path(folder) / "laps.jsonl",
            inf,
            None,
            exact=True,
        )


def command() -> None:
    """Do what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "what", choices=("laps", "circle", "step", "drives", "draw", "random", "failures", "wrong", "skid", "slow")
    )
    parser.add_argument("--laps", type=float, default=10.0)
    parser.add_argument("--runs", type=int, default=RUNS, help="of step's drive; default: %(default)s")
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--vehicle", default="txt1", help="of random drives; default: %(default)s")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each; default: %(default)s")
    parser.add_argument("--exact", action="store_true", help="the filter is told the true geometry, and that it is")
    parser.add_argument("--folder", type=Path, help="of recorded or drawn drives, *.npz")
    seeds.arguments(parser, "out/laps.jsonl", 100)
    given = parser.parse_args()
    for name in ("seeds", "runs"):
        if getattr(given, name) < 1:
            parser.error(f"--{name} is {getattr(given, name)}; give 1 or more")
    try:
        measure(parser, given)
    except ConfigError as error:
        parser.error(str(error))


def measure(parser: argparse.ArgumentParser, given: argparse.Namespace) -> None:
    """Measure what was asked for; raises ConfigError: there is no such vehicle."""
    if given.what == "laps":
        wanted = [str(seed) for seed in range(given.first, given.first + given.seeds)]
        show_laps(wanted, given.laps, given.kept, given.minutes, given.figure, exact=given.exact)
    elif given.what == "circle":
        show_circle(given.seeds)
    elif given.what == "random":
        show_random(given.vehicle, range(given.first, given.first + given.seeds), given.seconds, exact=given.exact)
    elif given.what == "failures":
        failing_sensors.show(range(given.first, given.first + given.seeds), exact=given.exact)
    elif given.what == "wrong":
        wrong_settings.show(range(given.first, given.first + given.seeds), exact=given.exact)
    elif given.what == "draw":
        if given.folder is None:
            parser.error("draw needs --folder, where the drives are written")
        drawn_drives.write(given.folder, range(given.first, given.first + given.seeds))
    elif given.what == "drives":
        if given.folder is None or not given.folder.is_dir():
            parser.error("drives needs --folder, which holds the recorded drives")
        if not any(given.folder.glob("*.npz")):
            parser.error(f"--folder {given.folder} holds no drives, *.npz; draw makes some")
        drives.show(given.folder)
    elif given.what in ("skid", "slow"):
        if given.folder is None or not given.folder.is_dir():
            parser.error(f"{given.what} needs --folder, which holds the logs")
        show = others_logs.show_skid if given.what == "skid" else others_logs.show_slow
        show(given.folder)
    else:
        show_step(given.runs)


if __name__ == "__main__":
    try:
        command()
    except KeyboardInterrupt:
        sys.exit(130)
