"""Sensors that fail on drives as a person makes them: how far off the filter is, and what it says of itself."""

from collections.abc import Sequence
from functools import partial
from math import hypot, inf, pi
from typing import Final, NamedTuple

import numpy as np

from benchmarks import mistakes, seeds
from benchmarks.drives import KINDS
from benchmarks.mistakes import Mistakes
from benchmarks.random_drives import SETTINGS
from benchmarks.sensor_failure import BEGIN, END, FAILURES, SETUPS, Failing
from rigs.human_drive import drive_as_a_person
from txt1.config import load
from txt1.estimation.settings import PRESETS
from txt1.estimation.task import ENCODERS, ESTIMATION_PERIOD, PRIORITY, Estimator
from txt1.estimation.task import wheels as wheels_of
from txt1.kernel.loop import run
from txt1.kernel.ticks import Ticks
from txt1.model.kinematics import wrap_angle
from txt1.robot import Robot

SECONDS: Final = 60.0
SOUND: Final = FAILURES[0]
BEFORE: Final[dict[tuple[str, str, str], tuple[float, float, float]]] = {
    ("imu-gps", "imu", "frozen"): (0.1662, 3.63, 0.54),
    ("imu-gps", "imu", "silent"): (0.1642, 3.57, 0.53),
    ("imu-gps", "imu", "jumping"): (0.1594, 3.34, 0.53),
    ("imu-gps", "imu", "drifting"): (0.1588, 3.72, 0.51),
    ("imu-gps", "imu", "not a number"): (0.1684, 3.73, 0.54),
    ("imu-gps", "imu", "late by 0.3 s"): (0.1484, 2.13, 0.48),
    ("imu-gps", "encoders", "sound"): (0.1493, 2.12, 0.49),
    ("imu-gps", "encoders", "frozen"): (1.1260, 2.36, 0.80),
    ("imu-gps", "encoders", "silent"): (1.1260, 2.35, 0.80),
    ("imu-gps", "encoders", "jumping"): (1.0530, 10.85, 0.80),
    ("imu-gps", "encoders", "drifting"): (2.3037, 5.21, 3.04),
    ("imu-gps", "encoders", "not a number"): (1.1260, 2.35, 0.80),
    ("imu-gps", "encoders", "late by 0.3 s"): (0.1494, 2.13, 0.50),
    ("imu-gps", "gps", "frozen"): (0.2754, 3.51, 0.47),
    ("imu-gps", "gps", "silent"): (0.1514, 2.26, 0.48),
    ("imu-gps", "gps", "jumping"): (0.1540, 2.18, 0.51),
    ("imu-gps", "gps", "drifting"): (0.3491, 5.53, 0.77),
    ("imu-gps", "gps", "not a number"): (0.1514, 2.26, 0.48),
    ("imu-gps", "gps", "late by 0.3 s"): (0.1516, 2.22, 0.49),
    ("vicon", "imu", "frozen"): (0.0010, 0.14, 0.64),
    ("vicon", "imu", "silent"): (0.0010, 0.14, 0.64),
    ("vicon", "imu", "jumping"): (0.0010, 0.17, 0.78),
    ("vicon", "imu", "drifting"): (0.0009, 0.21, 0.73),
    ("vicon", "imu", "not a number"): (0.0010, 0.14, 0.62),
    ("vicon", "imu", "late by 0.3 s"): (0.0010, 0.15, 0.69),
    ("vicon", "encoders", "sound"): (0.0009, 0.08, 0.68),
    ("vicon", "encoders", "frozen"): (0.0018, 0.10, 0.69),
    ("vicon", "encoders", "silent"): (0.0018, 0.08, 0.69),
    ("vicon", "encoders", "jumping"): (0.0018, 0.20, 0.56),
    ("vicon", "encoders", "drifting"): (0.0066, 0.14, 0.64),
    ("vicon", "encoders", "not a number"): (0.0018, 0.08, 0.69),
    ("vicon", "encoders", "late by 0.3 s"): (0.0018, 0.08, 0.69),
    ("vicon", "vicon", "frozen"): (0.0050, 0.11, 0.61),
    ("vicon", "vicon", "silent"): (0.0048, 0.12, 0.60),
    ("vicon", "vicon", "jumping"): (0.0049, 0.11, 0.60),
    ("vicon", "vicon", "drifting"): (0.0788, 0.20, 0.88),
    ("vicon", "vicon", "not a number"): (0.0052, 0.11, 0.60),
    ("vicon", "vicon", "late by 0.3 s"): (0.0010, 0.12, 0.60),
}
"""Largest error (m), heading (degrees) and share of 3 sigma of version 0.2.0, on the rehearsed course."""


class Found(NamedTuple):
    """A set-up with a failing sensor, from the failure on."""

    error: float  # m, the largest
    heading: float  # degrees, the largest
    share: float  # the largest error of x, y or theta, of three of its sigma
    beyond: float  # s, the longest time for which one of them was larger than three of its sigma
    nees: float  # the mean
    detected: float  # s until the sensor was left out; infinite: never
    again: float  # s from the end of the failure until it was believed; infinite: never


class _Watch:
    def __init__(self, name: str, sensor: str, failure: str, robot: Robot, made: Mistakes | None) -> None:
        kinds = {each: KINDS[each] for each in PRESETS[name] if each in KINDS}
        self._mistakes = made or Mistakes()
        geometry = self._mistakes.geometry(robot.config.geometry)
        self._estimator = Estimator(mistakes.told(PRESETS[name], made), kinds, geometry)
        if failure != SOUND:
            self._estimator.through = Failing(sensor, failure, lambda: robot.now)
        for each in kinds:
            robot.sensors[each].listeners.append(partial(self._estimator.take, each))
        self._sensor, self._robot = sensor, robot
        self._most = np.zeros(3)
        self._beyond, self._longest = 0.0, 0.0
        self._nees: list[float] = []
        self._lost, self._again = inf, inf

    def step(self, now: float) -> None:
        wheels = self._mistakes.wheels(wheels_of(self._robot.runtime))
        true, estimate = self._robot.pose, self._estimator.step(now, wheels)
        assert true is not None
        if now < BEGIN:
            return
        error = np.array([estimate.x - true[0], estimate.y - true[1], wrap_angle(estimate.theta - true[2])])
        spread = np.reshape(estimate.covariance, (5, 5))[:3, :3]
        self._nees.append(float(error @ np.linalg.solve(spread, error)))
        apart = np.abs(error).tolist()
        share = max(each / estimate.sigma(place) for place, each in enumerate(apart)) / 3.0
        self._most = np.maximum(self._most, (hypot(*apart[:2]), apart[2] * 180.0 / pi, share))
        self._beyond = self._beyond + ESTIMATION_PERIOD if share > 1.0 else 0.0
        self._longest = max(self._longest, self._beyond)
        if not self._estimator.fusion.believes(self._sensor):
            self._lost, self._again = min(self._lost, now), inf
        elif self._lost < inf and self._again == inf:
            self._again = now

    def found(self) -> Found:
        error, heading, share = self._most.tolist()
        again = max(self._again - END, 0.0) if self._again < inf else inf
        return Found(error, heading, share, self._longest, float(np.mean(self._nees)), self._lost - BEGIN, again)


def cases() -> list[tuple[str, str, str]]:
    """Set-up, sensor and failure of each case; sound sensors are one case of a set-up."""
    return [
        (name, sensor, failure)
        for name in SETUPS
        for sensor in PRESETS[name]
        for failure in FAILURES
        if failure != SOUND or sensor == ENCODERS
    ]


async def _driven(seed: int, *, exact: bool) -> dict[tuple[str, str, str], Found]:
    config = load(None, [f"seed={seed}", *SETTINGS]).config
    async with Robot.open(config=config, hal="sim") as robot:
        await robot.load_gains()
        watches = {each: _Watch(*each, robot, mistakes.of(PRESETS[each[0]], seed, exact=exact)) for each in cases()}

        async def measure(ticks: Ticks) -> None:
            async for now in ticks:
                for watch in watches.values():
                    watch.step(now)

        robot.add_task("measure", ESTIMATION_PERIOD, measure, PRIORITY)
        await drive_as_a_person(robot, seed, SECONDS)
    return {each: watch.found() for each, watch in watches.items()}


def show(numbers: Sequence[int], *, exact: bool) -> None:
    """Drive, and print for each case the worst of the seeds: what got worse since version 0.2.0 first."""
    seeds.each(numbers, "driving", lambda seed: run(_driven(seed, exact=exact), speed="max"), _print)


def _print(results: list[dict[tuple[str, str, str], Found]]) -> None:
    lines = []
    for case in cases():
        found = [each[case] for each in results]
        error, heading, share, beyond, _, detected, again = (max(column) for column in zip(*found, strict=True))
        drives = sum(each.beyond > 1.0 for each in found) / len(found)
        nees = float(np.mean([each.nees for each in found]))
        before = BEFORE[case]
        name = (case[0], "all", case[2]) if case[2] == SOUND else case
        told = ["never" if each == inf else f"{each:.2f}" for each in (detected, again)]
        told = ["-", "-"] if case[2] == SOUND else told
        row = f"| {' | '.join(name)} | {error:.4f} ({before[0]:.4f}) | {heading:.2f} ({before[1]:.2f}) "
        row += f"| {share:.2f} ({before[2]:.2f}) | {beyond:.2f} | {drives:.2f} | {nees:.1f} | {' | '.join(told)} |"
        lines.append((error / before[0], row))
    worse = sum(ratio > 1.0 for ratio, _ in lines)
    print(f"{len(results)} drives, the worst of each, and NEES on average; in brackets version 0.2.0 on the rehearsed")
    print(f"course. Of {len(lines)} errors {worse} are larger than there; the largest ratio first:\n")
    columns = ("set-up", "sensor", "failure", "largest m", "heading deg", "of 3 sigma", "beyond it for s")
    more = ("drives for over 1 s", "NEES", "left out after s", "again after s")
    print(f"| {' | '.join((*columns, *more))} |")
    print("|---" * (len(columns) + len(more)) + "|")
    for _, row in sorted(lines, reverse=True):
        print(row)
