"""The log of a small rover with a URG-04LX, exp1.dat, which txt1 does not read; and odometry made worse."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1.mapping import carmen_logs
from txt1.mapping.carmen_logs import GZIP, Array, LaserScan, Log, LogError
from txt1.mapping.poses import accumulated, composed, difference

TICKS: Final = 2000
"""Ticks of the rover's wheels per turn."""
WHEEL: Final = 0.077
"""Radius of the wheels, m."""
HALF_AXLE: Final = 0.165
"""Half the distance between the wheels, m."""
AHEAD: Final = 0.145
"""Distance of its laser ahead of the axle, m."""
TURN: Final = 0.1
"""s in which its laser turns once."""
SWEEP: Final = TURN * 682 / 1024
"""s from its laser's first beam to the last: a turn has 1024 steps."""
EVEN: Final = 20
"""Lines to either side whose median time tells when the laser turned, as lines are written up to 50 ms early or late.
With 15 to 30 of them the turning rates of ranges and ticks agree best.
"""
LATE: Final = 0.15
"""s by which a line's ranges are older than its ticks: the delay at which the turning rates of both agree best."""


def read(path: Path) -> Log:
    """Return a log of the rover, or one in CARMEN's format; raises LogError."""
    with path.open("rb") as file:
        packed = file.read(2) == GZIP
    rover = Rover()
    with gzip.open(path, "rt", errors="replace") if packed else path.open(errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            words = line.split()
            if words and words[0].isdigit() and len(words) > 100:
                try:
                    rover.take(words)
                except (ValueError, IndexError) as error:
                    raise LogError(f"{path}: line {number} cannot be read: {error}") from error
    scans = list(rover.scans())
    return Log(path.name.split(".")[0], scans) if scans else carmen_logs.read(path)


class Rover:
    """Lines of exp1.dat: time in us, ticks of both wheels in columns 3 and 4, ranges in mm from column 25 on."""

    def __init__(self) -> None:
        self._ticks: tuple[int, int] | None = None
        self._lines: list[tuple[float, Array]] = []
        self._poses: list[tuple[float, float, float]] = []

    def take(self, words: list[str]) -> None:
        """Take the words of the next line."""
        ticks = int(words[2]), int(words[3])
        x, y, theta = self._poses[-1] if self._poses else (-AHEAD, 0.0, 0.0)
        if self._ticks is not None:
            metres = 2.0 * pi * WHEEL / TICKS
            left, right = ((new - old) * metres for new, old in zip(ticks, self._ticks, strict=True))
            middle = theta + (right - left) / (4.0 * HALF_AXLE)
            way = (right + left) / 2.0
            x, y, theta = x + way * cos(middle), y + way * sin(middle), theta + (right - left) / (2.0 * HALF_AXLE)
        self._ticks = ticks
        self._poses.append((x, y, theta))
        self._lines.append((float(words[0]) * 1e-6, np.array(words[24:], dtype=np.float64) / 1000.0))

    def scans(self) -> Iterator[LaserScan]:
        """Yield the scans, each from the laser's pose in the middle of its sweep."""
        if not self._lines:
            return
        times, poses = np.array([time for time, _ in self._lines]), np.array(self._poses)
        turns = TURN * np.arange(len(times), dtype=np.float64)
        off = times - turns
        usual = [float(np.median(off[max(0, k - EVEN) : k + EVEN + 1])) for k in range(len(times))]
        middles: Array = turns + np.array(usual) - LATE

        def laser(at: Any) -> Array:
            between = np.stack([np.interp(at, times, poses[:, k]) for k in range(3)], axis=-1)
            return composed(between, (AHEAD, 0.0, 0.0))

        for (time, ranges), at in zip(self._lines, middles, strict=True):
            step: Array = np.arange(len(ranges), dtype=np.float64) - (len(ranges) - 1) / 2.0
            middle = laser(at)
            swept = difference(middle, laser(at + step * SWEEP / len(ranges)))
            x, y, theta = map(float, middle)
            yield LaserScan(time, ranges, 2.0 * pi / 1024.0 * step, (x, y, theta), None, swept)


def drifted(odometry: Array, seed: int, scale: float = 0.05, noise: float = radians(2.0), track: float = 0.4) -> Array:
    """Return odometry with an additional error: a wheel's scale is wrong by `scale`, and the heading wanders.

    Args:
        odometry: poses, a row for each scan (m, rad).
        seed: seed of the heading's noise.
        scale: relative error of the right wheel's distance.
        noise: rad by which the heading wanders in a metre (a random walk: it grows with the root of the distance).
        track: distance between the wheels, m.

    """
    rng = np.random.default_rng(seed)
    steps = difference(odometry[:-1], odometry[1:])
    way = steps[:, 0]
    # the right wheel travels distance + theta track / 2; half of its excess moves the middle, and the excess turns the
    # robot
    extra = scale * (way + steps[:, 2] * track / 2.0)
    steps[:, 0] += extra / 2.0
    steps[:, 2] += extra / track + noise * np.sqrt(np.hypot(way, steps[:, 1])) * rng.standard_normal(len(steps))
    return accumulated(odometry[0], steps)
