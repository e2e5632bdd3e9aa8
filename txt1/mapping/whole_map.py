"""Finds the places on a whole map at which a cloud of points may lie.

How it works. The walls' field of `matcher.LocalMap`, in cells of 0.1 m, is kept beside its maxima over blocks of 2, 4
and 8 cells. The mean of the points' maxima over a block is an upper bound of the score of each place in it. So all
blocks of 0.8 m are bounded first, at all angles, and only the promising ones are divided (branch and bound with
precomputed grids: Hess, Kohler, Rapp and Andor, "Real-time loop closure in 2D LIDAR SLAM", ICRA 2016). The result is
the best place of each tile of the map and each sector of headings, as far as its score is near the best of all.

A search of a large map takes some tenths of a second. So it is done in portions, and scans are weighed in between.
"""

from __future__ import annotations

from collections.abc import Generator
from functools import cache
from math import ceil, pi, radians
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.mapping import kernels
from txt1.mapping.matcher import FIELD_CELL, Cloud, LocalMap
from txt1.maps.grid import Grid
from txt1.sim.machine_code import compiled

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LARGE: Final = 2.0 * FIELD_CELL
"""m, side of a cell."""
LEVELS: Final = 4
BLOCK: Final = 1 << (LEVELS - 1)
"""Cells on the side of a block in the first round."""
TILE: Final = 8
"""Cells on the side of a tile: along a straight wall, places a metre apart may have nearly the same score."""
SECTORS: Final = 24
"""Number of sectors of headings."""
SCORE_BEHIND: Final = 0.25
"""Difference from the best score of all from which a place does not count."""
LOOKS: Final = 20_000_000
"""Points that are looked up in a portion, some 20 ms."""
MOST: Final = 40_000_000
"""Points that are looked up in blocks that are divided: this bounds the time."""
POLISHED: Final = 1000
"""Number of the best places that are searched for more exactly."""


@cache
def _loops() -> tuple[Any, Any]:
    return (
        compiled(kernels.bounds_of, cache=True, nogil=True),
        compiled(kernels.refined, cache=True, nogil=True),
    )


class WholeMap:
    """The walls of a grid, ready for searches."""

    def __init__(self, grid: Grid, walls: LocalMap) -> None:
        self._walls = walls
        field, self._corner = walls.coarse
        padded = np.pad(field, ((BLOCK, 0), (BLOCK, 0)))
        self._fields = tuple(_maxima(padded, 1 << level) for level in range(LEVELS))
        rows, columns = (BLOCK * ceil(side / BLOCK) for side in field.shape)
        x = self._corner[0] + LARGE * (np.arange(columns) + 0.5)
        y = self._corner[1] + LARGE * (np.arange(rows) + 0.5)
        free = grid.is_free(*np.meshgrid(x, y))
        self._frees = tuple(_blocks(free, 1 << level) for level in range(LEVELS))
        self._every = np.argwhere(self._frees[-1])

    def places(self, cloud: Cloud, enough: float) -> Generator[None, None, Array]:
        """Return poses (n, 3: m, rad) at which the cloud lies on the walls with a score above `enough`, best first.

        Yields after each portion of the work but the last.
        """
        points = np.ascontiguousarray(cloud.points)
        # three quarters of the points are nearer
        far = float(np.quantile(np.hypot(points[:, 0], points[:, 1]), 0.75))
        count = ceil(2.0 * pi / min(max(2.0 * LARGE / max(far, 0.1), radians(1.0)), radians(4.0)))
        angles = np.linspace(0.0, 2.0 * pi, count, endpoint=False)
        bounding, refining = _loops()
        bounds = np.empty((count, len(self._every)), np.float32)
        each = max(1, LOOKS // (len(points) * max(1, len(self._every))))
        for k in range(0, count, each):
            part = slice(k, k + each)
            bounding(self._fields[-1], self._every, points, LARGE, angles[part], BLOCK, bounds[part])
            if k + each < count:
                yield
        flat = bounds.ravel()
        good = np.flatnonzero(flat > enough)
        order = good[np.argsort(-flat[good], kind="stable")]
        tiles = tuple(ceil(side / TILE) for side in self._frees[0].shape)
        best, found = np.full((*tiles, SECTORS), enough), np.zeros((*tiles, SECTORS, 3), np.int64)
        portion, left = LOOKS // len(points), MOST // len(points)
        arguments = flat, points, LARGE, angles, TILE, SCORE_BEHIND
        while True:
            done, looked = refining(
                self._fields, self._frees, self._every, order, *arguments, min(portion, left), best, found
            )
            order, left = order[done:], left - looked
            if not len(order) or left <= 0:
                break
            yield
        return self._polished(cloud, best, found, enough, angles)

    def _polished(self, cloud: Cloud, best: Array, found: NDArray[np.int64], enough: float, angles: Array) -> Array:
        """Return the poses found, best first, some of them searched for in small cells."""
        there = np.argwhere(best > enough)
        there = there[np.argsort(-best[tuple(there.T)], kind="stable")]
        row, column, number = found[tuple(there.T)].T
        poses = np.column_stack((self._corner[0] + LARGE * column, self._corner[1] + LARGE * row, angles[number]))
        for k, pose in enumerate(poses[:POLISHED]):
            poses[k] = self._walls.search(cloud, pose, 0.15, 1.5 * pi / len(angles), (1e3, 1e3), 0.0)[1]
        return poses


def _maxima(field: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """Return for each cell the maximum of `side` x `side` cells from it on, to the right and up."""
    found, reach = field.copy(), 1
    while reach < side:
        np.maximum(found[:, :-reach], found[:, reach:].copy(), out=found[:, :-reach])
        np.maximum(found[:-reach], found[reach:].copy(), out=found[:-reach])
        reach *= 2
    return found


def _blocks(free: Bools, side: int) -> Bools:
    """Return whether any cell of each block of `side` x `side` cells is free."""
    rows, columns = free.shape
    return np.ascontiguousarray(free.reshape(rows // side, side, columns // side, side).any(axis=(1, 3)))
