"""The walls of a map, as a vehicle runs into them.

Between the cells' centres the distance to the nearest wall is interpolated. A wall's face is the line of distance 0: it
lies between free and solid cells, and is smooth along a slanting wall. A body's clearance is the least distance along
its outline. The search goes along the outline in steps of half a cell. Far from walls the steps are longer: the
interpolated distance changes by at most SLOPE a metre, which tells how far no wall can be nearer.
"""

from collections.abc import Sequence
from math import cos, floor, hypot, sin
from typing import Final, cast

import numpy as np

from txt1.errors import ConfigError
from txt1.maps.files import Map, read
from txt1.maps.grid import REACH
from txt1.maps.outlines import Outline, outlines
from txt1.model.vehicle import Geometry

SLOPE: Final = 2.0**0.5
# m: larger clearances need not be exact
PLENTY: Final = 0.1
# longest step beside a wall, cells
WALL_STEP: Final = 0.5


class Walls:
    """The walls of a map."""

    def __init__(self, map_: Map) -> None:
        self.name, self.grid = map_.name, map_.grid
        depth = self.grid.depth
        self._rows: int = depth.shape[0]
        self._columns: int = depth.shape[1]
        # plain Python reads a memoryview three times as fast as an array
        self._depth = cast("Sequence[float]", depth.ravel().data)
        self._x, self._y, yaw = self.grid.origin
        self._cos, self._sin = cos(yaw), sin(yaw)
        self.told = f"a wall of the map {self.name}"
        self._per_cell = 1.0 / self.grid.resolution

    @property
    def outlines(self) -> tuple[Outline, ...]:
        """The walls as closed lines, for screens."""
        return outlines(self.grid)

    def freest(self) -> tuple[float, float]:
        """The middle of the widest place, m: a good place to start."""
        row, column = np.unravel_index(int(self.grid.clear.argmax()), self.grid.clear.shape)
        x, y = self.grid.to_room(column + 0.5, row + 0.5)
        return round(float(x), 2), round(float(y), 2)

    def distance(self, x: float, y: float) -> float:
        """Return the distance from a place in the room to the nearest wall's face, m, up to 32 cells; negative
        within a wall.
        """
        dx, dy = x - self._x, y - self._y
        # from the centre of the frame's first cell, in cells; the frame is a cell wide
        u = (self._cos * dx + self._sin * dy) * self._per_cell + 0.5
        v = (self._cos * dy - self._sin * dx) * self._per_cell + 0.5
        columns = self._columns
        if not (0.0 <= u < columns - 1 and 0.0 <= v < self._rows - 1):
            # off the map: more negative with the distance
            away = max(-u, u - columns + 1.0, -v, v - self._rows + 1.0)
            return -(REACH + away) * self.grid.resolution
        i, j = floor(u), floor(v)
        a, b = u - i, v - j
        at, depth = j * columns + i, self._depth
        below = depth[at] + a * (depth[at + 1] - depth[at])
        above = depth[at + columns] + a * (depth[at + columns + 1] - depth[at + columns])
        return below + b * (above - below)

    def clearance(self, x: float, y: float, theta: float, body: Geometry) -> float:
        """Return the distance from a body's outline to the nearest wall, m; negative inside a wall; exact below
        PLENTY.
        """
        c, s = cos(theta), sin(theta)
        x, y = x + body.centre * c, y + body.centre * s
        least = self.distance(x, y) - SLOPE * hypot(0.5 * body.length, 0.5 * body.width)
        if least > PLENTY:
            return least
        # the sides: start, direction and length of each
        ax, ay = 0.5 * body.length * c, 0.5 * body.length * s
        bx, by = -0.5 * body.width * s, 0.5 * body.width * c
        sides = (
            (x + ax + bx, y + ay + by, -c, -s, body.length),
            (x - ax + bx, y - ay + by, s, -c, body.width),
            (x - ax - bx, y - ay - by, c, s, body.length),
            (x + ax - bx, y + ay - by, -s, c, body.width),
        )
        least = min(self.distance(px, py) for px, py, *_ in sides)
        step = WALL_STEP * self.grid.resolution
        for px, py, ux, uy, length in sides:
            along, here = 0.0, self.distance(px, py)
            while (along := along + max(step, (here - least) / SLOPE)) < length:
                here = self.distance(px + along * ux, py + along * uy)
                least = min(least, here)
        return least

    def roam(self, x: float, y: float, reach: float) -> float:
        """Return how far along x or y a body of radius `reach` can move from (x, y) free of walls, m; may be
        negative.
        """
        return (self.distance(x, y) / SLOPE - reach) / SLOPE


def walls_of(name: str) -> Walls:
    """Return the walls of a map, by its name or file; raises ConfigError, or MissingExtra if it is a PNG."""
    try:
        return Walls(read(name))
    except ConfigError as error:
        raise ConfigError(f"sim.room.map: {error}") from None
