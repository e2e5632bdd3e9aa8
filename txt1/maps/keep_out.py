"""Areas of a map that a robot keeps out of: polygons, a tuple of corners (x, y) in m each."""

from __future__ import annotations

from math import ceil, hypot

import numpy as np
from numpy.typing import NDArray

from txt1.maps.grid import OCCUPIED, Grid

Area = tuple[tuple[float, float], ...]


def inside(area: Area, x: NDArray[np.float64] | float, y: NDArray[np.float64] | float) -> NDArray[np.bool_]:
    """Return whether places are inside an area: a line from there to the right meets an odd number of its edges."""
    found = np.zeros(np.broadcast(x, y).shape, np.bool_)
    for (x0, y0), (x1, y1) in zip(area, (*area[1:], area[0]), strict=True):
        if y0 != y1:
            crossed = (np.less_equal(y0, y) != np.less_equal(y1, y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
            found ^= crossed
    return found


def border(area: Area, gap: float) -> NDArray[np.float64]:
    """Return points (n, 2) on an area's border at most `gap` m apart."""
    parts = []
    for begin, end in zip(area, (*area[1:], area[0]), strict=True):
        count = max(1, ceil(hypot(end[0] - begin[0], end[1] - begin[1]) / gap))
        parts.append(np.linspace(begin, end, count, endpoint=False))
    return np.concatenate(parts)


def closed(grid: Grid, areas: tuple[Area, ...]) -> Grid:
    """Return a grid in which the areas' cells are walls."""
    if not areas:
        return grid
    cells = grid.cells.copy()
    # the frame of `to_room` is a cell wide
    rows, columns = np.indices(cells.shape).astype(np.float64)
    x, y = grid.to_room(columns + 1.5, rows + 1.5)
    for area in areas:
        low, high = np.min(area, axis=0), np.max(area, axis=0)
        near = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
        within = inside(area, x[near], y[near])
        cells[near] = np.where(within, OCCUPIED, cells[near])
        # a narrow area may lie between the centres of cells
        u, v = grid.to_cells(*border(area, 0.5 * grid.resolution).T)
        column, row = np.floor(u).astype(np.int64) - 1, np.floor(v).astype(np.int64) - 1
        there = (column >= 0) & (column < cells.shape[1]) & (row >= 0) & (row < cells.shape[0])
        cells[row[there], column[there]] = OCCUPIED
    return Grid(cells, grid.resolution, grid.origin)
