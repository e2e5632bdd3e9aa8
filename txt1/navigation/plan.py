"""Paths for a car in a room: the shortest Reeds-Shepp path on which the body stays clear of the walls."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import groupby, product
from math import ceil, inf, isfinite, pi
from typing import Final

from txt1.errors import Txt1Error
from txt1.model.kinematics import move_along_arc
from txt1.model.reeds_shepp import Path, Pose, Segment, length, paths
from txt1.model.vehicle import Geometry
from txt1.navigation.search import near_walls, round_walls, stands_free
from txt1.sim.room import Room, clearance

# planned radii over R_min: the first leaves room for corrections, the second is used if there is no path otherwise
MARGINS: Final = (1.1, 1.35)
# m that the body keeps from the walls: the largest for which there is a path
ROOMS: Final = (0.06, 0.03, 0.0)
BACKWARD: Final = "; backward, the robot drives only where the laser has seen free floor in this drive"
# the same for a map's walls, which are as uncertain as the pose
BY_WALLS: Final = (0.12, 0.06, 0.03, 0.0)
# m of path, the cost of a change of gear
GEAR_CHANGE: Final = 0.1
# m; a shorter stretch in one gear ends before the steering has turned
SHORT: Final = 0.15
# m of path, the cost of such a stretch
SHORT_STRETCH: Final = 0.3
# m of path between two checks of the body
LOOK_EVERY: Final = 0.05
# m that a correction keeps from a map's walls: more than the error of a pose on a map
CORRECTS: Final = 0.06
# m of straight path before the goal of a correction
RUN_UP: Final = 0.4
# places along each side of a grid for paths in two parts
VIA: Final = 3


class NoPath(Txt1Error):
    """The car cannot reach the goal without touching a wall.

    >>> raise NoPath((2.4, 0.0, 0.0))
    Traceback (most recent call last):
    txt1.navigation.plan.NoPath: no path leads to (2.40 m, 0.00 m, 0 deg) inside the room: choose a goal farther from the walls
    """  # noqa: E501

    def __init__(self, goal: Pose, room: Room | None = None) -> None:
        x, y, theta = goal
        super().__init__(
            f"no path leads to ({x:.2f} m, {y:.2f} m, {theta * 180 / pi:.0f} deg) inside the room: "
            "choose a goal farther from the walls" + ("" if room is None or room.behind is None else BACKWARD)
        )


def plan(start: Pose, goal: Pose, room: Room | None = None, body: Geometry | None = None) -> Path:
    """Return the path from one pose to another; room None: no walls.

    It is the cheapest Reeds-Shepp path inside the room, by length and gear changes. If all of them touch a wall, it is
    the cheapest path over a place in between. On a map, Reeds-Shepp paths and ways round walls are tried with each
    margin to the walls, the largest margin first. Raises NoPath: every path touches a wall.
    """
    body = Geometry() if body is None else body
    if room is not None and clearance(*goal, room, body) < 0.0:
        raise NoPath(goal)
    if room is not None and room.walls is not None:
        # a way round a box with some room is better than a way that brushes it; the search in narrow places is slow, so
        # it is last
        tries = [*product(BY_WALLS, (_cheapest_inside, _round_walls)), *product(BY_WALLS, (_out_of_narrow,))]
    else:
        tries = [(keep_clear, search) for search in (_cheapest_inside, _over_a_place) for keep_clear in ROOMS]
    for keep_clear, search in tries:
        path = search(start, goal, room, body, keep_clear)
        if path is not None:
            return path
    raise NoPath(goal, room)


def cost(path: Path) -> float:
    """Return the cost of a path: its length, m, and the costs of gear changes and short stretches."""
    parts = stretches(path)
    short = sum(length(part) < SHORT for part in parts)
    return length(path) + GEAR_CHANGE * (len(parts) - 1) + SHORT_STRETCH * short


def stretches(path: Path) -> list[Path]:
    """Return the parts of a path that are driven in one gear."""
    return [tuple(part) for _, part in groupby(path, key=lambda segment: segment.distance > 0.0)]


def stays_inside(
    start: Pose, path: Path, room: Room | None, body: Geometry, keep_clear: float = 0.0, goal: Pose | None = None
) -> bool:
    """Return whether the body keeps `keep_clear` m from the walls along a path, checked every 5 cm.

    Near a `goal` that is closer to a map's wall, the goal's own distance is enough.
    """
    if room is None or not (isfinite(room.length) or isfinite(room.width) or room.walls is not None):
        return True
    keeps = near_walls(start, goal, room, body, keep_clear)
    return all(stands_free(pose, gear, room, body, keeps(pose)) for pose, gear in _with_gear(start, path))


def along(start: Pose, path: Path, every: float) -> Iterator[Pose]:
    """Yield poses along a path at most `every` m apart, including its end and the ends of its segments."""
    pose = start
    for curvature, distance in path:
        pieces = max(1, ceil(abs(distance) / every))
        for k in range(1, pieces + 1):
            yield move_along_arc(*pose, distance * k / pieces, curvature, 0.0)
        pose = move_along_arc(*pose, distance, curvature, 0.0)


def _with_gear(start: Pose, path: Path) -> Iterator[tuple[Pose, float]]:
    """Yield poses along a path like `along`, each with the sign of its gear."""
    for segment in path:
        for pose in along(start, (segment,), LOOK_EVERY):
            yield pose, segment.distance
        start = move_along_arc(*start, segment.distance, segment.curvature, 0.0)


def plan_with_run_up(start: Pose, goal: Pose, room: Room | None = None, body: Geometry | None = None) -> Path:
    """Plan a path, as `plan`, that ends with a straight run-up to the goal, forward or backward; for corrections.

    The shortest path to a goal a few degrees off has arcs so short that the steering cannot follow them. On a map this
    path keeps `CORRECTS` m from walls, because a slightly better pose is worth no contact, and no way round walls is
    searched. Raises NoPath as `plan`.
    """
    body = Geometry() if body is None else body
    on_map = room is not None and room.walls is not None
    clear = CORRECTS if on_map else 0.0
    found: list[Path] = []
    for distance in (RUN_UP, -RUN_UP):
        via = move_along_arc(*goal, -distance, 0.0, 0.0)
        with suppress(NoPath):
            first = _cheapest_inside(start, via, room, body, clear) if on_map else plan(start, via, room, body)
            if first is not None and stays_inside(start, path := (*first, Segment(0.0, distance)), room, body, clear):
                found.append(path)
    if not found and on_map:
        raise NoPath(goal, room)
    return min(found, key=cost) if found else plan(start, goal, room, body)


def _cheapest_inside(start: Pose, goal: Pose, room: Room | None, body: Geometry, keep_clear: float) -> Path | None:
    every = (path for margin in MARGINS for path in paths(start, goal, margin * body.radius_min))
    inside = (path for path in sorted(every, key=cost) if stays_inside(start, path, room, body, keep_clear, goal))
    return next(inside, None)


def _out_of_narrow(start: Pose, goal: Pose, room: Room | None, body: Geometry, keep_clear: float) -> Path | None:
    """Search as `_round_walls`, from a place so narrow that the car can leave it only in several moves."""
    return _round_walls(start, goal, room, body, keep_clear, narrow=True)


def _round_walls(
    start: Pose, goal: Pose, room: Room | None, body: Geometry, keep_clear: float, narrow: bool = False
) -> Path | None:
    assert room is not None

    def last(pose: Pose) -> Path | None:
        return _cheapest_inside(pose, goal, room, body, keep_clear)

    return round_walls(start, goal, room, body, MARGINS[0] * body.radius_min, keep_clear, last, narrow)


def _over_a_place(start: Pose, goal: Pose, room: Room | None, body: Geometry, keep_clear: float) -> Path | None:
    """Return the cheapest path in two parts over a grid of poses around the goal and the start."""
    assert room is not None
    best, least = None, inf
    radius = MARGINS[0] * body.radius_min
    steps = [radius * (k - VIA // 2) for k in range(VIA)]
    around = [
        (pose[0] + dx, pose[1] + dy, theta)
        for pose in (start, goal)
        for dx, dy, theta in product(steps, steps, (k * pi / 4.0 for k in range(8)))
    ]
    for via in around:
        if clearance(*via, room, body) < keep_clear:
            continue
        first = _cheapest_inside(start, via, room, body, keep_clear)
        if first is None or cost(first) >= least:
            continue
        second = _cheapest_inside(via, goal, room, body, keep_clear)
        if second is not None and cost(first) + cost(second) < least:
            best, least = first + second, cost(first) + cost(second)
    return best
