"""Finds the pose at which a cloud of points lies on a map of points.

How it works
------------

*Clouds.* A scan becomes a cloud: points at least 5 cm apart as seen from the robot, and the normal of the surface at
each of them (`kernels.thin`).

*A local map* has the points of several clouds in a common frame. Its field has cells of 5 cm with the value 255
exp(-d^2 / 2 sigma^2), for the distance d to the nearest point.

*Search.* All poses of a window are compared: the mean of the field over the points. Branch and bound leaves out blocks
of poses that cannot be the best (`kernels.search`; Olson 2009, Hess 2016). So a match is found even if the prediction
is wrong by more than any gradient could mend.

*Alignment.* From the best pose on, the cloud is aligned with the lines of the map (`kernels.align`; point-to-line ICP,
Censi 2008). This is exact to a few mm. It also gives the information on each direction, which is none along a corridor.

numba compiles the loops (extra `fast`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import ceil, radians
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.mapping import kernels
from txt1.mapping.poses import placed
from txt1.sim.machine_code import compiled

Array = NDArray[np.float64]

FIELD_CELL: Final = 0.05
"""m, side of the field's cells."""
SIGMA: Final = 0.06
"""m, width of the field's bells: the laser's noise and half a cell."""
LIST_CELL: Final = 0.3
"""m, side of the cells in which points are looked up; the largest distance of a pair."""
NEAR: Final = np.array([0.3, 0.3, 0.2, 0.2, 0.15, 0.15, 0.1, 0.1])
"""m, largest distance of a pair in each round."""
SCALE: Final = 0.05
"""m, scale of the weights in the alignment."""
SEEN_CELL: Final = 0.1
"""m, side of the cells in which rays are noted."""
CLOUD_SPACING: Final = 0.05
"""m between points of a cloud."""
BROKEN: Final = 0.3
"""m between points on different surfaces."""


def _bell(parts: int) -> NDArray[np.uint8]:
    """Return 255 exp(-d^2 / 2 SIGMA^2) on the cells round a point, for parts x parts places of the point in its
    cell.
    """
    reach = int(2.5 * SIGMA / FIELD_CELL) + 1
    along = np.arange(-reach, reach + 1) + 0.5
    within = (np.arange(parts) + 0.5) / parts
    squares = ((along[None] - within[:, None]) * FIELD_CELL) ** 2
    distances = squares[:, None, :, None] + squares[None, :, None, :]
    return (255.0 * np.exp(-distances / (2.0 * SIGMA**2))).astype(np.uint8)


BELL: Final = _bell(5)


class Cloud(NamedTuple):
    """Points (n, 2) and normals (n, 2), m."""

    points: Array
    normals: Array


class Kernels(NamedTuple):
    """The loops, compiled."""

    thin: Callable[..., Any]
    stamp: Callable[..., Any]
    search: Callable[..., Any]
    listed: Callable[..., Any]
    align: Callable[..., Any]
    carve: Callable[..., Any]


@cache
def compiled_kernels() -> Kernels:
    """Return the loops; raises ImportError: numba is not installed."""
    names = ("thin", "stamp", "search", "listed", "carve")
    made = {name: compiled(getattr(kernels, name), cache=True, nogil=True) for name in names}
    paired = compiled(kernels.pairs, cache=True, nogil=True)
    return Kernels(**made, align=compiled(kernels.align, calls={"pairs": paired}, cache=True, nogil=True))


class LocalMap:
    """A map of points for matching; `cloud` is in the frame of the poses found."""

    def __init__(self, cloud: Cloud, loops: Kernels) -> None:
        self.cloud = cloud
        self._loops = loops
        low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
        margin = (BELL.shape[2] // 2 + 1) * FIELD_CELL
        self._corner = float(low[0] - margin), float(low[1] - margin)
        # multiples of 4, to be halved twice
        columns, rows = (4 * ceil((float(each) + 2.0 * margin) / FIELD_CELL / 4) for each in high - low)
        field = np.zeros((rows, columns), np.uint8)
        loops.stamp(field, cloud.points, *self._corner, FIELD_CELL, BELL)
        halves = _halved(field)
        self._fields = field, _spread(halves, 1), _spread(_halved(halves), 2)
        size = int(rows * FIELD_CELL / LIST_CELL) + 1, int(columns * FIELD_CELL / LIST_CELL) + 1
        self._first, self._following = loops.listed(cloud.points, *self._corner, LIST_CELL, *size)

    def search(
        self, cloud: Cloud, pose: Array, reach: float, turn: float, loose: tuple[float, float], at_least: float
    ) -> tuple[float, Array]:
        """Return the score (0 to 1; `at_least` if none is better) and the best pose of a window around a pose.

        Args:
            cloud: points in the frame of the pose.
            pose: x, y, theta (m, rad), in the middle of the window.
            reach: m to each side.
            turn: rad to each side.
            loose: m and rad of difference from the pose that cost 0.1 of the score.
            at_least: a lower score does not count.

        """
        points = cloud.points
        # three quarters of the points are nearer
        quarter = 3 * len(points) // 4
        far = float(np.partition(np.hypot(points[:, 0], points[:, 1]), quarter)[quarter])
        step = min(max(2.0 * FIELD_CELL / max(far, 0.1), radians(0.3)), radians(2.0))
        each = ceil(turn / step)
        angles = pose[2] + step * np.arange(-each, each + 1)
        costs = np.array([0.1 * (FIELD_CELL / loose[0]) ** 2, 0.1 * (step / loose[1]) ** 2])
        score, dx, dy, number = self._loops.search(
            *self._fields,
            points,
            self._corner[0] - pose[0],
            self._corner[1] - pose[1],
            FIELD_CELL,
            angles,
            ceil(reach / FIELD_CELL),
            costs,
            at_least,
        )
        if number < 0:
            return at_least, pose
        return score, np.array([pose[0] + dx * FIELD_CELL, pose[1] + dy * FIELD_CELL, angles[number]])

    @property
    def coarse(self) -> tuple[NDArray[np.uint8], tuple[float, float]]:
        """The field in cells twice as large, each the maximum of four, and its corner, m."""
        return _halved(self._fields[0]), self._corner

    def near(self, points: Array) -> NDArray[np.bool_]:
        """Return whether each point lies within 2.5 `SIGMA` of a point of the map."""
        return np.asarray(_looked_up(self._fields[0], points, self._corner, FIELD_CELL) > 0)

    def align(self, cloud: Cloud, start: Array, centre: Array, prior: Array) -> tuple[Array, Array, float, float]:
        """Return (pose, information, share that fits, rms in m), as `kernels.align`."""
        found: tuple[Array, Array, float, float] = self._loops.align(
            start,
            centre,
            prior,
            *cloud,
            *self.cloud,
            self._first,
            self._following,
            *self._corner,
            LIST_CELL,
            NEAR,
            SCALE,
        )
        return found


class SeenWalls:
    """The cells, of `SEEN_CELL`, that rays from several poses have reached."""

    def __init__(self, clouds: list[Cloud], poses: Array, loops: Kernels) -> None:
        """Note the rays of clouds, each from its pose."""
        ends = [placed(pose, cloud.points) for cloud, pose in zip(clouds, poses, strict=True)]
        every = np.concatenate((*ends, poses[:, :2]))
        low, high = every.min(axis=0), every.max(axis=0)
        columns, rows = (int(each / SEEN_CELL) + 1 for each in high - low)
        hits, passes = np.zeros((rows, columns), np.int32), np.zeros((rows, columns), np.int32)
        for end, pose in zip(ends, poses, strict=True):
            x, y = (pose[:2] - low) / SEEN_CELL
            loops.carve(hits, passes, (end - low) / SEEN_CELL, x, y)
        self._field, self._corner = hits + passes, (float(low[0]), float(low[1]))

    def known(self, points: Array) -> NDArray[np.bool_]:
        """Return whether a ray reached the cell of each point."""
        return np.asarray(_looked_up(self._field, points, self._corner, SEEN_CELL) > 0)


def _looked_up(field: Any, points: Array, corner: tuple[float, float], cell: float) -> Any:
    """Return the field at each point, 0 outside."""
    columns, rows = np.floor((points - corner) / cell).astype(np.int64).T
    inside = (rows >= 0) & (columns >= 0) & (rows < field.shape[0]) & (columns < field.shape[1])
    return np.where(inside, field[np.where(inside, rows, 0), np.where(inside, columns, 0)], 0)


def _halved(field: Any) -> Any:
    """Return the maximum of each 2 x 2 cells; their numbers are even."""
    rows = np.maximum(field[::2], field[1::2])
    return np.maximum(rows[:, ::2], rows[:, 1::2])


def _spread(field: Any, more: int) -> Any:
    """Return the maximum of blocks of 1 + `more` cells a side, each to the right and up of its cell."""
    found = field.copy()
    for by in range(1, more + 1):
        np.maximum(found[:, :-by], field[:, by:], out=found[:, :-by])
    along = found.copy()
    for by in range(1, more + 1):
        np.maximum(found[:-by], along[by:], out=found[:-by])
    return found


def cloud_of(points: Array, loops: Kernels) -> Cloud:
    """Return the cloud of points in the order of the beams, in the laser's frame, m."""
    # points that came over a line are read-only, a type of its own, for which the loop would be compiled in the drive
    return Cloud(*loops.thin(np.require(points, requirements=("C", "W")), CLOUD_SPACING, BROKEN))


def joined(clouds: list[Cloud], poses: Array) -> Cloud:
    """Return several clouds as a single cloud; each is given in the frame of its pose, a row of `poses` (m, rad)."""
    counts = [len(each.points) for each in clouds]
    x, y, theta = np.repeat(poses, counts, axis=0).T
    cosine, sine = np.cos(theta), np.sin(theta)
    u, v = np.concatenate([each.points for each in clouds]).T
    p, q = np.concatenate([each.normals for each in clouds]).T
    points = x + cosine * u - sine * v, y + sine * u + cosine * v
    return Cloud(np.column_stack(points), np.column_stack((cosine * p - sine * q, sine * p + cosine * q)))


def sparse(cloud: Cloud, most: int) -> Cloud:
    """Return at most `most` of the cloud's points, one from each cell of a sufficiently coarse grid."""
    cell = CLOUD_SPACING
    while len(cloud.points) > most:
        cell *= 1.5
        cells = np.floor(cloud.points / cell).astype(np.int64)
        _, kept = np.unique(cells[:, 0] * 1_000_003 + cells[:, 1], return_index=True)
        if len(kept) <= most:
            kept.sort()
            return Cloud(cloud.points[kept], cloud.normals[kept])
    return cloud
