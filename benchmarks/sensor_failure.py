"""Lets sensors fail in turn on a course, and measures the estimate's error and the time to detection (thesis 3.4.3).

python -m benchmarks.sensor_failure                    # out/sensor-failure: table.md, metrics.json, figure.svg
python -m benchmarks.sensor_failure --set seed=2 --out FOLDER
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config, load
from txt1.config.schema import SensorConfig
from txt1.errors import NotArmed
from txt1.estimation.sensors import Measurement
from txt1.estimation.settings import EstimationConfig
from txt1.estimation.task import ENCODERS, Estimator
from txt1.experiments.figures import LOOKS
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import wrap_angle
from txt1.navigation import follow, true_pose
from txt1.robot import Robot
from txt1.trials.run import run as each_in_processes
from txt1.trials.workers import Workers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# presets of which each sensor fails
SETUPS: Final = ("imu-gps", "vicon")
FAILURES: Final = ("sound", "frozen", "silent", "jumping", "drifting", "not a number", "late by 0.3 s")
COURSE: Final = [(-1.5, -2.0), (-1.5, 2.0), (1.5, 2.0), (1.5, -2.0)]  # m
LAPS: Final = 2.5
# s of the run at which the failure begins
BEGIN: Final = 30.0
# s of the run at which it ends
END: Final = 45.0
LATE: Final = 0.3  # s
# jumps in m/s, rad/s, m, m
JUMPS: Final = {ENCODERS: (0.3, 0.0), "imu": (0.5,), "gps": (20.0, 0.0), "vicon": (0.5, 0.0, 0.0)}
DRIFTS: Final = {ENCODERS: (0.05, 0.0), "imu": (0.05,), "gps": (2.0, 0.0), "vicon": (0.05, 0.0, 0.0)}
"""Drifts in the same units, per second."""
# the GPS's errors are white here: a slow error is no failure
SETTINGS: Final[dict[str, Any]] = {"slow": 0.0}

Array = NDArray[np.float64]
# setup, sensor, failure
Which = tuple[str, str, str]


class Failing:
    """A sensor that fails from `BEGIN` to `END`; it is put between the sensors and the filter."""

    def __init__(self, sensor: str, failure: str, now: Callable[[], float]) -> None:
        self._sensor, self._failure, self._now = sensor, failure, now
        self._held: tuple[float, ...] = ()
        self._under_way: deque[Measurement] = deque()

    def __call__(self, measurement: Measurement) -> Iterable[Measurement]:
        """Take a measurement; yield the measurements that come through."""
        if measurement.sensor != self._sensor:
            return (measurement,)
        now = self._now()
        if self._failure == "late by 0.3 s":
            if BEGIN <= now < END:
                self._under_way.append(measurement)
                measurements = []
            else:
                measurements = [*self._under_way, measurement]
                self._under_way.clear()
            while self._under_way and self._under_way[0].time + LATE <= now:
                measurements.append(self._under_way.popleft())
            return measurements
        if not BEGIN <= now < END:
            self._held = measurement.values
            return (measurement,)
        return self._failed(measurement, now)

    def _failed(self, measurement: Measurement, now: float) -> Iterable[Measurement]:
        values = measurement.values
        match self._failure:
            case "silent":
                return ()
            case "frozen":
                values = self._held
            case "jumping":
                # forth and back, twice a second
                if int(2.0 * now) % 2:
                    values = added(values, JUMPS[self._sensor], 1.0)
            case "drifting":
                values = added(values, DRIFTS[self._sensor], now - BEGIN)
            case "not a number":
                values = (nan,) * len(values)
        return (measurement._replace(values=values),)


def added(values: tuple[float, ...], more: tuple[float, ...], times: float) -> tuple[float, ...]:
    """Return the values plus `times` the others."""
    return tuple(value + times * other for value, other in zip(values, more, strict=True))


class FailureOutcome(NamedTuple):
    """A run with a failing sensor."""

    setup: str
    sensor: str
    failure: str
    # largest distance of the fused pose from the true pose since the failure, m
    error: float
    # largest error of the heading, rad
    heading: float
    # largest error of x, y or theta, as a share of three of its standard deviations at that time
    share: float
    # s until the sensor was no longer used; infinite: it was used all the time
    detection: float
    # s from the end of the failure until it was used again; infinite: it was not
    recovery: float
    # reason for which the gate was closed; empty while it stayed open
    disarmed: str
    # time (s), distance (m), three times its standard deviation (m), shape (samples, 3)
    trace: Array

    def row(self) -> dict[str, object]:
        """Return the outcome's row of the table, by column."""
        found = self._asdict()
        del found["trace"]
        return {key: None if value == inf else value for key, value in found.items()}


def outcome_of(tree: dict[str, Any]) -> FailureOutcome:
    """Return an outcome from its fields in JSON."""
    return FailureOutcome(**tree | {"trace": np.array(tree["trace"])})


def config_for(config: Config, setup: str) -> Config:
    """Return the configuration with a setup's sensors fused and the loops closed over them, in an endless room."""
    estimation = config.section(EstimationConfig).model_copy(update={"preset": setup, "sensors": None, "loops": True})
    room = config.sim.room.model_copy(update={"length": inf, "width": inf})
    sim = config.sim.model_copy(update={"room": room})
    sensors = dict(config.sensors)
    if setup == "imu-gps" and "gps" not in sensors:
        sensors["gps"] = SensorConfig(driver="sim_gps", options=SETTINGS)
    return config.model_copy(update={"estimation": estimation, "sim": sim, "sensors": sensors})


async def drive(config: Config, setup: str, sensor: str, failure: str) -> FailureOutcome:
    """Drive the course with a failing sensor: steered by the true pose, with the fused odometry in the velocity
    loops.
    """
    rows: list[tuple[float, ...]] = []
    lost, again, disarmed = inf, inf, ""
    async with Robot.open(config=config_for(config, setup), arm=True) as robot:
        estimator = robot.runtime.part(Estimator)
        assert estimator is not None
        estimator.through = Failing(sensor, failure, lambda: robot.now)
        await robot.load_gains()

        async def measure(ticks: Ticks) -> None:
            nonlocal lost, again, disarmed
            async for now in ticks:
                estimate, pose = robot.estimate, robot.pose
                if estimate is None or pose is None or now < BEGIN:
                    continue
                ex, ey = estimate.x - pose[0], estimate.y - pose[1]
                et = wrap_angle(estimate.theta - pose[2])
                sx, sy, st = (max(estimate.sigma(place), 1e-9) for place in range(3))
                band = 3.0 * float(np.hypot(sx, sy))
                share = max(abs(ex) / sx, abs(ey) / sy, abs(et) / st) / 3.0
                rows.append((now, float(np.hypot(ex, ey)), abs(et), share, band))
                believed = next(trust.believed for trust in estimator.trusts() if trust.name == sensor)
                if not believed:
                    lost, again = min(lost, now), inf
                elif lost < inf and again == inf:
                    again = now
                if not robot.armed and not disarmed:
                    disarmed = robot.reason

        robot.add_task("measure", 0.02, measure, -2)
        with suppress(NotArmed):
            await follow(robot, COURSE, laps=LAPS, pose_source=true_pose(robot))
        disarmed = "" if robot.armed else disarmed or robot.reason
    time, distance, heading, share, band = np.array(rows).T
    return FailureOutcome(
        setup,
        sensor,
        failure,
        float(distance.max()),
        float(heading.max()),
        float(share.max()),
        lost - BEGIN,
        max(again - END, 0.0) if again < inf else inf if lost < inf else 0.0,
        disarmed,
        np.stack((time, distance, band), axis=1),
    )


def plan(config: Config) -> list[Which]:
    """Return setup, sensor and failure of every run."""
    return [
        (setup, sensor, failure)
        for setup in SETUPS
        for sensor in config_for(config, setup).section(EstimationConfig).names
        for failure in FAILURES
        if failure != "sound" or sensor == ENCODERS
    ]


def table(outcomes: Iterable[FailureOutcome]) -> str:
    """Return the outcomes as a table in Markdown."""
    lines = [
        "| set-up | sensor | failure | largest error m | heading deg | of 3 sigma | detected after s "
        "| believed again after s | disarmed |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for each in outcomes:
        sound = each.failure == "sound"
        detected = "-" if each.detection == inf else f"{each.detection:.2f}"
        again = "-" if each.detection == inf else "never" if each.recovery == inf else f"{each.recovery:.2f}"
        lines.append(
            f"| {each.setup} | {'all' if sound else each.sensor} | {each.failure} | {each.error:.4f} "
            f"| {np.degrees(each.heading):.2f} | {each.share:.2f} | {detected} | {again} | {each.disarmed or 'no'} |"
        )
    return "\n".join(lines)


def write(outcomes: list[FailureOutcome], folder: Path) -> None:
    """Write the table, as Markdown and as JSON."""
    (folder / "table.md").write_text(table(outcomes) + "\n")
    (folder / "metrics.json").write_text(json.dumps([each.row() for each in outcomes], indent=1) + "\n")


def largest(trace: Array) -> Array:
    """Return the largest values of a trace in each second: 50 values a second would be a black band."""
    seconds = np.floor(trace[:, 0])
    return np.array([[second, *trace[seconds == second, 1:].max(axis=0)] for second in np.unique(seconds)])


def draw(outcomes: list[FailureOutcome], file: Path) -> None:
    """Draw the errors of all runs over time, a panel for each sensor of a setup, with the band of the intact run."""
    from matplotlib.figure import Figure

    panels = list(dict.fromkeys((each.setup, each.sensor) for each in outcomes))
    figure: Figure = Figure(figsize=(8.0, 5.6), dpi=150, layout="constrained")
    axes = figure.subplots(2, -(-len(panels) // 2), squeeze=False, sharey="row")
    sound = {each.setup: each for each in outcomes if each.failure == "sound"}
    for panel, (setup, sensor) in zip(axes.flat, panels, strict=False):
        time, _, band = largest(sound[setup].trace).T
        panel.semilogy(time, band, "k--", linewidth=0.8, label="3 sigma, all sound")
        for look, failure in zip(LOOKS, FAILURES, strict=True):
            for each in outcomes:
                shown = (each.setup, each.sensor) == (setup, sensor) or (failure == "sound" and each.setup == setup)
                if shown and each.failure == failure:
                    panel.semilogy(*largest(each.trace).T[:2], linewidth=1.1, label=failure, **look)
        panel.axvspan(BEGIN, END, color="0.9")
        panel.set(title=f"{setup}: {sensor} fails", xlabel="time, s")
        panel.grid(alpha=0.3)
    for panel, setup in zip(axes[:, 0], SETUPS, strict=False):
        panel.set(ylabel="largest error in 1 s, m", ylim=(1e-3 if setup == "imu-gps" else 1e-4, None))
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small")
    figure.savefig(file)


def driven(told: list[Any]) -> dict[str, Any]:
    """Drive a run with a failing sensor, and return its outcome; JSON values both."""
    config, *which = told
    outcome = run(drive(Config.model_validate(config), *which), speed="max")
    return outcome._asdict() | {"trace": outcome.trace.tolist()}


def main(words: list[str]) -> int:
    """Let every sensor fail in every way, in simulation, and write the table and the figure; return the exit code."""
    parser = argparse.ArgumentParser(prog="benchmarks.sensor_failure", description=__doc__.partition("\n")[0])
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the robot's configuration")
    parser.add_argument("--out", type=Path, default=Path("out/sensor-failure"), help="folder for the results")
    parser.add_argument("--figure", type=Path, help="file of the figure; figure.svg in the folder")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    options = parser.parse_args(words)
    config = load(None, options.set, {}, {}).config
    told, found = config.model_dump(mode="json"), dict[Which, FailureOutcome]()
    runs = {which: [told, *which] for which in plan(config)}
    code = each_in_processes(
        driven, runs, Workers(options.jobs), lambda which, tree: found.update({which: outcome_of(tree)})
    )
    if code:
        return code
    options.out.mkdir(parents=True, exist_ok=True)
    outcomes = [found[which] for which in runs]
    write(outcomes, options.out)
    draw(outcomes, options.figure or options.out / "figure.svg")
    print(table(outcomes))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
