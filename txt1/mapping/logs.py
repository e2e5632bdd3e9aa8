"""Logs of lasers, recorded by others: CARMEN's, plain or gzip, and those of a small rover with a URG-04LX.

Both become a `Log`: the scans, the odometry at each scan, and reference poses if the log has them.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterable, Iterator
from math import cos, pi, radians, sin
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import Txt1Error
from txt1.mapping.poses import accumulated, composed, difference

Array = NDArray[np.float64]

GZIP: Final = b"\x1f\x8b"
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
SHORTEST: Final = 0.05
"""m; a shorter range counts as none."""
LONGEST: Final = 30.0
"""m; things farther away tell little about the pose."""


class LogError(Txt1Error):
    """A log holds no scans, or a line that cannot be read."""


class LaserScan(NamedTuple):
    """A scan of a log, from the laser's pose by odometry."""

    time: float
    """s."""
    ranges: Array
    """m; NaN, inf or 0 for no range."""
    angles: Array
    """rad, counter-clockwise from straight ahead."""
    odometry: tuple[float, float, float]
    """x, y, theta (m, rad)."""
    reference: tuple[float, float, float] | None
    """The reference pose by others, None if the log has none."""
    swept: Array | None = None
    """(n, 3): the laser's pose at each beam, relative to `odometry` (m, rad); None: unknown."""


class Log(NamedTuple):
    """The scans of a log, and their common properties."""

    name: str
    scans: list[LaserScan]

    @property
    def odometry(self) -> Array:
        """Poses by odometry, a row for each scan (m, rad)."""
        return np.array([scan.odometry for scan in self.scans])

    @property
    def reference(self) -> Array | None:
        """Reference poses, a row for each scan (m, rad); None if there are none."""
        if any(scan.reference is None for scan in self.scans):
            return None
        return np.array([scan.reference for scan in self.scans])

    @property
    def longest(self) -> float:
        """The range, m, that the laser logs when it sees nothing: the longest in the log."""
        return max(float(np.max(scan.ranges, where=np.isfinite(scan.ranges), initial=0.0)) for scan in self.scans)


def points_of(ranges: Array, angles: Array, longest: float, swept: Array | None = None) -> Array:
    """Return the ends of the beams, (n, 2) in m, in the frame of `swept`, in their order.

    Ranges that are NaN, infinite, below `SHORTEST`, at least `longest`, or beyond `LONGEST` are left out.
    """
    with np.errstate(invalid="ignore"):
        good = (ranges > SHORTEST) & (ranges < min(longest, LONGEST))
    ends = np.column_stack(
        (ranges[good] * np.cos(angles[good]), ranges[good] * np.sin(angles[good]), np.zeros(good.sum()))
    )
    return (ends if swept is None else composed(swept[good], ends))[:, :2]


def read(path: Path) -> Log:
    """Return the log in this file; raises LogError: it has no scans, or a broken line, which the error names."""
    try:
        with path.open("rb") as file:
            packed = file.read(2) == GZIP
        with gzip.open(path, "rt", errors="replace") if packed else path.open(errors="replace") as lines:
            scans = list(_scans(path, lines))
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise LogError(f"{path}: the gzip file is damaged: {error}") from error
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from error
    if not scans:
        raise LogError(f"{path}: no scan in it, neither FLASER, ROBOTLASER1 nor lines of 24 columns and ranges")
    return Log(path.name.split(".")[0], scans)


def _scans(path: Path, lines: Iterable[str]) -> Iterator[LaserScan]:
    rover = _Rover()
    for number, line in enumerate(lines, 1):
        words = line.split()
        try:
            if not words or line.startswith("#"):
                continue
            if words[0] == "FLASER":
                yield _flaser(words)
            elif words[0] == "ROBOTLASER1":
                yield _robotlaser(words)
            elif words[0].isdigit() and len(words) > 100:
                rover.take(words)
        except (ValueError, IndexError) as error:
            raise LogError(f"{path}: line {number} cannot be read: {error}") from error
    yield from rover.scans()


def _numbers(words: list[str]) -> Array:
    return np.array(words, dtype=np.float64)


def _pose(words: list[str]) -> tuple[float, float, float]:
    x, y, theta = map(float, words)
    if not np.isfinite((x, y, theta)).all():
        raise ValueError("a pose is no number")
    return x, y, theta


def _flaser(words: list[str]) -> LaserScan:
    """FLASER n r1 ... rn x y theta odom_x odom_y odom_theta time host logger_time."""
    count = int(words[1])
    if count < 1 or len(words) < count + 9:
        raise ValueError(f"it says {count} ranges and is {len(words)} words long")
    # an odd number of beams has a beam at each end, an even number leaves the last out
    step = pi / (count - count % 2) if count > 1 else 0.0
    rest = words[2 + count :]
    return LaserScan(
        float(rest[6]),
        _numbers(words[2 : 2 + count]),
        -pi / 2.0 + step * np.arange(count, dtype=np.float64),
        _pose(rest[3:6]),
        _pose(rest[:3]),
    )


def _robotlaser(words: list[str]) -> LaserScan:
    """ROBOTLASER1 type start fov step max accuracy mode n r1 ... rn m s1 ... sm laser(3) robot(3) ... time host."""
    start, step, count = float(words[2]), float(words[4]), int(words[8])
    if count < 1 or len(words) < count + 10:
        raise ValueError(f"it says {count} ranges and is {len(words)} words long")
    rest = words[10 + count + int(words[9 + count]) :]
    pose = _pose(rest[:3])
    return LaserScan(
        float(rest[11]), _numbers(words[9 : 9 + count]), start + step * np.arange(count, dtype=np.float64), pose, pose
    )


class _Rover:
    """Lines of exp1.dat: time in us, ticks of both wheels in columns 3 and 4, ranges in mm from column 25 on."""

    def __init__(self) -> None:
        self._ticks: tuple[int, int] | None = None
        self._lines: list[tuple[float, Array]] = []
        self._poses: list[tuple[float, float, float]] = []

    def take(self, words: list[str]) -> None:
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
        self._lines.append((float(words[0]) * 1e-6, _numbers(words[24:]) / 1000.0))

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
