"""Logs of lasers in CARMEN's format, plain or gzip, recorded by others.

They become a `Log`: the scans, the odometry at each scan, and reference poses if the log has them.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterable, Iterator
from math import pi, radians
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import Txt1Error
from txt1.mapping.poses import composed

Array = NDArray[np.float64]

GZIP: Final = b"\x1f\x8b"
# CARMEN's parameters that have the field of view of FLASER; without one it is 180 degrees
FIELDS: Final = ("laser_front_laser_fov", "robot_front_laser_fov")
RADIANS_TO: Final = 2.0 * pi + 1e-4
"""rad, a whole turn, as a rounded number may have it."""
RANGE_USED_MIN: Final = 0.05
"""m; a shorter range counts as none."""
RANGE_USED_MAX: Final = 30.0
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

    Ranges that are NaN, infinite, below `RANGE_USED_MIN`, at least `longest`, or beyond `RANGE_USED_MAX` are left out.
    """
    with np.errstate(invalid="ignore"):
        good = (ranges > RANGE_USED_MIN) & (ranges < min(longest, RANGE_USED_MAX))
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
        raise LogError(f"{path}: no scan in it, neither FLASER nor ROBOTLASER1")
    return Log(path.name.split(".")[0], scans)


def _scans(path: Path, lines: Iterable[str]) -> Iterator[LaserScan]:
    # of FLASER, rad; its lines do not have it
    field = pi
    for number, line in enumerate(lines, 1):
        words = line.split()
        try:
            if not words or line.startswith("#"):
                continue
            if words[0] == "PARAM" and words[1] in FIELDS:
                told = float(words[2])
                # some logs have it in radians, and no laser sees as few degrees
                field = told if 0.0 < told <= RADIANS_TO else radians(told)
                if not 0.0 < field <= RADIANS_TO:
                    raise ValueError(f"{words[1]} is {words[2]} degrees; it is from 0 to 360")
            elif words[0] == "FLASER":
                yield _flaser(words, field)
            elif words[0] == "ROBOTLASER1":
                yield _robotlaser(words)
        except (ValueError, IndexError) as error:
            raise LogError(f"{path}: line {number} cannot be read: {error}") from error


def _numbers(words: list[str]) -> Array:
    return np.array(words, dtype=np.float64)


def _pose(words: list[str]) -> tuple[float, float, float]:
    x, y, theta = map(float, words)
    if not np.isfinite((x, y, theta)).all():
        raise ValueError("a pose is no number")
    return x, y, theta


def _flaser(words: list[str], field: float) -> LaserScan:
    """FLASER n r1 ... rn x y theta odom_x odom_y odom_theta time host logger_time; `field` of view in rad."""
    count = int(words[1])
    if count < 1 or len(words) < count + 9:
        raise ValueError(f"it says {count} ranges and is {len(words)} words long")
    # an odd number of beams has a beam at each end, an even number leaves the last out
    step = field / (count - count % 2) if count > 1 else 0.0
    rest = words[2 + count :]
    return LaserScan(
        float(rest[6]),
        _numbers(words[2 : 2 + count]),
        -field / 2.0 + step * np.arange(count, dtype=np.float64),
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
