"""Paths round walls: a search over the poses that a car reaches by short arcs in both gears.

How it works. Dijkstra's search from the goal over a lattice of places tells how far each is from it, for a point that
keeps half the car's width from walls. These distances lead a best-first search over poses (x, y, theta), each in a
cell of its own, whose steps are arcs of the planned radius and straight lines (hybrid A*: Dolgov, Thrun, Montemerlo and
Diebel, "Path planning for autonomous vehicles in unknown semi-structured environments", IJRR 29, 2010). Every few poses
it is tried whether a Reeds-Shepp path leads on to the goal; the first that stays clear ends the search. The distances
are weighted, so the path is a good one and not the best.

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
# of the lattice that are looked at: 4000 m^2
PLACES_MAX: Final = 400_000
# m, side of a cell of poses
CELL: Final = 0.2
# rad likewise
TURN: Final = pi / 9.0
# m of a step: longer than a cell's diagonal, so that it leaves it
STEP: Final = 0.3
# m of a step after which the body is looked at again
LOOK: Final = 0.05
# m from the start within which a search in a narrow place takes short steps:
NARROW: Final = 0.8
# m of these, longer than a diagonal of
SHORT_STEP: Final = 0.1
# m, side of a cell of poses there, and
SMALL_CELL: Final = 0.06
# rad likewise
SMALL_TURN: Final = pi / 36.0
# what a metre to the goal is worth, to a metre driven
GREED: Final = 1.5
# what a metre backward is worth, to one forward
BACKWARD: Final = 1.3
# m that a change of gear is worth: one costs time
CHANGE: Final = 0.5
# m that a step at full lock is worth more
BEND: Final = 0.03
# that are looked at before it gives up
POSES_MAX: Final = 6000
# m by which a body may stick into floor that was not seen: what was seen comes in cells
UNSEEN: Final = 0.03
# m: a robot that stands as close to a wall, by a pose that errs, may drive away from it,
LEAVES: Final = 0.06
# m long, as long as it does not come closer; and so long it may come up to a goal that is close to one
LEAVING: Final = 0.4
# m from the goal within which each pose is tried, and else every so many:
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
    """Metres to the goal from the places of the lattice round it, `place_of` their keys; start not in it: no way.

    A point keeps half the car's width from walls, and `clear` m more but near the start and the goal.
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
            # places farther off than that are detours
            enough = far + 3.0
        for i, j, step in _AROUND:
            other = place[0] + i, place[1] + j
            there = far + LATTICE * step
            if there < best.get(other, inf) and (other == end or is_free(other)):
                best[other] = there
                heappush(heap, (there, other))
    return found


def place_of(x: float, y: float) -> Place:
    """The place of the lattice nearest to one in the room, m."""
    return round(x / LATTICE), round(y / LATTICE)


def heading_at(start: Pose, goal: tuple[float, float], room: Room, body: Geometry) -> float:
    """The heading, rad, with which the shortest way round walls comes to a place, or near it if the body needs that."""
    back = distances_to(start[:2], room, body, goal)
    place = place_of(*goal)
    for _ in range(6):
        ways = [(back[other], other) for i, j, _ in _AROUND if (other := (place[0] + i, place[1] + j)) in back]
        place = min(ways, default=(0.0, place))[1]
    dx, dy = goal[0] - LATTICE * place[0], goal[1] - LATTICE * place[1]
    along = atan2(dy, dx) if hypot(dx, dy) > LATTICE else start[2]
    # the nearest with room to spare, else the one with most
    turns = sorted((wrap_angle(k * pi / 8.0) for k in range(16)), key=abs)
    left = [(min(0.1, clearance(*goal, along + turn, room, body)), turn) for turn in turns]
    return wrap_angle(along + max(left, key=lambda each: each[0])[1])


def round_walls(
    start: Pose, goal: Pose, room: Room, body: Geometry, radius: float, clear: float, last: Last, narrow: bool = False
) -> Path | None:
    """A path between two poses whose body keeps `clear` m from walls, its arcs of so many m; None: none was found.

    `last` returns a path from a pose to the goal that stays clear, None where there is none; `narrow` says whether it
    begins with short steps.
    """
    left = distances_to(goal[:2], room, body, start[:2], clear)
    if place_of(*start[:2]) not in left:
        return None
    keeps = near_walls(start, goal, room, body, clear)
    steps = [(bend / radius, gear) for gear in (1.0, -1.0) for bend in (0.0, 1.0, -1.0)]
    number = count()
    # a pose's path is the chain of steps that led to it
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
    """The pose after a step, m; None where the body comes too close to a wall on it."""
    pieces = round(abs(step) / LOOK)
    after = move_along_arc(*pose, step, curvature, 0.0)
    # the end first: most steps that touch a wall touch it there
    for k in (pieces, *range(1, pieces)):
        if not stands_free(move_along_arc(*pose, step * k / pieces, curvature, 0.0), step, room, body, clear):
            return None
    return after


def near_walls(start: Pose, goal: Pose | None, room: Room, body: Geometry, clear: float) -> Callable[[Pose], float]:
    """What a body must keep from walls at a pose, m: `clear`, but near the start and near the goal no more than there.

    So a goal close to a wall does not make the whole way a narrow one.
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
    """Whether a body keeps `clear` m from walls; whoever backs up (gear < 0) stays on floor that was seen free, too."""
    if room.walls is not None and not _has_room(pose, room.walls, body, clear):
        return False
    if gear < 0.0 and room.behind is not None and not _has_room(pose, room.behind, body, -UNSEEN):
        return False
    return room.walls is not None or clearance(*pose, room, body) >= clear


def _has_room(pose: Pose, walls: Walls, body: Geometry, clear: float) -> bool:
    """Whether the body is `clear` m from a map's walls: three circles in it first, as they tell most that is not."""
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
    """The steps of a way from its start, those of one arc as one segment."""
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
