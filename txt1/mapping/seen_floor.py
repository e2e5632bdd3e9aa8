"""The floor that a robot has seen in this drive: obstacles that the map lacks, and places for backing up.

How it works
------------

A laser looks ahead. So the floor that it has seen is kept in cells as large as the map's. A ray makes the cells that it
passes free, and the cell in which it ends solid. A ray that passes a solid cell clears it only in part: several rays
clear it, a single wrong ray does not. Cells under the robot are free. All other cells count as unseen, whatever the map
says of them.

Somebody who walked by stays as a wall where no ray clears the cells. So where no way is left, a plan may leave out
what is not seen now.

A plan uses floor made of both. Its walls are the map's walls and the boxes seen away from them (`Room.walls`). A place
that the map does not know is floor if it was seen free. A robot that backs up sees nothing, so for driving backward all
unseen floor is a wall, too (`Room.behind`). An obstacle that came there later stays unknown: the laser does not look
there. So plans first try to back up only over floor that was seen lately.
"""

from __future__ import annotations

from functools import cached_property
from math import ceil, inf
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.mapping.poses import Array, placed
from txt1.maps.files import Map
from txt1.maps.grid import FREE, OCCUPIED, OCCUPIED_FROM, REACH, UNKNOWN, WITHIN, Grid
from txt1.model.vehicle import Geometry
from txt1.sim.room import Room
from txt1.sim.walls import Walls

RAY_MAX: Final = 2.5
"""m of a ray that count: farther away, an error of the heading would put walls on free floor."""
RAYS_STEP: Final = 2
"""One of this number of rays is used: at RAY_MAX, the rays of a usual laser are closer together than cells."""
CLEARS: Final = 20
"""Per cent of being solid that a ray removes from a cell that it passes."""
LATELY: Final = 10.0
"""s for which nobody is expected to come to floor that was seen free."""
OFF_WALLS: Final = 0.15
"""m from the walls of the map beyond which something is no part of the walls."""


class QuickGrid(Grid):
    """A grid whose walls change all the time: SciPy computes its distances a hundred times as fast."""

    @cached_property
    def depth(self) -> NDArray[np.float32]:
        """As `Grid.depth`."""
        from scipy.ndimage import distance_transform_edt

        outside = np.minimum(distance_transform_edt(~self.solid), REACH)
        inside = np.minimum(distance_transform_edt(self.solid), WITHIN)
        depth: NDArray[np.float32] = self.resolution * np.where(self.solid, 0.5 - inside, outside - 0.5)
        return depth.astype(np.float32)


def with_walls_at(points: Array, room: Room | None) -> Room | None:
    """Return a room of a map with walls at these places (n, 2), m, too; a room without a map stays as it is."""
    if room is None or room.walls is None or not len(points):
        return room

    def marked(walls: Walls) -> Walls:
        grid = walls.grid
        cells = grid.cells.copy()
        cells.ravel()[places_on(grid, points)] = OCCUPIED
        return Walls(Map(walls.name, Path(), type(grid)(cells, grid.resolution, grid.origin), ""))

    behind = None if room.behind is None else marked(room.behind)
    return room._replace(walls=marked(room.walls), behind=behind)


def below(pose: tuple[float, float, float], body: Geometry, resolution: float) -> Array:
    """Return places (n, 2), m, on the floor below a body at a pose: at least one in each cell."""
    # closer together than cells, so that no cell is left out
    gap = 0.5 * resolution
    x = np.linspace(-0.5, 0.5, ceil(body.length / gap) + 1) * body.length + body.centre
    y = np.linspace(-0.5, 0.5, ceil(body.width / gap) + 1) * body.width
    return placed(pose, np.column_stack((np.tile(x, len(y)), np.repeat(y, len(x)))))


def before(points: Array, resolution: float) -> Array:
    """Return places (n, 2) on the rays from the origin to points, a cell apart, up to half a cell before their ends."""
    ranges = np.hypot(points[:, 0], points[:, 1])
    steps = resolution * np.arange(ceil(RAY_MAX / resolution))
    ray, step = np.nonzero(steps < (ranges - 0.5 * resolution)[:, None])
    with np.errstate(invalid="ignore"):
        along = points / ranges[:, None]
    return np.asarray(along[ray] * steps[step, None])


def places_on(grid: Grid, points: Array) -> NDArray[np.int64]:
    """Return the indices in the flat cells of a grid of those points (n, 2), m, that are on it."""
    rows, columns = grid.cells.shape
    # the frame of solid cells, which `to_cells` counts
    u, v = grid.to_cells(points[:, 0], points[:, 1])
    column, row = np.floor(u).astype(np.int64) - 1, np.floor(v).astype(np.int64) - 1
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    places: NDArray[np.int64] = row[inside] * columns + column[inside]
    return places


class SeenFloor:
    """The floor of a map, as seen in this drive."""

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self.cells: NDArray[np.int8] = np.full(grid.cells.shape, UNKNOWN, np.int8)
        """As `Grid.cells`; -1 is floor not seen."""
        # s, when each cell was seen last
        self._times = np.full(grid.cells.size, -np.inf)
        self._off_walls = grid.depth[1:-1, 1:-1] > OFF_WALLS
        self._under: tuple[float, ...] = ()
        self._below: NDArray[np.int64] = np.empty(0, np.int64)

    def see(self, laser: Array, points: Array, time: float) -> None:
        """Take a scan of a time, s: the ends of its rays, m, in the frame of the laser's pose (x, y, theta) on the
        map.
        """
        points = points[::RAYS_STEP]
        passed = places_on(self._grid, placed(laser, before(points, self._grid.resolution)))
        cells = self.cells.ravel()
        cells[passed] = np.maximum(cells[passed] - CLEARS, FREE)
        self._times[passed] = time
        cells[places_on(self._grid, placed(laser, points[np.hypot(*points.T) < RAY_MAX]))] = OCCUPIED

    def stand(self, pose: tuple[float, float, float], body: Geometry, time: float) -> None:
        """Mark the floor below a body at a pose as free at a time, s."""
        about = tuple(round(each, 2) for each in pose)
        if about != self._under:
            self._under, self._below = about, places_on(self._grid, below(pose, body, self._grid.resolution))
            self.cells.ravel()[self._below] = FREE
        self._times[self._below] = time

    def floor(self, now: Array, remembered: bool = True, since: float = -inf) -> Room:
        """Return the floor for planning; `now` are places (n, 2) in m of present obstacles, whatever was seen
        before. With `remembered` False, obstacles seen before may have gone: their places count as not seen. For
        driving backward, floor seen before `since` s does not count as seen.
        """
        seen = self.cells.copy()
        if not remembered:
            seen[seen >= OCCUPIED_FROM] = UNKNOWN
        seen.ravel()[places_on(self._grid, now)] = OCCUPIED
        cells = np.where((self._grid.cells == UNKNOWN) & (seen == FREE), FREE, self._grid.cells)
        cells[(seen >= OCCUPIED_FROM) & self._off_walls] = OCCUPIED
        old = self._times.reshape(seen.shape) < since
        backward = np.where((seen == UNKNOWN) | old & (seen < OCCUPIED_FROM), UNKNOWN, cells).astype(np.int8)
        return Room(walls=self._walls(cells.astype(np.int8)), behind=self._walls(backward))

    def _walls(self, cells: NDArray[np.int8]) -> Walls:
        return Walls(Map("map", Path(), QuickGrid(cells, self._grid.resolution, self._grid.origin), ""))
