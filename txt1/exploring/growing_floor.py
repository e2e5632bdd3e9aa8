"""The floor of a map in the making, for the planner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.mapping.map_sensors import OnMap
from txt1.mapping.poses import Array, placed
from txt1.mapping.seen_floor import QuickGrid, before, below, places_on, with_walls_at
from txt1.mapping.topics import MapNews, MapSheet
from txt1.maps.files import Map
from txt1.maps.grid import FREE, UNKNOWN
from txt1.model.vehicle import Geometry
from txt1.sensors.base import Reading
from txt1.sim.room import Room
from txt1.sim.walls import Walls
from txt1.tasks.on_map import MapInUse, MapPose

ROUND: Final = 0.3
"""m round the robot's body that the user leaves free where it begins."""
COLUMN_CELLS: Final = 1 << 32
"""Cells are numbered column by column, with so many in a column."""


class GrowingFloor(MapInUse):
    """The map in the making as a map in use.

    The map has the floor before walls. Where it knows nothing, other floor counts as free, too: below the robot, where
    the laser does not see, and where the laser met nothing within its range. Where the robot began, so does the floor
    `ROUND` m round it: otherwise it could not turn away.
    """

    making = True

    def __init__(self, there: OnMap, body: Geometry) -> None:
        self._there, self._body = there, body
        # numbers of cells
        self._free: NDArray[np.int64] = np.empty(0, np.int64)
        self._about: tuple[float, ...] = ()
        self._room: tuple[MapSheet, NDArray[np.int64], Room] | None = None

    def heard(self, reading: Reading[MapNews]) -> None:
        """Take a result: note the floor that is free now."""
        sheet, found, pose = self._there.sheet, self._there.newest(), reading.value.pose
        about = tuple(round(each, 1) for each in pose)
        if sheet is None or found is None or about == self._about:
            return
        (laser, sweep), size, body = found, sheet.resolution, self._body
        if not self._about:
            body = replace(body, length=body.length + 2.0 * ROUND, width=body.width + 2.0 * ROUND)
        self._about = about
        places = np.concatenate((below(pose, body, size), placed(laser, before(sweep.free, size))))
        column, row = np.floor(places.T / size).astype(np.int64)
        self._free = np.union1d(self._free, column * COLUMN_CELLS + row)

    def pose(self) -> MapPose | None:
        """Return the robot's present pose; None while it is unknown."""
        return self._there.pose()

    def mapped(self) -> Room | None:
        """Return the floor of the map so far, None before the first map."""
        sheet, free = self._there.sheet, self._free
        if sheet is None:
            return None
        if self._room is None or self._room[0] is not sheet or self._room[1] is not free:
            cells = sheet.grid.cells.copy()
            flat, there = cells.ravel(), places_on(sheet.grid, self._places(sheet.resolution))
            flat[there] = np.where(flat[there] == UNKNOWN, FREE, flat[there])
            grid = QuickGrid(cells, sheet.resolution, sheet.origin)
            walls = Walls(Map("map", Path(), grid, ""))
            # what the map has was seen, and nothing looks back
            self._room = sheet, free, Room(walls=walls, behind=walls)
        return self._room[2]

    def floor(self, remembered: bool = True, lately: bool = False) -> Room | None:
        """Return this floor with what the newest scan shows on it, and nothing of earlier scans; None before the first
        map.
        """
        return with_walls_at(np.reshape(self.seen(), (-1, 2)), self.mapped())

    def seen(self) -> Sequence[tuple[float, float]]:
        """Return the places (m, on the map) of things seen near the robot that are not on the map."""
        return self._there.off(self.mapped())

    def _places(self, size: float) -> Array:
        """Return the middles of the free cells (n, 2), m."""
        row = (self._free + COLUMN_CELLS // 2) % COLUMN_CELLS - COLUMN_CELLS // 2
        return (np.column_stack(((self._free - row) // COLUMN_CELLS, row)) + 0.5) * size
