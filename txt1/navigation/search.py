"""Paths round walls: a search over the poses that a car reaches by short arcs in both gears.

How it works. Dijkstra's search from the goal over a lattice finds the distance of each place to the goal, for a point
that keeps half the car's width from walls. These distances guide a best-first search over poses (x, y, theta), each in
a cell of its own. Its steps are arcs of the planned radius and straight lines (hybrid A*: Dolgov, Thrun, Montemerlo and
Diebel, "Path planning for autonomous vehicles in unknown semi-structured environments", IJRR 29, 2010). From every few
poses it tries a Reeds-Shepp path to the goal. The search ends when no pose promises less than the cheapest path that
stays clear. The distances are weighted, so the path is good but not the best.

A car that stands in a narrow place may have no room for a whole step. A second search, `narrow`, begins with short
steps in small cells, as in a turn in several moves, and goes on with whole steps some way from the start.

The loops are in `txt1.navigation.ways`, compiled where numba is installed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import atan2, hypot, inf, pi
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.model.kinematics import move_along_arc, wrap_angle
from txt1.model.reeds_shepp import Path, Pose, Segment
from txt1.model.vehicle import Geometry
from txt1.navigation.ways import (
    GREED,
    LATTICE,
    NARROW_REACH,
    POSE_CELL,
    SMALL_CELL,
    SMALL_CELLS,
    SMALL_TURNS,
    TURNS,
    flat,
    grounds_of,
    loops,
)
from txt1.sim.room import Room, clearance
from txt1.sim.walls import Walls

# largest number of places of the lattice that are looked at: 4000 m^2
PLACES_MAX: Final = 400_000
# number of poses after which it gives up
POSES_MAX: Final = 6000
# the same of a search for all poses within reach, and of those between two looks at them
REACHABLE_MAX: Final = 40_000
EXPANSIONS_AT_ONCE: Final = 1000
# number of failed tries after which the next one waits for more poses
TRIES: Final = 10
# m: a robot that stands as close to a wall, by a pose that errs, may drive away from it,
LEAVES: Final = 0.06

Place = tuple[int, int]
Last = Callable[[Pose], Path | None]
Ends = tuple[float, ...]
_AROUND: Final = tuple((i, j, hypot(i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


class Lattice(NamedTuple):
    """The distances in m to a goal, of places `LATTICE` apart; inf: no way."""

    left: NDArray[np.float64]
    """(rows, columns)."""
    corner: Place
    """Place of the first column and row."""

    def at(self, place: Place) -> float:
        """Return the distance of a place by its key, from `place_of`."""
        column, row = place[0] - self.corner[0], place[1] - self.corner[1]
        rows, columns = self.left.shape
        return float(self.left[row, column]) if 0 <= row < rows and 0 <= column < columns else inf


def distances_to(
    goal: tuple[float, float], room: Room, body: Geometry, start: tuple[float, float], clear: float = 0.0
) -> Lattice:
    """Return the distances to the goal.

    The way of a point keeps half the car's width from walls, and `clear` m more except near the start and the goal.
    """
    assert room.walls is not None
    low, high = _extent(room.walls, goal, start)
    corner = place_of(*low)
    last = place_of(*high)
    columns, rows = last[0] - corner[0] + 1, last[1] - corner[1] + 1
    left = np.full((rows, columns), inf)
    grounds = grounds_of(room.walls, room.behind, (body.length, body.width, body.centre))
    loops().spread(grounds, clear, goal, start, flat(left), corner, columns, rows, PLACES_MAX)
    return Lattice(left, corner)


def _extent(walls: Walls, *points: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the corners of a map, m, and of places beside it."""
    rows, columns = walls.grid.solid.shape
    x, y = walls.grid.to_room(np.array([0, columns, 0, columns]), np.array([0, 0, rows, rows]))
    xs, ys = (np.array([*each, *more]) for each, more in zip((x, y), zip(*points, strict=True), strict=True))
    return (float(xs.min()), float(ys.min())), (float(xs.max()), float(ys.max()))


def place_of(x: float, y: float) -> Place:
    """Return the lattice's place nearest to a place in the room, m."""
    return int(np.floor(x / LATTICE + 0.5)), int(np.floor(y / LATTICE + 0.5))


def heading_at(start: Pose, goal: tuple[float, float], room: Room, body: Geometry) -> float:
    """Return the heading, rad, in which the shortest way round walls reaches a place, or a place near it with
    enough room.
    """
    back = distances_to(start[:2], room, body, goal)
    place = place_of(*goal)
    for _ in range(6):
        ways = [(far, other) for i, j, _ in _AROUND if (far := back.at(other := (place[0] + i, place[1] + j))) < inf]
        place = min(ways, default=(0.0, place))[1]
    dx, dy = goal[0] - LATTICE * place[0], goal[1] - LATTICE * place[1]
    along = atan2(dy, dx) if hypot(dx, dy) > LATTICE else start[2]
    # the nearest place with room to spare, else the place with most room
    turns = sorted((wrap_angle(k * pi / 8.0) for k in range(16)), key=abs)
    left = [(min(0.1, clearance(*goal, along + turn, room, body)), turn) for turn in turns]
    return wrap_angle(along + max(left, key=lambda each: each[0])[1])


def ends_of(
    start: Pose, goal: Pose | None, room: Room, body: Geometry, clear: float, keep: float = 0.0, seen: float = inf
) -> Ends:
    """Return the clearance required near the start and the goal, m, as `txt1.navigation.ways` reads it.

    There their own clearance is enough, at the goal at least `keep` m. So a goal close to a wall does not make the
    whole way narrow. Within `seen` m of the start the body may back up only where the floor was seen.
    """
    assert room.walls is not None
    begin = finish = inf
    if (there := room.walls.clearance(*start, body)) < max(LEAVES, keep):
        begin = max(there, -LEAVES) - 0.01
    if goal is not None and (there := room.walls.clearance(*goal, body)) < clear:
        finish = max(keep, there - 0.01)
    return tuple(float(each) for each in (*start[:2], begin, *(goal or start)[:2], finish, seen))


def stays_clear(start: Pose, path: Path, room: Room, body: Geometry, clear: float, ends: Ends) -> bool:
    """Return whether the body keeps `clear` m from a map's walls along a path; `ends` are from `ends_of`."""
    assert room.walls is not None
    grounds = grounds_of(room.walls, room.behind, (body.length, body.width, body.centre))
    free, pose = loops().arc_is_free, start
    for curvature, distance in path:
        if not free(grounds, ends, clear, *pose, curvature, distance):
            return False
        pose = move_along_arc(*pose, distance, curvature, 0.0)
    return True


def round_walls(
    start: Pose,
    goal: Pose,
    room: Room,
    body: Geometry,
    radius: float,
    clear: float,
    ends: Ends,
    last: Last,
    price: Callable[[Path], float],
    narrow: bool = False,
) -> Path | None:
    """Return a path between two poses, with arcs of radius `radius` m, whose body keeps `clear` m from walls;
    None if none was found.

    `ends` are from `ends_of`. `last` returns a path from a pose to the goal that stays clear, or None; `price` returns
    its cost. `narrow`: the search begins with short steps.
    """
    assert room.walls is not None
    lattice = distances_to(goal[:2], room, body, start[:2], clear)
    if lattice.at(place_of(*start[:2])) == inf:
        return None
    search = _begun(start, goal[:2], room, body, radius, clear, ends, lattice, narrow, POSES_MAX)
    node, tries = -1, 0
    best: Path | None = None
    least = inf
    while True:
        node = loops().advance(*search.arguments, 1 + tries // TRIES, node, POSES_MAX)
        if node < 0:
            return best
        x, y, theta, spent = search.poses[node].tolist()
        if spent + GREED * lattice.at(place_of(x, y)) >= least:
            return best
        end = last((x, y, theta))
        if end is not None and (found := spent + price(end)) < least:
            best, least = (*_unrolled(node, search.steps, search.parents), *end), found
        tries += 1


def reachable(
    start: Pose, room: Room, body: Geometry, radius: float, keep: float, narrow: bool = False
) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Yield the poses that a car can reach with arcs of radius `radius` m, keeping `keep` m from walls; the near first.

    Each time some poses (n, 4): x, y (m), theta (rad), and the cost of the way in m; and the least cost of all poses
    that are still to come. `narrow`: as `round_walls`.
    """
    assert room.walls is not None
    corner = _extent(room.walls, start[:2])[0]
    # a corner of the map is never reached, so the distances go everywhere
    lattice = distances_to(start[:2], room, body, corner, keep)
    # no direction is better than another
    lattice = Lattice(np.where(lattice.left < inf, 0.0, inf), lattice.corner)
    ends = ends_of(start, None, room, body, keep, keep)
    search = _begun(start, start[:2], room, body, radius, keep, ends, lattice, narrow, REACHABLE_MAX)
    done = told = 0
    node = loops().advance(*search.arguments, REACHABLE_MAX, -1, REACHABLE_MAX)
    while search.counts[1] or node >= 0:
        done += EXPANSIONS_AT_ONCE
        node = loops().advance(*search.arguments, REACHABLE_MAX, node, min(done, REACHABLE_MAX))
        until = int(search.counts[0])
        yield search.poses[told:until], float(search.keys[0]) if search.counts[1] else inf
        told = until
        if done >= REACHABLE_MAX:
            return


class _Search(NamedTuple):
    """A search that has begun; the arrays are those of `txt1.navigation.ways.advance`."""

    arguments: tuple[Any, ...]
    poses: NDArray[np.float64]
    """(n, 4)."""
    steps: NDArray[np.float64]
    parents: NDArray[np.int64]
    keys: NDArray[np.float64]
    counts: NDArray[np.int64]


def _begun(
    start: Pose,
    goal: tuple[float, float],
    room: Room,
    body: Geometry,
    radius: float,
    clear: float,
    ends: Ends,
    lattice: Lattice,
    narrow: bool,
    most: int,
) -> _Search:
    """Begin a search that looks at `most` poses at most."""
    assert room.walls is not None
    (x0, y0), (x1, y1) = _extent(room.walls, start[:2], goal)
    columns, rows = int((x1 - x0) / POSE_CELL) + 1, int((y1 - y0) / POSE_CELL) + 1
    squares = (
        x0,
        y0,
        float(columns),
        float(rows),
        start[0] - NARROW_REACH - SMALL_CELL,
        start[1] - NARROW_REACH - SMALL_CELL,
    )
    size = 6 * most + 1
    poses, steps, keys = np.zeros((size, 4)), np.zeros(2 * size), np.zeros(size)
    parents, heap = np.full(size, -1, np.int64), np.zeros(size, np.int64)
    counts = np.array([1, 1, 0, 0], np.int64)
    poses[0, :3] = start
    cells = columns * rows * TURNS + SMALL_CELLS * SMALL_CELLS * SMALL_TURNS
    arguments = (
        grounds_of(room.walls, room.behind, (body.length, body.width, body.centre)),
        ends,
        clear,
        1.0 / radius,
        narrow,
        flat(lattice.left),
        lattice.corner,
        lattice.left.shape[1],
        lattice.left.shape[0],
        squares,
        *(flat(each) for each in (poses, steps, parents, keys, heap, np.zeros(2 * cells, np.uint8), counts)),
    )
    return _Search(arguments, poses, steps, parents, keys, counts)


def _unrolled(node: int, steps: NDArray[np.float64], parents: NDArray[np.int64]) -> list[Segment]:
    """Return the steps to a node from the start; consecutive steps on the same arc become a single segment."""
    chain: list[Segment] = []
    while node > 0:
        chain.append(Segment(float(steps[2 * node]), float(steps[2 * node + 1])))
        node = int(parents[node])
    found: list[Segment] = []
    for step in reversed(chain):
        before = found[-1] if found else None
        if (
            before is not None
            and before.curvature == step.curvature
            and (before.distance > 0.0) == (step.distance > 0.0)
        ):
            found[-1] = Segment(step.curvature, before.distance + step.distance)
        else:
            found.append(step)
    return found
