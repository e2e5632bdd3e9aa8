"""Frontiers of a map in the making: the borders between free and unknown floor, and the poses to look at them from.

A frontier is a connected border, long enough to be worth a way (Yamauchi, "A frontier-based approach for autonomous
exploration", CIRA 1997). Floor beside walls is no part of it: the edge of a wall on the map is uncertain. The poses
that the car can reach are searched, the near ones first. Those from which it looks at a frontier, with nothing in
between, are views. The frontier is chosen by the cheapest view of any part of it, then the view by what it shows: the
part that is in sight from afar may be one cell beside a corner.
"""

from __future__ import annotations

from math import ceil, inf, pi
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label

from txt1.mapping.poses import Array
from txt1.mapping.seen_floor import OFF_WALLS, places_on
from txt1.maps.grid import FREE, OCCUPIED_FROM, UNKNOWN, Grid
from txt1.maps.rays import cast
from txt1.model.reeds_shepp import Pose
from txt1.model.vehicle import Geometry
from txt1.navigation.plan import MARGINS
from txt1.navigation.search import reachable
from txt1.sim.room import Room

FRONTIER_MIN: Final = 0.3
"""m, length of the shortest frontier: shorter ones are gaps between rays."""
SIGHT: Final = 2.0
"""m from a frontier from which the robot looks at it at most: farther away, rays are far apart."""
PAST: Final = (pi / 3.0, 2.0)
"""rad by which it may look past a frontier; the better first."""
LARGE: Final = 0.3
"""m of way that a metre of frontier is worth,"""
LARGEST: Final = 3.0
"""up to so many m of it."""
CLOSER_WORTH: Final = 1.2
"""m of way that a metre closer to the frontier is worth: it is seldom driven to its end."""
SQUARE: Final = np.ones((3, 3))
SAME_PLACE: Final = 0.5
"""m within which two frontiers are the same, and two places to look from."""
KNOWN_SHARE: Final = 0.3
"""Share of its unknown cells below which the floor behind a frontier is known."""

Places = tuple[tuple[float, float], ...]


class Frontier(NamedTuple):
    """A border between free and unknown floor."""

    middle: tuple[float, float]
    """Its cell nearest to the mean of its cells, m."""
    cells: Array
    """Places of all its cells (n, 2), m."""
    length: float
    """m."""
    beyond: Array
    """Places of the unknown cells beside it (n, 2), m."""
    vain: Places = ()
    """Where the robot has looked at it in vain, or whereto it could not drive, m."""

    def known(self, grid: Grid) -> bool:
        """Return whether most of the unknown cells are known now."""
        return float(np.mean(grid.cells.ravel()[places_on(grid, self.beyond)] == UNKNOWN)) < KNOWN_SHARE

    def gone(self, grid: Grid) -> bool:
        """Return whether no border is near its middle any more."""
        x, y = _middles(grid, border(grid))
        return not (np.hypot(x - self.middle[0], y - self.middle[1]) < SAME_PLACE).any()


class View(NamedTuple):
    """A pose from which the robot looks at a frontier."""

    pose: Pose
    """m and rad."""
    cost: float
    """m of way to the frontier, less its worth."""
    frontier: Frontier


def border(grid: Grid) -> NDArray[np.bool_]:
    """Return the free cells beside unknown ones, away from walls."""
    walls = binary_dilation(grid.cells >= OCCUPIED_FROM, SQUARE, ceil(OFF_WALLS / grid.resolution))
    return np.asarray((grid.cells >= FREE) & ~walls & binary_dilation(grid.cells == UNKNOWN))


def _middles(grid: Grid, cells: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return x and y of the cells' middles, m."""
    row, column = np.nonzero(cells)
    # the frame of solid cells is a cell wide
    return grid.to_room(column.astype(np.float64) + 1.5, row.astype(np.float64) + 1.5)


def frontiers(grid: Grid) -> list[Frontier]:
    """Return the frontiers of a grid."""
    every, count = label(border(grid), SQUARE)
    found = []
    for number in range(1, count + 1):
        x, y = _middles(grid, every == number)
        length = len(x) * grid.resolution
        if length < FRONTIER_MIN:
            continue
        nearest = int(np.argmin(np.hypot(x - x.mean(), y - y.mean())))
        beyond = _middles(grid, (grid.cells == UNKNOWN) & binary_dilation(every == number))
        found.append(
            Frontier((float(x[nearest]), float(y[nearest])), np.column_stack((x, y)), length, np.column_stack(beyond))
        )
    return found


def best_view(every: list[Frontier], pose: Pose, room: Room, body: Geometry, keep: float) -> View | None:
    """Return the cheapest pose from which the robot looks at most of the middle of the cheapest frontier, else at any
    part of it; None: it can reach none.

    The body keeps `keep` m from walls.
    """
    for past in PAST:
        part = _best(every, pose, room, body, keep, inf, past)
        if part is not None:
            return _best([part.frontier], pose, room, body, keep, SAME_PLACE, past) or part
    return None


def _best(
    every: list[Frontier], pose: Pose, room: Room, body: Geometry, keep: float, within: float, past: float
) -> View | None:
    """Return the cheapest pose from which it looks at one of the frontiers, as `_cheapest`."""
    best: View | None = None
    for narrow in (False, True):
        for poses, least in reachable(pose, room, body, MARGINS[0] * body.radius_min, keep, narrow):
            found = [view for each in every if (view := _cheapest(each, poses, room, within, past)) is not None]
            best = min([*found, *([best] if best else [])], key=lambda view: view.cost, default=None)
            if best is not None and best.cost < least - LARGE * LARGEST:
                break
        if best is not None:
            break
    return best


def _cheapest(frontier: Frontier, poses: Array, room: Room, within: float, past: float) -> View | None:
    """Return the cheapest of the poses (n, 4) that look at most of the cells behind the frontier `within` m of its
    middle, at most `past` rad past them; inf m: at any cell behind it. None: none does.

    The border of what a corner hides is in sight from where it was seen, and what is behind it is not.
    """
    assert room.walls is not None
    ends = frontier.beyond[np.hypot(*(frontier.beyond - frontier.middle).T) <= within]
    if not len(ends):
        return None
    most = 0.0 if within == inf else 1.0 - KNOWN_SHARE
    dx, dy = (ends[None] - poses[:, None, :2]).transpose(2, 0, 1)
    angles, ranges = np.arctan2(dy, dx), np.hypot(dx, dy)
    looking = (ranges < SIGHT) & (np.abs((angles - poses[:, 2:3] + pi) % (2.0 * pi) - pi) < past)
    for x, y in frontier.vain:
        looking[np.hypot(poses[:, 0] - x, poses[:, 1] - y) < SAME_PLACE] = False
    costs = poses[:, 3] + CLOSER_WORTH * ranges.min(axis=1) - LARGE * min(frontier.length, LARGEST)
    enough = np.flatnonzero(looking.mean(axis=1) > most)
    grid = room.walls.grid
    for k in enough[np.argsort(costs[enough], kind="stable")].tolist():
        x, y, theta, _ = poses[k].tolist()
        seen = looking[k] & (cast(grid, x, y, angles[k], SIGHT) > ranges[k] - 1.5 * grid.resolution)
        if seen.mean() > most:
            return View((x, y, theta), float(costs[k]), frontier)
    return None
