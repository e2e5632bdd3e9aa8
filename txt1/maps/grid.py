"""An occupancy grid: a floor, cell by cell, as nav_msgs/OccupancyGrid has it.

Unknown cells are solid: a car may drive only on floor that was seen free. It stops at unknown cells and at the map's
edge, and a ray ends there.
"""

from dataclasses import dataclass
from functools import cached_property
from math import cos, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1
# per cent: a cell of this probability or more is no floor to drive on
OCCUPIED_FROM: Final = 50
# cells; larger distances are not distinguished
REACH: Final = 32
# the same inside walls: a vehicle gets no deeper into a wall
WITHIN: Final = 8
ROWS_AT_ONCE: Final = 16

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Grid:
    """A floor of square cells."""

    cells: NDArray[np.int8]
    """(rows, columns): probability of being occupied in per cent, -1 if unknown; the first row has the lowest y."""
    resolution: float
    """Side of a cell, m."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of the first cell's lower left corner in the room, m and rad: the grid's axes."""

    @cached_property
    def solid(self) -> Bools:
        """The solid cells (rows + 2, columns + 2): the grid's, in a frame of solid cells."""
        return np.pad((self.cells < FREE) | (self.cells >= OCCUPIED_FROM), 1, constant_values=True)

    @cached_property
    def clear(self) -> NDArray[np.float32]:
        """Distances from each cell's centre to the nearest solid cell's centre, in cells, for `solid`; at most
        REACH.
        """
        return distances(self.solid, REACH)

    @cached_property
    def depth(self) -> NDArray[np.float32]:
        """Distances from each cell's centre to the nearest wall's face, m, for `solid`; negative inside a wall."""
        inside = distances(~self.solid, WITHIN)
        return (self.resolution * np.where(self.solid, 0.5 - inside, self.clear - 0.5)).astype(np.float32)

    def to_cells(self, x: Floats | float, y: Floats | float) -> tuple[Floats, Floats]:
        """Return columns and rows in `solid` of places in the room, m; whole numbers are the cells' lower corners."""
        x0, y0, yaw = self.origin
        dx, dy = np.asarray(x, float) - x0, np.asarray(y, float) - y0
        c, s = cos(yaw) / self.resolution, sin(yaw) / self.resolution
        with np.errstate(invalid="ignore"):
            return c * dx + s * dy + 1.0, c * dy - s * dx + 1.0

    def to_room(self, column: Floats | float, row: Floats | float) -> tuple[Floats, Floats]:
        """Return the places in the room, m, of columns and rows from `to_cells`."""
        x0, y0, yaw = self.origin
        u, v = self.resolution * (np.asarray(column, float) - 1.0), self.resolution * (np.asarray(row, float) - 1.0)
        c, s = cos(yaw), sin(yaw)
        return x0 + c * u - s * v, y0 + s * u + c * v

    def is_free(self, x: Floats | float, y: Floats | float) -> Bools:
        """Return whether places in the room, m, are on free floor."""
        column, row = (np.floor(each) for each in self.to_cells(x, y))
        rows, columns = self.solid.shape
        with np.errstate(invalid="ignore"):
            inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
            i, j = np.where(inside, column, 0).astype(int), np.where(inside, row, 0).astype(int)
        free: Bools = ~self.solid[j, i]
        return free


def distances(marked: Bools, reach: int) -> NDArray[np.float32]:
    """Return the distances (rows, columns) from each cell's centre to the nearest marked cell's, in cells, at
    most `reach`.

    First it finds the distances along the columns. Then each cell combines the distances of the cells in its row with
    their offsets, and takes the least (Felzenszwalb and Huttenlocher, Theory of Computing 8, 2012, section 2.1, without
    their envelope).
    """
    far = np.where(marked, 0, reach).astype(np.int16)
    for k in range(1, len(far)):
        np.minimum(far[k], far[k - 1] + 1, out=far[k])
    for k in range(len(far) - 2, -1, -1):
        np.minimum(far[k], far[k + 1] + 1, out=far[k])
    found = np.empty(far.shape, np.float32)
    # some rows at a time, so that they stay in the processor's cache
    for first in range(0, len(far), ROWS_AT_ONCE):
        squares = far[first : first + ROWS_AT_ONCE] ** 2
        best = squares.copy()
        for k in range(1, min(reach, far.shape[1] - 1) + 1):
            np.minimum(best[:, k:], squares[:, :-k] + np.int16(k * k), out=best[:, k:])
            np.minimum(best[:, :-k], squares[:, k:] + np.int16(k * k), out=best[:, :-k])
        np.sqrt(best, out=found[first : first + ROWS_AT_ONCE])
    return found
