"""The planner's loops over a map's cells, as numba compiles them; without numba they run as they are.

A floor is a tuple: the depths of the walls and of floor that was not seen (`Grid.depth`, flat), their columns and rows,
the frame (x0, y0, cosine, sine, cells a metre), the body (length, width, centre), and whether unseen floor counts.
`ends` are the start and the goal, near which less clearance may be required than elsewhere: x, y, and this clearance,
for each; then the distance in m from the start within which a body may back up only where the floor was seen.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import cache
from heapq import heappop, heappush
from math import cos, floor, hypot, inf, pi, sin
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.kernel.loop import VirtualTimeLoop
from txt1.maps.files import Map
from txt1.maps.grid import FREE, Grid
from txt1.model.kinematics import move_along_arc, wrap_angle
from txt1.sim.machine_code import compiled
from txt1.sim.walls import SLOPE, WALL_STEP, Walls
from txt1.tasks.on_map import MapInUse

OFF_MAP: Final = 32.0
"""Cells by which a place off the map is deeper than its distance from the map's edge."""
UNSEEN_OVERLAP: Final = 0.03
"""m by which a body may overlap floor that was not seen: the floor seen comes in cells."""
LEAVING: Final = 0.4
"""m from the start and the goal within which their own clearance is enough."""
ARC_CHECK_SPACING: Final = 0.05
"""m of a step between two checks of the body."""
LATTICE: Final = 0.1
"""m between two places of the lattice."""
STEP_LENGTH: Final = 0.3
"""Length of a step, m: longer than a cell's diagonal, so that it leaves the cell."""
POSE_CELL: Final = 0.2
"""m, side of a cell of poses."""
TURNS: Final = 18
"""Number of sectors of headings of these cells."""
NARROW_REACH: Final = 0.8
"""m from the start within which a search in a narrow place takes short steps:"""
SHORT_STEP: Final = 0.1
"""their length, m, longer than a diagonal of"""
SMALL_CELL: Final = 0.06
"""m, side of a cell of poses there, and"""
SMALL_TURNS: Final = 72
"""the number of their sectors."""
SMALL_CELLS: Final = 28
"""Number of these cells along a side of their square."""
GREED: Final = 1.5
"""Weight of a metre to the goal, relative to a metre driven."""
BACKWARD: Final = 1.3
"""Cost of a metre backward, relative to a metre forward,"""
BLIND: Final = 2.0
"""and of one where nothing looks back: the robot backs up no farther than it has to."""
CHANGE: Final = 0.5
"""m, the cost of a change of gear: a change takes time."""
BEND: Final = 0.03
"""m, the additional cost of a step at full lock."""
GOAL_NEAR: Final = 2.0
"""m from the goal within which a path to it is tried from each pose at first; elsewhere from one of this number:"""
GOAL_TRY_STEP: Final = 10


def depth_at(depth: Any, columns: int, rows: int, frame: Any, x: float, y: float) -> float:
    """Return the distance to the nearest wall, as `Walls.distance`."""
    dx, dy = x - frame[0], y - frame[1]
    # from the centre of the frame's first cell, in cells; the frame is a cell wide
    u = (frame[2] * dx + frame[3] * dy) * frame[4] + 0.5
    v = (frame[2] * dy - frame[3] * dx) * frame[4] + 0.5
    if not (0.0 <= u < columns - 1 and 0.0 <= v < rows - 1):
        away = max(max(-u, u - columns + 1.0), max(-v, v - rows + 1.0))
        return float(-(OFF_MAP + away) / frame[4])
    i, j = int(u), int(v)
    a, b = u - i, v - j
    at = j * columns + i
    below = depth[at] + a * (depth[at + 1] - depth[at])
    above = depth[at + columns] + a * (depth[at + columns + 1] - depth[at + columns])
    return float(below + b * (above - below))


def has_room(
    depth: Any, columns: int, rows: int, frame: Any, body: Any, x: float, y: float, theta: float, clear: float
) -> bool:
    """Return whether the body's outline is `clear` m from the walls: three circles decide most negative cases first."""
    length, width, centre = body
    c, s = cos(theta), sin(theta)
    least = 0.5 * width + clear
    reach = 0.5 * max(0.0, length - width)
    x, y = x + centre * c, y + centre * s
    middle = depth_at(depth, columns, rows, frame, x, y)
    if middle < least:
        return False
    if middle - SLOPE * hypot(0.5 * length, 0.5 * width) >= clear:
        return True
    if depth_at(depth, columns, rows, frame, x + reach * c, y + reach * s) < least:
        return False
    if depth_at(depth, columns, rows, frame, x - reach * c, y - reach * s) < least:
        return False
    # from here on as `Walls.clearance`: along the outline, from the least distance of a corner
    lowest = clear + SLOPE * (length + width)
    for i in range(4):
        ax, ay = (0.5 if i < 2 else -0.5) * length, (0.5 if i % 2 == 0 else -0.5) * width
        lowest = min(lowest, depth_at(depth, columns, rows, frame, x + c * ax - s * ay, y + s * ax + c * ay))
    step = WALL_STEP / frame[4]
    for side in range(4):
        # from a corner along a side, anticlockwise
        if side == 0:
            px, py, ux, uy, way = 0.5, 0.5, -1.0, 0.0, length
        elif side == 1:
            px, py, ux, uy, way = -0.5, 0.5, 0.0, -1.0, width
        elif side == 2:
            px, py, ux, uy, way = -0.5, -0.5, 1.0, 0.0, length
        else:
            px, py, ux, uy, way = 0.5, -0.5, 0.0, 1.0, width
        px, py = px * length, py * width
        along = 0.0
        while along < way:
            if lowest < clear:
                return False
            ax, ay = px + along * ux, py + along * uy
            here = depth_at(depth, columns, rows, frame, x + c * ax - s * ay, y + s * ax + c * ay)
            lowest = min(lowest, here)
            along += max(step, (here - lowest) / SLOPE)
    return bool(lowest >= clear)


def stands(grounds: Any, ends: Any, clear: float, x: float, y: float, theta: float, gear: float) -> bool:
    """Return whether a body keeps clear of walls, in reverse (gear < 0) also of floor that was not seen free."""
    depth, behind, columns, rows, frame, body, unseen = grounds
    least = clear
    for k in (0, 3):
        if hypot(x - ends[k], y - ends[k + 1]) < LEAVING:
            least = min(least, ends[k + 2])
    if not has_room(depth, columns, rows, frame, body, x, y, theta, least):
        return False
    # farther away it will have been seen before the robot is there
    if unseen and gear < 0.0 and hypot(x - ends[0], y - ends[1]) < ends[6]:
        return bool(has_room(behind, columns, rows, frame, body, x, y, theta, -UNSEEN_OVERLAP))
    return True


def arc_is_free(
    grounds: Any, ends: Any, clear: float, x: float, y: float, theta: float, curvature: float, distance: float
) -> bool:
    """Return whether the body keeps clear along an arc, checked every `ARC_CHECK_SPACING` m, the end first."""
    pieces = max(1, int(np.ceil(abs(distance) / ARC_CHECK_SPACING - 1e-9)))
    # most steps that touch a wall touch it at the end
    for k in range(pieces):
        share = distance * ((pieces - k) / pieces)
        px, py, turned = move_along_arc(x, y, theta, share, curvature, 0.0)
        if not stands(grounds, ends, clear, px, py, turned, distance):
            return False
    return True


def spread(
    grounds: Any, clear: float, goal: Any, start: Any, left: Any, corner: Any, wide: int, high: int, most: int
) -> int:
    """Write the distances in m to the goal of the lattice's places; inf stays where no way was found.

    The way of a point keeps half the car's width from walls, and `clear` m more except near the start and the goal.
    `left` is the lattice, flat, with `wide` x `high` places from `corner` on (whole numbers of `LATTICE`).
    """
    depth, _, columns, rows, frame, body, _ = grounds
    first = (floor(goal[1] / LATTICE + 0.5) - corner[1]) * wide + floor(goal[0] / LATTICE + 0.5) - corner[0]
    end = (floor(start[1] / LATTICE + 0.5) - corner[1]) * wide + floor(start[0] / LATTICE + 0.5) - corner[0]
    heap = [(0.0, first)]
    found, enough = 0, inf
    left[first] = 0.0
    while len(heap) > 0 and found < most:
        far, place = heappop(heap)
        if far > left[place]:
            continue
        if far > enough:
            # all of them were only guesses
            left[place] = inf
            continue
        found += 1
        if place == end:
            # places farther away would be detours
            enough = far + 3.0
        column, row = place % wide, place // wide
        for i in range(-1, 2):
            for j in range(-1, 2):
                if (i == 0 and j == 0) or not (0 <= column + i < wide and 0 <= row + j < high):
                    continue
                there = far + (LATTICE if i == 0 or j == 0 else 1.4142135623730951 * LATTICE)
                other = place + j * wide + i
                if there >= left[other]:
                    continue
                x, y = LATTICE * (corner[0] + column + i), LATTICE * (corner[1] + row + j)
                room = depth_at(depth, columns, rows, frame, x, y) - 0.5 * body[1]
                near = min(hypot(x - goal[0], y - goal[1]), hypot(x - start[0], y - start[1])) < LEAVING
                if other == end or room > clear or (room > 0.0 and near):
                    left[other] = there
                    heappush(heap, (there, other))
    return found


def cell_of(x: float, y: float, theta: float, forward: bool, small: bool, squares: Any) -> int:
    """Return the number of a pose's cell.

    `squares`: x and y of the corner, columns and rows of the large cells, and x and y of the corner of the small cells.
    """
    if small:
        turn = floor((theta + pi) / (2.0 * pi) * SMALL_TURNS) % SMALL_TURNS
        i = min(max(floor((x - squares[4]) / SMALL_CELL), 0), SMALL_CELLS - 1)
        j = min(max(floor((y - squares[5]) / SMALL_CELL), 0), SMALL_CELLS - 1)
        at = (j * SMALL_CELLS + i) * SMALL_TURNS + turn
        at += int(squares[2] * squares[3]) * TURNS
    else:
        turn = floor((theta + pi) / (2.0 * pi) * TURNS) % TURNS
        i = min(max(floor((x - squares[0]) / POSE_CELL), 0), int(squares[2]) - 1)
        j = min(max(floor((y - squares[1]) / POSE_CELL), 0), int(squares[3]) - 1)
        at = (j * int(squares[2]) + i) * TURNS + turn
    return int(2 * at + (1 if forward else 0))


def push(keys: Any, nodes: Any, size: int, key: float, node: int) -> None:
    """Add a node to a heap of `size` nodes; of equal keys the node that was made first comes first."""
    at = size
    while at > 0:
        above = (at - 1) // 2
        if keys[above] < key or (keys[above] == key and nodes[above] < node):
            break
        keys[at], nodes[at] = keys[above], nodes[above]
        at = above
    keys[at], nodes[at] = key, node


def pop(keys: Any, nodes: Any, size: int) -> int:
    """Remove the first node from a heap of `size` nodes, and return it."""
    found = int(nodes[0])
    key, node = keys[size - 1], nodes[size - 1]
    last = size - 1
    at = 0
    while True:
        below = 2 * at + 1
        if below >= last:
            break
        if below + 1 < last and (
            keys[below + 1] < keys[below] or (keys[below + 1] == keys[below] and nodes[below + 1] < nodes[below])
        ):
            below += 1
        if key < keys[below] or (key == keys[below] and node < nodes[below]):
            break
        keys[at], nodes[at] = keys[below], nodes[below]
        at = below
    keys[at], nodes[at] = key, node
    return found


def advance(
    grounds: Any,
    ends: Any,
    clear: float,
    bend: float,
    narrow: bool,
    left: Any,
    corner: Any,
    wide: int,
    high: int,
    squares: Any,
    poses: Any,
    steps: Any,
    parents: Any,
    keys: Any,
    heap: Any,
    closed: Any,
    counts: Any,
    spacing: int,
    expanded: int,
    most: int,
) -> int:
    """Search on until a path to the goal should be tried from a pose; return its node, -1: nothing is left.

    Args:
        grounds, ends, clear: see the module.
        bend: curvature of the arcs, 1/m.
        narrow: whether the search takes short steps near the start.
        left, corner, wide, high: the lattice, as `spread` wrote it.
        squares: see `cell_of`.
        poses: for each node x, y, theta and the cost of its way, flat.
        steps: for each node curvature and distance of the step to it, flat.
        parents: the node before each.
        keys, heap: the nodes to look at.
        closed: the cells that were looked at.
        counts: number of nodes, size of the heap, number of poses looked at, and number of poses since the last try.
        spacing: a path is tried from one of this number of poses near the goal, and of `GOAL_TRY_STEP` times as many
        elsewhere. expanded: the node that was returned last, -1 at first. most: largest number of poses to look at.

    """
    node, backward = expanded, BLIND if grounds[6] else BACKWARD
    while True:
        if node >= 0:
            x, y, theta, spent = poses[4 * node], poses[4 * node + 1], poses[4 * node + 2], poses[4 * node + 3]
            short = narrow and hypot(x - ends[0], y - ends[1]) < NARROW_REACH
            step = SHORT_STEP if short else STEP_LENGTH
            for k in range(6):
                gear = 1.0 if k < 3 else -1.0
                curvature = bend * (0.0 if k % 3 == 0 else (1.0 if k % 3 == 1 else -1.0))
                px, py, turned = move_along_arc(x, y, theta, gear * step, curvature, 0.0)
                i = floor(px / LATTICE + 0.5) - corner[0]
                j = floor(py / LATTICE + 0.5) - corner[1]
                if not (0 <= i < wide and 0 <= j < high):
                    continue
                far = left[j * wide + i]
                if far == inf:
                    continue
                small = narrow and hypot(px - ends[0], py - ends[1]) < NARROW_REACH
                if closed[cell_of(px, py, turned, gear > 0.0, small, squares)]:
                    continue
                if not arc_is_free(grounds, ends, clear, x, y, theta, curvature, gear * step):
                    continue
                before = steps[2 * node + 1]
                total = spent + step * (1.0 if gear > 0.0 else backward) + (BEND if curvature != 0.0 else 0.0)
                if before != 0.0 and (before > 0.0) != (gear > 0.0):
                    total += CHANGE
                new = int(counts[0])
                poses[4 * new], poses[4 * new + 1], poses[4 * new + 2], poses[4 * new + 3] = px, py, turned, total
                steps[2 * new], steps[2 * new + 1] = curvature, gear * step
                parents[new] = node
                push(keys, heap, int(counts[1]), total + GREED * far, new)
                counts[0] += 1
                counts[1] += 1
        if counts[2] >= most:
            return -1
        node = -1
        while counts[1] > 0:
            node = pop(keys, heap, int(counts[1]))
            counts[1] -= 1
            x, y, theta = poses[4 * node], poses[4 * node + 1], poses[4 * node + 2]
            short = narrow and hypot(x - ends[0], y - ends[1]) < NARROW_REACH
            cell = cell_of(x, y, theta, steps[2 * node + 1] >= 0.0, short, squares)
            if not closed[cell]:
                closed[cell] = 1
                break
            node = -1
        if node < 0:
            return -1
        first = counts[2] == 0
        counts[2] += 1
        counts[3] += 1
        place = (floor(y / LATTICE + 0.5) - corner[1]) * wide + floor(x / LATTICE + 0.5) - corner[0]
        if (
            first
            or counts[3] >= GOAL_TRY_STEP * spacing
            or (not short and left[place] < GOAL_NEAR and counts[3] >= spacing)
        ):
            counts[3] = 0
            return node


class PlannerLoops(NamedTuple):
    """The loops, compiled."""

    stands: Callable[..., Any]
    arc_is_free: Callable[..., Any]
    spread: Callable[..., Any]
    advance: Callable[..., Any]
    arrays: bool
    """Whether they are compiled, and take arrays: plain Python reads memoryviews three times as fast."""


@cache
def loops() -> PlannerLoops:
    """Return the loops."""
    wrapped = compiled(wrap_angle)
    arc = compiled(move_along_arc, calls={"wrap_angle": wrapped})
    depth = compiled(depth_at)
    room = compiled(has_room, calls={"depth_at": depth})
    standing = compiled(stands, calls={"has_room": room}, cache=True, nogil=True)
    free = compiled(arc_is_free, calls={"move_along_arc": arc, "stands": standing}, cache=True, nogil=True)
    own = {"cell_of": compiled(cell_of), "push": compiled(push), "pop": compiled(pop)}
    return PlannerLoops(
        standing,
        free,
        compiled(spread, calls={"depth_at": depth}, cache=True, nogil=True),
        compiled(advance, calls={"move_along_arc": arc, "arc_is_free": free, **own}, cache=True, nogil=True),
        standing is not stands,
    )


def flat(array: Any) -> Any:
    """Return an array as the loops read it."""
    return array.ravel() if loops().arrays else array.ravel().data


def grounds_of(walls: Walls, behind: Walls | None, body: tuple[float, float, float]) -> Any:
    """Return a floor for the loops; `body`: length, width, centre in m."""
    grid = walls.grid
    x, y, yaw = grid.origin
    rows, columns = grid.depth.shape
    frame = (float(x), float(y), cos(yaw), sin(yaw), 1.0 / grid.resolution)
    unseen = walls if behind is None else behind
    return flat(grid.depth), flat(unseen.grid.depth), columns, rows, frame, body, behind is not None


async def ready(runtime: Any, _: object) -> None:
    """Prepare the loops for a robot that drives in a map on the real clock; without numba they run as they are."""
    there = runtime.part(MapInUse)
    if there is not None and not there.making and not isinstance(asyncio.get_running_loop(), VirtualTimeLoop):
        await asyncio.to_thread(prepare)


def prepare() -> None:
    """Compile the loops, or load them, on an imaginary floor; with the first goal, that would stop the event loop."""
    cells = np.full((60, 60), FREE, np.int8)
    walls = Walls(Map("floor", Path(), Grid(cells, 0.05, (0.0, 0.0, 0.0)), ""))
    grounds, found = grounds_of(walls, None, (0.5, 0.4, 0.0)), loops()
    start, goal, ends = (1.0, 1.5), (2.0, 1.5), (1.0, 1.5, inf, 2.0, 1.5, inf, inf)
    found.arc_is_free(grounds, ends, 0.0, *start, 0.0, 0.0, 0.1)
    left, corner = np.full(40 * 40, inf), (0, 0)
    found.spread(grounds, 0.0, goal, start, flat(left), corner, 40, 40, 1000)
    squares = (0.0, 0.0, 20.0, 20.0, 0.0, 0.0)
    poses, steps, keys = np.zeros(400), np.zeros(200), np.zeros(100)
    poses[:2] = start
    cells_closed = np.zeros(2 * (20 * 20 * TURNS + SMALL_CELLS**2 * SMALL_TURNS), np.uint8)
    counts = np.array([1, 1, 0, 0], np.int64)
    arrays = (poses, steps, np.full(100, -1, np.int64), keys, np.zeros(100, np.int64), cells_closed, counts)
    arguments = (grounds, ends, 0.0, 1.0, False, flat(left), corner, 40, 40, squares, *map(flat, arrays), 1)
    found.advance(*arguments, found.advance(*arguments, -1, 5), 5)
