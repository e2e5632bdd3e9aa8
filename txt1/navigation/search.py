"""Paths round walls: a search over the poses that a car reaches by short arcs in both gears.

How it works. Dijkstra's search from the goal over a lattice finds the distance of each place to the goal, for a point
that keeps half the car's width from walls. These distances guide a best-first search over poses (x, y, theta), each in
a cell of its own. Its steps are arcs of the planned radius and straight lines (hybrid A*: Dolgov, Thrun, Montemerlo and
Diebel, "Path planning for autonomous vehicles in unknown semi-structured environments", IJRR 29, 2010). From every few
poses it tries a Reeds-Shepp path to the goal. The first path that stays clear ends the search. The distances are
weighted, so the path is good but not the best.

A car that stands in a narrow place may have no room for a whole step. A second search, `narrow`, begins with short
steps in small cells, as in a turn in several moves, and goes on with whole steps some way from the start.
"""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from math import atan2, cos, floor, hypot, inf, pi, sin
from typing import Any, Final

from txt1.model.kinematics import move_along_arc, wrap_angle
from txt1.model.reeds_shepp import Path, Pose, Segment
from txt1.model.vehicle import Geometry
from txt1.sim.room import Room, clearance
from txt1.sim.walls import Walls

# m between two places of the lattice
LATTICE: Final = 0.1
# largest number of places of the lattice: 4000 m^2
PLACES_MAX: Final = 400_000
# m, side of a cell of poses
CELL: Final = 0.2
# rad, the same
TURN: Final = pi / 9.0
# length of a step, m: longer than a cell's diagonal, so that it leaves the cell
STEP: Final = 0.3
# m of a step between two checks of the body
LOOK: Final = 0.05
# m from the start within which a search in a narrow place takes short steps:
NARROW: Final = 0.8
# their length, m, longer than a diagonal of
SHORT_STEP: Final = 0.1
# m, side of a cell of poses there, and
SMALL_CELL: Final = 0.06
# rad, the same
SMALL_TURN: Final = pi / 36.0
# weight of a metre to the goal, relative to a metre driven
GREED: Final = 1.5
# cost of a metre backward, relative to a metre forward
BACKWARD: Final = 1.3
# m, the cost of a change of gear: a change takes time
CHANGE: Final = 0.5
# m, the additional cost of a step at full lock
BEND: Final = 0.03
# number of poses after which it gives up
POSES_MAX: Final = 6000
# m by which a body may overlap floor that was not seen: the floor seen comes in cells
UNSEEN: Final = 0.03
# m: a robot that stands as close to a wall, by a pose that errs, may drive away from it,
LEAVES: Final = 0.06
# m long, as long as it does not come closer; for the same length it may approach a goal that is close to a wall
LEAVING: Final = 0.4
# m from the goal within which a path to it is tried from each pose; elsewhere only from one of this number:
NEAR: Final = 2.0
EVERY: Final = 10

Place = tuple[int, int]
Way = tuple[Segment, Any] | None
"""The last step of a way, and the way before it."""
Last = Callable[[Pose], Path | None]
_AROUND: Final = tuple((i, j, hypot(i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


def distances_to(
    goal: tuple[float, float], room: Room, body: Geometry, start: tuple[float, float], clear: float = 0.0
) -> dict[Place, float]:
    """Return the distance in m to the goal of each place of the lattice, by the keys of `place_of`; start
    missing: no way.

    The way of a point keeps half the car's width from walls, and `clear` m more except near the start and the goal.
    """
    walls = room.walls
    assert walls is not None

    def is_free(place: Place) -> bool:
        x, y = LATTICE * place[0], LATTICE * place[1]
        room_there = walls.distance(x, y) - 0.5 * body.width
        return room_there > clear or (
            room_there > 0.0 and min(hypot(x - goal[0], y - goal[1]), hypot(x - start[0], y - start[1])) < LEAVING
        )

    first, end = place_of(*goal), place_of(*start)
    found: dict[Place, float] = {}
    best = {first: 0.0}
    heap = [(0.0, first)]
    enough = inf
    while heap and len(found) < PLACES_MAX:
        far, place = heappop(heap)
        if place in found:
            continue
        if far > enough:
            break
        found[place] = far
        if place == end:
            # places farther away would be detours
            enough = far + 3.0
        for i, j, step in _AROUND:
            other = place[0] + i, place[1] + j
            there = far + LATTICE * step
            if there < best.get(other, inf) and (other == end or is_free(other)):
                best[other] = there
                heappush(heap, (there, other))
    return found


def place_of(x: float, y: float) -> Place:
    """Return the lattice's place nearest to a place in the room, m."""
    return round(x / LATTICE), round(y / LATTICE)


def heading_at(start: Pose, goal: tuple[float, float], room: Room, body: Geometry) -> float:
    """Return the heading, rad, in which the shortest way round walls reaches a place, or a place near it with
    enough room.
    """
    back = distances_to(start[:2], room, body, goal)
    place = place_of(*goal)
    for _ in range(6):
        ways = [(back[other], other) for i, j, _ in _AROUND if (other := (place[0] + i, place[1] + j)) in back]
        place = min(ways, default=(0.0, place))[1]
    dx, dy = goal[0] - LATTICE * place[0], goal[1] - LATTICE * place[1]
    along = atan2(dy, dx) if hypot(dx, dy) > LATTICE else start[2]
    # the nearest place with room to spare, else the place with most room
    turns = sorted((wrap_angle(k * pi / 8.0) for k in range(16)), key=abs)
    left = [(min(0.1, clearance(*goal, along + turn, room, body)), turn) for turn in turns]
    return wrap_angle(along + max(left, key=lambda each: each[0])[1])


def round_walls(
    start: Pose, goal: Pose, room: Room, body: Geometry, radius: float, clear: float, last: Last, narrow: bool = False
) -> Path | None:
    """Return a path between two poses, with arcs of radius `radius` m, whose body keeps `clear` m from walls;
    None if none was found.

    `last` returns a path from a pose to the goal that stays clear, or None. `narrow`: the search begins with short
    steps.
    """
    left = distances_to(goal[:2], room, body, start[:2], clear)
    if place_of(*start[:2]) not in left:
        return None
    keeps = near_walls(start, goal, room, body, clear)
    steps = [(bend / radius, gear) for gear in (1.0, -1.0) for bend in (0.0, 1.0, -1.0)]
    number = count()
    # the path of a pose is the chain of steps to it
    heap: list[tuple[float, int, float, Pose, Way]] = [(0.0, 0, 0.0, start, None)]
    closed: set[tuple[int, int, int, bool, bool]] = set()

    def is_close(pose: Pose) -> bool:
        return narrow and hypot(pose[0] - start[0], pose[1] - start[1]) < NARROW

    for looked in range(POSES_MAX):
        pose, way, spent = None, None, 0.0
        while heap:
            _, _, spent, pose, way = heappop(heap)
            cell = _cell(pose, way is None or way[0].distance > 0.0, is_close(pose))
            if cell not in closed:
                closed.add(cell)
                break
            pose = None
        if pose is None:
            return None
        short = is_close(pose)
        if looked % EVERY == 0 or (not short and left.get(place_of(*pose[:2]), inf) < NEAR):
            end = last(pose)
            if end is not None:
                return (*_unrolled(way), *end)
        step = SHORT_STEP if short else STEP
        for curvature, gear in steps:
            after = _after(pose, curvature, gear * step, room, body, keeps(pose))
            if after is None or (far := left.get(place_of(*after[:2]))) is None:
                continue
            if _cell(after, gear > 0.0, is_close(after)) in closed:
                continue
            changed = way is not None and (way[0].distance > 0.0) is not (gear > 0.0)
            price = step * (1.0 if gear > 0.0 else BACKWARD) + CHANGE * changed + BEND * (curvature != 0.0)
            total = spent + price
            segment = Segment(curvature, gear * step)
            heappush(heap, (total + GREED * far, next(number), total, after, (segment, way)))
    return None


def _after(pose: Pose, curvature: float, step: float, room: Room, body: Geometry, clear: float) -> Pose | None:
    """Return the pose after a step, m; None if the body comes too close to a wall."""
    pieces = round(abs(step) / LOOK)
    after = move_along_arc(*pose, step, curvature, 0.0)
    # the end first: most steps that touch a wall touch it there
    for k in (pieces, *range(1, pieces)):
        if not stands_free(move_along_arc(*pose, step * k / pieces, curvature, 0.0), step, room, body, clear):
            return None
    return after


def near_walls(start: Pose, goal: Pose | None, room: Room, body: Geometry, clear: float) -> Callable[[Pose], float]:
    """Return a function from a pose to the clearance required there, m: `clear`, but less near the start and the goal.

    At the start and the goal their own clearance is enough. So a goal close to a wall does not make the whole way
    narrow.
    """
    walls = room.walls
    ends: list[tuple[Pose, float]] = []
    if walls is not None and (there := walls.clearance(*start, body)) < LEAVES:
        ends.append((start, max(there, -LEAVES) - 0.01))
    if walls is not None and goal is not None and (there := walls.clearance(*goal, body)) < clear:
        ends.append((goal, max(0.0, there - 0.01)))

    def keeps(pose: Pose) -> float:
        near = (least for end, least in ends if hypot(pose[0] - end[0], pose[1] - end[1]) < LEAVING)
        return min((clear, *near))

    return keeps if ends else lambda pose: clear


def stands_free(pose: Pose, gear: float, room: Room, body: Geometry, clear: float) -> bool:
    """Return whether a body keeps `clear` m from walls; in reverse (gear < 0) also from floor that was not seen
    free.
    """
    if room.walls is not None and not _has_room(pose, room.walls, body, clear):
        return False
    if gear < 0.0 and room.behind is not None and not _has_room(pose, room.behind, body, -UNSEEN):
        return False
    return room.walls is not None or clearance(*pose, room, body) >= clear


def _has_room(pose: Pose, walls: Walls, body: Geometry, clear: float) -> bool:
    """Return whether the body is `clear` m from a map's walls: three circles decide most negative cases first."""
    x, y, theta = pose
    c, s = cos(theta), sin(theta)
    least = 0.5 * body.width + clear
    reach = 0.5 * max(0.0, body.length - body.width)
    for along in (body.centre, body.centre + reach, body.centre - reach):
        if walls.distance(x + along * c, y + along * s) < least:
            return False
    return walls.clearance(x, y, theta, body) >= clear


def _cell(pose: Pose, forward: bool, small: bool) -> tuple[int, int, int, bool, bool]:
    x, y, theta = pose
    side, turn = (SMALL_CELL, SMALL_TURN) if small else (CELL, TURN)
    return floor(x / side), floor(y / side), floor(wrap_angle(theta) / turn), forward, small


def _unrolled(way: Way) -> list[Segment]:
    """Return the steps of a way from its start; consecutive steps on the same arc become a single segment."""
    steps: list[Segment] = []
    while way is not None:
        steps.append(way[0])
        way = way[1]
    found: list[Segment] = []
    for step in reversed(steps):
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
