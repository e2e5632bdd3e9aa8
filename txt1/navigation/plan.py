"""Paths for a car in a room: the shortest Reeds-Shepp path on which the body stays clear of the walls."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import groupby, product
from math import ceil, copysign, inf, isfinite, pi
from typing import Final

from txt1.errors import Txt1Error
from txt1.model.kinematics import move_along_arc
from txt1.model.reeds_shepp import Path, Pose, Segment, length, paths
from txt1.model.vehicle import Geometry
from txt1.navigation.search import ends_of, round_walls, stays_clear
from txt1.navigation.ways import BLIND
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
STRETCH_MIN: Final = 0.15
# m of path, the cost of such a stretch
SHORT_STRETCH: Final = 0.3
# m of path between two checks of the body
PATH_CHECK_SPACING: Final = 0.05
# m that a correction keeps from a map's walls: more than the error of a pose on a map
CORRECTS: Final = 0.06
# m from the robot beyond which it may plan to back up over floor that it has not seen, if there is no other way
SEES: Final = 1.5
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

    def __init__(self, goal: Pose, room: Room | None = None, needs: tuple[float, float] | None = None) -> None:
        x, y, theta = goal
        where = f"no path leads to ({x:.2f} m, {y:.2f} m, {theta * 180 / pi:.0f} deg) inside the room: "
        if needs is None:
            remedy = "choose a goal farther from the walls" + (BACKWARD if room is not None and room.blind else "")
        else:
            remedy = (
                f"the robot would stand {needs[0]:.2f} m from a wall, and keeps {needs[1]:.2f} m; choose a goal farther"
            )
        super().__init__(where + remedy)


def plan(start: Pose, goal: Pose, room: Room | None = None, body: Geometry | None = None, keep: float = 0.0) -> Path:
    """Return the path from one pose to another; room None: no walls.

    It is the cheapest Reeds-Shepp path inside the room, by length and gear changes. If all of them touch a wall, it is
    the cheapest path over a place in between. On a map, Reeds-Shepp paths and ways round walls are tried with each
    margin to the walls, the largest margin first, and none below `keep` m: what stops the robot if it comes nearer.

    Raises NoPath: every path comes closer to a wall.
    """
    body = Geometry() if body is None else body
    if room is not None and (there := clearance(*goal, room, body)) < keep:
        raise NoPath(goal, room, None if there < 0.0 else (there, keep))
    if room is not None and room.walls is not None:
        # a way round a box with some room is better than a way that brushes it; the search in narrow places comes last
        margins = _at_least(keep, BY_WALLS)
        # the search begins with the cheapest of the Reeds-Shepp paths, too, and looks for one that backs up less
        searches = (_cheapest_inside, _round_walls) if not room.blind else (_round_walls,)
        tries = [*product(margins, searches), *product(margins, (_out_of_narrow,))]
    else:
        margins = _at_least(keep, ROOMS)
        tries = [(keep_clear, search) for search in (_cheapest_inside, _over_a_place) for keep_clear in margins]
    # far from the robot, the laser will have seen the floor before the robot backs up there
    sights = (inf, SEES) if room is not None and room.blind else (inf,)
    for seen, (keep_clear, search) in product(sights, tries):
        path = search(start, goal, room, body, keep_clear, keep, seen)
        if path is not None:
            return path
    raise NoPath(goal, room)


def _at_least(clear: float, margins: Sequence[float]) -> list[float]:
    """Return the margins, none below `clear`."""
    return [*(each for each in margins if each > clear), max(clear, margins[-1])]


def cost(path: Path, blind: bool = False) -> float:
    """Return the cost of a path: its length, m, and the costs of gear changes, short stretches and blind metres."""
    parts = stretches(path)
    short = sum(length(part) < STRETCH_MIN for part in parts)
    backward = sum(-min(distance, 0.0) for _, distance in path)
    return length(path) + GEAR_CHANGE * (len(parts) - 1) + SHORT_STRETCH * short + (BLIND - 1.0) * blind * backward


def stretches(path: Path) -> list[Path]:
    """Return the parts of a path that are driven in one gear."""
    return [tuple(part) for _, part in groupby(path, key=lambda segment: segment.distance > 0.0)]


def stays_inside(
    start: Pose,
    path: Path,
    room: Room | None,
    body: Geometry,
    keep_clear: float = 0.0,
    keep: float = 0.0,
) -> bool:
    """Return whether the body keeps `keep_clear` m from the walls along a path, checked every 5 cm.

    Near a start that is closer to a map's wall its own distance is enough.
    """
    if room is None or not (isfinite(room.length) or isfinite(room.width) or room.walls is not None):
        return True
    if room.walls is None:
        return all(clearance(*pose, room, body) >= keep_clear for pose in along(start, path, PATH_CHECK_SPACING))
    return stays_clear(start, path, room, body, keep_clear, ends_of(start, None, room, body, keep_clear, keep, inf))


def seen_part(start: Pose, path: Path, room: Room | None, body: Geometry) -> Path:
    """Return the part of a path, from its start, that stays inside the room, to `PATH_CHECK_SPACING` m."""
    if stays_inside(start, path, room, body):
        return path
    inside: Path = ()
    while inside != path and stays_inside(
        start, longer := _first(path, length(inside) + PATH_CHECK_SPACING), room, body
    ):
        inside = longer
    return inside


def _first(path: Path, metres: float) -> Path:
    """Return the beginning of a path, of so many metres; the path if it is no longer."""
    found: list[Segment] = []
    for curvature, distance in path:
        if metres <= abs(distance):
            return (*found, Segment(curvature, copysign(metres, distance))) if metres > 1e-9 else tuple(found)
        found.append(Segment(curvature, distance))
        metres -= abs(distance)
    return path


def along(start: Pose, path: Path, every: float) -> Iterator[Pose]:
    """Yield poses along a path at most `every` m apart, including its end and the ends of its segments."""
    pose = start
    for curvature, distance in path:
        pieces = max(1, ceil(abs(distance) / every))
        for k in range(1, pieces + 1):
            yield move_along_arc(*pose, distance * k / pieces, curvature, 0.0)
        pose = move_along_arc(*pose, distance, curvature, 0.0)


def plan_with_run_up(
    start: Pose, goal: Pose, room: Room | None = None, body: Geometry | None = None, keep: float = 0.0
) -> Path:
    """Plan a path, as `plan`, that ends with a straight run-up to the goal, forward or backward; for corrections.

    The shortest path to a goal a few degrees off has arcs so short that the steering cannot follow them. On a map this
    path keeps `CORRECTS` m from walls, because a slightly better pose is worth no contact, and no way round walls is
    searched. Raises NoPath as `plan`.
    """
    body = Geometry() if body is None else body
    on_map = room is not None and room.walls is not None
    clear = max(CORRECTS, keep) if on_map else keep
    found: list[Path] = []
    blind = room is not None and room.blind
    for distance in (RUN_UP, -RUN_UP):
        via = move_along_arc(*goal, -distance, 0.0, 0.0)
        with suppress(NoPath):
            if on_map:
                first = _cheapest_inside(start, via, room, body, clear, keep, inf)
            else:
                first = plan(start, via, room, body, keep)
            if first is None:
                continue
            path = (*first, Segment(0.0, distance))
            if stays_inside(start, path, room, body, clear, keep=keep):
                found.append(path)
    if not found and on_map:
        raise NoPath(goal, room)
    return min(found, key=lambda path: cost(path, blind)) if found else plan(start, goal, room, body, keep)


def _cheapest_inside(
    start: Pose, goal: Pose, room: Room | None, body: Geometry, keep_clear: float, keep: float, seen: float
) -> Path | None:
    every = _by_cost(start, goal, room, body)
    if room is None or room.walls is None:
        return next((path for path in every if stays_inside(start, path, room, body, keep_clear)), None)
    ends = ends_of(start, goal, room, body, keep_clear, keep, seen)
    return next((path for path in every if stays_clear(start, path, room, body, keep_clear, ends)), None)


def _by_cost(start: Pose, goal: Pose, room: Room | None, body: Geometry) -> list[Path]:
    """Return the Reeds-Shepp paths between two poses, the cheapest first."""
    blind = room is not None and room.blind
    every = (path for margin in MARGINS for path in paths(start, goal, margin * body.radius_min))
    return sorted(every, key=lambda path: cost(path, blind))


def _out_of_narrow(
    start: Pose, goal: Pose, room: Room | None, body: Geometry, keep_clear: float, keep: float, seen: float
) -> Path | None:
    """Search as `_round_walls`, from a place so narrow that the car can leave it only in several moves."""
    return _round_walls(start, goal, room, body, keep_clear, keep, seen, narrow=True)


def _round_walls(
    start: Pose,
    goal: Pose,
    room: Room | None,
    body: Geometry,
    keep_clear: float,
    keep: float,
    seen: float,
    narrow: bool = False,
) -> Path | None:
    assert room is not None
    ends = ends_of(start, goal, room, body, keep_clear, keep, seen)

    def last(pose: Pose) -> Path | None:
        every = _by_cost(pose, goal, room, body)
        return next((path for path in every if stays_clear(pose, path, room, body, keep_clear, ends)), None)

    def price(path: Path) -> float:
        return cost(path, room is not None and room.blind)

    return round_walls(start, goal, room, body, MARGINS[0] * body.radius_min, keep_clear, ends, last, price, narrow)


def _over_a_place(
    start: Pose, goal: Pose, room: Room | None, body: Geometry, keep_clear: float, keep: float, seen: float
) -> Path | None:
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
        first = _cheapest_inside(start, via, room, body, keep_clear, keep, seen)
        if first is None or cost(first) >= least:
            continue
        second = _cheapest_inside(via, goal, room, body, keep_clear, keep, seen)
        if second is not None and cost(first) + cost(second) < least:
            best, least = first + second, cost(first) + cost(second)
    return best
