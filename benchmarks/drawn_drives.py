"""Drives with the truth beside them, drawn by chance: an integration of the car apart from the robot's simulator.

The car is the thesis's (2.12), with opposite angles of its axles, and what the filter does not know of it is drawn for
each drive: understeer, a servo's lag, slip that wanders about a mean, the gyro's bias, its walk, and its age. The
encoder wheels are steered: with the angle phi the hubs' velocities projected on the wheels' heading are

    v cos(phi) + 0.5 L omega sin(phi) +- 0.5 track omega cos(phi)

The files are those that `benchmarks.drives` reads. What is wrong with the sensors is in their names.
"""

from collections.abc import Callable
from math import cos, exp, pi, sin, sqrt, tan
from pathlib import Path
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from benchmarks.drives import Drive
from txt1.model.vehicle import Geometry
from txt1.sensors.readings import GPS_MOUNT

Array = NDArray[np.float64]

STEP: Final = 0.001  # s
CYCLE: Final = 0.02  # s
SPEEDS: Final = (0.0, 0.3, 0.6, 0.9, 1.2)  # m/s
ACCELERATION: Final = 1.5  # m/s^2
LEVER: Final = 0.05  # m by which the mount of a "lever" drive is wrong


def _held(rng: Generator, times: Array, first: float, draw: Callable[[], float]) -> Array:
    """A command that stays for 1 to 3 s: `first` for the first two seconds, then whatever is drawn."""
    begins, values = [0.0, 2.0], [first, draw()]
    while begins[-1] < times[-1]:
        begins.append(begins[-1] + float(rng.uniform(1.0, 3.0)))
        values.append(draw())
    held: Array = np.array(values)[np.searchsorted(begins, times, side="right") - 1]
    return held


def _wandering(rng: Generator, count: int, dt: float, sigma: float, time_constant: float) -> Array:
    """A Gauss-Markov process about zero, shape (count,)."""
    share = exp(-dt / time_constant)
    noise = rng.normal(size=count) * sigma * sqrt(1.0 - share * share)
    values, value = [], sigma * float(rng.normal())
    for each in noise.tolist():
        value = share * value + each
        values.append(value)
    return np.array(values)


def _way(rng: Generator, seconds: float) -> tuple[Array, Array]:
    """The truth (t, x, y, theta, v, omega, right and left way) every `STEP`, and the commands every `CYCLE`."""
    body = Geometry()
    times = np.arange(0.0, seconds + STEP / 2, STEP)
    speed = _held(rng, times, 0.0, lambda: float(rng.choice(SPEEDS)))
    steering = _held(rng, times, 0.0, lambda: float(np.clip(rng.normal(0.0, 0.6), -0.95, 0.95)))
    slip = float(rng.uniform(0.0, 0.04)) + _wandering(rng, len(times), STEP, float(rng.uniform(0.003, 0.012)), 3.0)
    understeer, lag = float(rng.uniform(0.0, 0.1)), float(rng.uniform(0.05, 0.1))
    x, y, theta = map(float, rng.uniform((-5.0, -5.0, -pi), (5.0, 5.0, pi)))
    rolled, phi, right, left = 0.0, 0.0, 0.0, 0.0
    rows = []
    for time, asked, turned, slipped in zip(
        times.tolist(), speed.tolist(), steering.tolist(), slip.tolist(), strict=True
    ):
        curvature = tan(phi) / (body.lever * (1.0 + understeer * rolled * rolled))
        v = rolled * (1.0 - slipped)
        omega = v * curvature
        rows.append((time, x, y, theta, v, omega, right, left))
        ahead = rolled * (cos(phi) + 0.5 * body.wheelbase * curvature * sin(phi))
        apart = 0.5 * body.track_width * rolled * curvature * cos(phi)
        right, left = right + STEP * (ahead + apart), left + STEP * (ahead - apart)
        half = theta + 0.5 * omega * STEP
        x, y, theta = x + STEP * v * cos(half), y + STEP * v * sin(half), theta + STEP * omega
        rolled += min(max(asked - rolled, -ACCELERATION * STEP), ACCELERATION * STEP)
        phi += (body.steering_max * turned - phi) * STEP / lag
    cycles = slice(round(CYCLE / STEP), None, round(CYCLE / STEP))
    return np.array(rows), np.stack((steering[cycles], speed[cycles]), 1)


def drawn(kind: str, seed: int) -> Drive:
    """A drive of a kind, such as "gps-outliers", "mocap-late80-drop", "mocap-lever-5cm" or "gyro"."""
    rng = np.random.default_rng([seed, *kind.encode()])
    body = Geometry()
    rows, commands = _way(rng, 120.0 if kind.startswith("gps") else 60.0)
    every = round(CYCLE / STEP)
    steps = rows[every::every]
    counts = np.floor(steps[:, 6:8] / body.count_length)
    times = steps[:, 0]
    motor = commands[:, 1] * 3000.0
    drive = {
        "truth": steps[:, :6],
        "wheels": np.column_stack((times + 1e-5, times, counts, commands, motor)),
    }
    fast = rows[every // 2 :: every // 2]
    bias = float(rng.normal(0.0, 0.015)) + 0.00027 * np.sqrt(0.01) * np.cumsum(rng.normal(size=len(fast)))
    # a gyro that averages within its period tells what was half of it ago
    old = np.interp(fast[:, 0] - float(rng.uniform(0.0, 0.005)), rows[:, 0], rows[:, 5])
    rates = old + bias + rng.normal(0.0, 0.00633, len(fast))
    drive["imu"] = np.column_stack((fast[:, 0], fast[:, 0], rates))
    if kind.startswith("gps"):
        slow = rows[round(0.2 / STEP) :: round(0.2 / STEP)]
        at = GPS_MOUNT.x * np.column_stack((np.cos(slow[:, 3]), np.sin(slow[:, 3])))
        places = slow[:, 1:3] + at + rng.normal(size=(len(slow), 2))
        if "outliers" in kind:
            far = rng.random(len(slow)) < 0.03
            places[far] += rng.normal(0.0, 15.0, (int(far.sum()), 2))
        if "jumps" in kind:
            for begin in np.arange(0.2, 1.0, 0.17) * slow[-1, 0] + rng.uniform(-3.0, 3.0, 5):
                inside, way = (slow[:, 0] >= begin) & (slow[:, 0] < begin + 4.0), rng.uniform(-pi, pi)
                places[inside] += 10.0 * np.array([np.cos(way), np.sin(way)])
        drive["gps"] = np.column_stack((slow[:, 0], slow[:, 0], places))
    if kind.startswith("mocap"):
        lever = LEVER if "lever" in kind else 0.0
        at = lever * np.column_stack((np.cos(fast[:, 3]), np.sin(fast[:, 3])))
        told = np.column_stack((fast[:, 1:3] + at, fast[:, 3])) + rng.normal(size=(len(fast), 3)) * (
            0.002,
            0.002,
            0.003,
        )
        late = 0.08 if "late80" in kind else 1e-4
        seen = np.column_stack((fast[:, 0] + late, fast[:, 0], told))
        if "drop" in kind:
            kept, begin = np.ones(len(seen), dtype=bool), 0.0
            while begin < times[-1]:
                begin += float(rng.uniform(5.0, 12.0))
                kept &= ~((seen[:, 1] > begin) & (seen[:, 1] < begin + float(rng.uniform(0.6, 1.8))))
            seen = seen[kept]
        drive["vicon"] = seen
    return drive


KINDS: Final = (
    "gyro-clean", "gps-clean", "gps-outliers3pc", "gps-10m-jumps-4s", "mocap-clean", "mocap-late80-true-stamp-drop",
    "mocap-lever-5cm-wrong",
)  # fmt: skip


def write(folder: Path, seeds: range) -> None:
    """Write drives of all kinds into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind in KINDS:
        for seed in seeds:
            np.savez_compressed(folder / f"{kind}-{seed}.npz", allow_pickle=False, **drawn(kind, seed))
