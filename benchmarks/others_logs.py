"""Logs that others recorded: a skid-steered robot, and a slow one in a room with motion capture.

The skid-steered robot (a course of UCSD, ECE 276A) has counts of four wheels at 40 Hz and a gyro, and no truth. So what
is compared is the way, and how far it turns. Rovers whose effective track changes with the floor are drawn beside it.
The slow robot (UTIAS MRCLAM, K. Leung and others) has commanded speeds and poses of motion capture; fixes are drawn
about these.
"""

import gzip
from math import cos, hypot, inf, pi, sin
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.estimation.settings import EstimationConfig
from txt1.estimation.task import ENCODERS, Estimator, Wheels
from txt1.model.estimate import Estimate
from txt1.model.kinematics import wrap_angle
from txt1.model.odometry import Odometry
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Reading
from txt1.sensors.readings import FixReading, ImuReading, Mount

Array = NDArray[np.float64]

COUNT: Final = 0.0022  # m
SKID: Final = Geometry(
    steering="skid", wheelbase=0.33, track_width=0.393, circumference=360 * COUNT, counts_per_rev=360
)
# its log has commands, and nothing that was counted
CREATE: Final = Geometry(steering="skid", wheelbase=0.2, track_width=0.26, circumference=0.2, counts_per_rev=0)
CYCLE: Final = 0.02  # s
SETTLED: Final = 0.25  # of a drive, after which it is scored
GRAVITY: Final = (0.0, 0.0, 9.81)


def _turning(time: float, rate: float) -> Reading[Any]:
    return Reading(time, ImuReading(GRAVITY, (0.0, 0.0, rate)))


def skid(folder: Path, number: int) -> tuple[float, float, float, float]:
    """The way (m) by the filter and by the wheels of a log, and how far it turned (rad) by the filter and the gyro."""
    with np.load(folder / f"Encoders{number}.npz") as kept:
        counts, times = kept["counts"].astype(float), kept["time_stamps"]
    with np.load(folder / f"Imu{number}.npz") as kept:
        rates, at = kept["angular_velocity"][2], kept["time_stamps"]
    begin = times[0] - 1.0
    estimator = Estimator(EstimationConfig(sensors=("imu", ENCODERS)), {"imu": ImuReading}, SKID)
    way = wheels_way = turned = 0.0
    before, heard = None, 0
    # of the gyro, by the mean while the wheels stand at first
    still = at < times[np.argmax(np.abs(counts).sum(0) > 0)]
    bias = float(rates[still].mean()) if still.any() else 0.0
    for place in range(1, len(times)):
        now, dt = float(times[place] - begin), float(times[place] - times[place - 1])
        while heard < len(at) and at[heard] <= times[place]:
            estimator.take("imu", _turning(float(at[heard] - begin), float(rates[heard])))
            heard += 1
        # front right, front left, rear right, rear left
        right, left = (
            0.5 * COUNT * (counts[0, place] + counts[2, place]),
            0.5 * COUNT * (counts[1, place] + counts[3, place]),
        )
        right, left = float(right), float(left)
        v, omega = 0.5 * (right + left) / dt, (right - left) / dt / SKID.track_width
        told = estimator.step(now, Wheels(Odometry(0.0, 0.0, 0.0, v, omega), now, None, v))
        wheels_way += abs(0.5 * (right + left))
        way += abs(told.v) * dt
        if before is not None:
            turned += wrap_angle(told.theta - before)
        before = told.theta
    inside = (at > times[0]) & (at < times[-1])
    by_gyro = float(np.trapezoid(rates[inside] - bias, at[inside]))
    return way, wheels_way, turned, by_gyro


def scrubbing(scrub: float, seed: int, seconds: float = 120.0) -> tuple[float, float, float]:
    """A rover whose wheels turn by `scrub` times as much as it, on floors that change that: its way by the truth and by
    the filter, m, and the mean NEES of x, y and theta.
    """
    rng = np.random.default_rng([seed, round(100 * scrub)])
    estimator = Estimator(EstimationConfig(sensors=("imu", ENCODERS)), {"imu": ImuReading}, SKID)
    x = y = theta = v = omega = way = told_way = 0.0
    bias, floor, nees = 0.015 * float(rng.normal()), 1.0, []
    asked, turn = 0.0, 0.0
    counted = [0.0, 0.0]
    for cycle in range(1, round(seconds / CYCLE) + 1):
        now = cycle * CYCLE
        if cycle % 100 == 0:
            asked, turn = float(rng.choice((0.0, 0.2, 0.4, 0.6))), float(rng.uniform(-1.0, 1.0))
        if cycle % 1000 == 0:
            floor = float(rng.uniform(0.9, 1.1))
        v += float(np.clip(asked - v, -CYCLE, CYCLE))
        omega += float(np.clip(turn * (v > 0.0) - omega, -3.0 * CYCLE, 3.0 * CYCLE))
        middle = theta + 0.5 * omega * CYCLE
        x, y, theta = x + v * CYCLE * cos(middle), y + v * CYCLE * sin(middle), theta + omega * CYCLE
        way += abs(v) * CYCLE
        for time in (now - 0.5 * CYCLE, now):
            estimator.take("imu", _turning(time, omega + bias + 0.006 * float(rng.normal())))
        apart = 0.5 * SKID.track_width * scrub * floor * omega
        rolled = []
        for side, speed in enumerate((v + apart, v - apart)):
            before = np.floor(counted[side] / COUNT)
            counted[side] += speed * CYCLE
            rolled.append((np.floor(counted[side] / COUNT) - before) * COUNT / CYCLE)
        right, left = map(float, rolled)
        odometry = Odometry(0.0, 0.0, 0.0, 0.5 * (right + left), (right - left) / SKID.track_width)
        told = estimator.step(now, Wheels(odometry, now, None, asked))
        told_way += abs(told.v) * CYCLE
        if cycle * CYCLE > SETTLED * seconds:
            nees.append(_nees(told, (x, y, theta)))
    return way, told_way, float(np.mean(nees))


def _nees(told: Estimate, true: tuple[float, float, float]) -> float:
    error = np.array([told.x - true[0], told.y - true[1], wrap_angle(told.theta - true[2])])
    return float(error @ np.linalg.solve(np.reshape(told.covariance, (5, 5))[:3, :3], error))


def show_skid(folder: Path) -> None:
    """Print the ways of the logs, and of rovers that scrub."""
    print("| log | way m | by the wheels m | turned deg | by the gyro deg |\n|---|---|---|---|---|")
    for number in (20, 21):
        if (folder / f"Encoders{number}.npz").is_file():
            way, wheels, turned, gyro = skid(folder, number)
            print(f"| {number} | {way:.1f} | {wheels:.1f} | {turned * 180.0 / pi:.1f} | {gyro * 180.0 / pi:.1f} |")
    print("\n| scrub | way m | true m | off % | NEES |\n|---|---|---|---|---|")
    for scrub in (1.0, 1.2, 1.5, 1.9):
        way, told, nees = scrubbing(scrub, 1)
        print(f"| {scrub:.1f} | {told:.2f} | {way:.2f} | {100.0 * (told / way - 1.0):.1f} | {nees:.2f} |")


def _columns(file: Path) -> Array:
    with gzip.open(file, "rt") as lines:
        return np.array([list(map(float, line.split())) for line in lines if line.strip() and line[0] != "#"])


def slow(folder: Path, sigma: float, seed: int, *, gap: float = 0.0) -> tuple[float, float, float]:
    """The position's rms error (m) with fixes of this sigma (m) at 5 Hz, its NEES, and when the robot was located, s.

    `gap`: of each 20 s so many have no fix.
    """
    rng = np.random.default_rng(seed)
    commands, truth = _columns(folder / "d7-r1-Odometry.dat.gz"), _columns(folder / "d7-r1-Groundtruth.dat.gz")
    begin, end = max(commands[0, 0], truth[0, 0]) + 1.0, min(commands[-1, 0], truth[-1, 0])
    headings = np.unwrap(truth[:, 3])
    estimator = Estimator(EstimationConfig(sensors=(ENCODERS, "gps"), track_sigma=0.05), {"gps": FixReading}, CREATE)
    errors, nees, located = [], [], inf
    for cycle in range(1, int((end - begin) / CYCLE)):
        now = cycle * CYCLE
        x, y, theta = (np.interp(begin + now, truth[:, 0], each).item() for each in (*truth.T[1:3], headings))
        place = np.searchsorted(commands[:, 0], begin + now) - 1
        v, omega = commands[place, 1:].tolist()
        if cycle % 10 == 0 and (not gap or now % 20.0 >= gap):
            zx, zy = x + sigma * float(rng.normal()), y + sigma * float(rng.normal())
            fix = FixReading(0.0, 0.0, zx, zy, sigma_x=sigma, sigma_y=sigma, mount=Mount(0.0, 0.0, 0.0))
            estimator.take("gps", Reading(now, fix))
        told = estimator.step(now, Wheels(Odometry(0.0, 0.0, 0.0, v, omega), now, None, v))
        if told.located:
            located = min(located, now)
            if now > SETTLED * (end - begin):
                errors.append(hypot(told.x - x, told.y - y))
                nees.append(_nees(told, (x, y, theta)))
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else inf, float(np.mean(nees)), located


def show_slow(folder: Path) -> None:
    """Print the errors of the slow robot by the fixes' noise."""
    print("| fixes | m rms | NEES | located after s |\n|---|---|---|---|")
    for name, sigma, gap in (("1 m", 1.0, 0.0), ("0.1 m", 0.1, 0.0), ("0.1 m, gaps of 10 s", 0.1, 10.0)):
        error, nees, located = slow(folder, sigma, 1, gap=gap)
        print(f"| {name} | {error:.3f} | {nees:.1f} | {located:.1f} |")
