"""The quickest course to the light that keeps clear of what the laser has seen.

A plan is "a for m decisions, b for n, then e", with e for good. Its cost is its time, and more where the body comes
nearer than `MARGIN` to a point that the laser has seen:

    cost = time + STEEP * max(0, MARGIN - clearance)  [+ TOUCHES where the clearance is less than NEAREST]

All plans are searched by branch and bound. The first pieces of a plan show its least cost: the time so far, the
straight way to the goal at the highest speed, and the clearance so far. The clearance can only become less. The rest of
the plan before is tried first, so a course that was found clear is still there when the next decision comes.

The body is three discs in a row. The clearance comes from a grid of distances to the points, in the robot's frame.

A laser sees the front of a box. A course that passes close behind it may find no way out when the rest comes into view.
So places up to `HIDDEN` behind the points of the newest sweep count as points, too.
"""

from math import cos, floor, hypot, inf, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from txt1_learners.planner import Array, Belief, compiled, onwards

# cells of the grid on a side, and their size, m
CELLS: Final = 97
CELL: Final = 0.05
# m, of room that a course keeps on all sides
MARGIN: Final = 0.1
# decisions that a metre of room less costs
STEEP: Final = 2000.0
# m: a course with less room counts as a contact
NEAREST: Final = 0.04
# decisions, more than any plan takes
TOUCHES: Final = 1e5
# every so many decisions a piece of a plan may end
STRIDE: Final = 3
# m: points nearer to each other than this count as one
APART: Final = 0.03
# sweeps of the laser that are remembered
SWEEPS: Final = 30
# m behind a seen point that count as seen: a box is so long
HIDDEN: Final = (0.1, 0.2, 0.3)
# m, up to which distances count: more than the body's discs and the margin
REACH: Final = 0.6


class Discs(NamedTuple):
    """The robot's body as three discs, m: radius, distance, and the middle one's place ahead of the pose."""

    radius: float
    apart: float
    ahead: float


def body_of(length: float, width: float, centre: float) -> Discs:
    """The discs that cover a rectangle."""
    return Discs(hypot(length / 6.0, 0.5 * width), length / 3.0, centre)


class ActionPlan(NamedTuple):
    """A plan: action a for m decisions, b for n, then e; its length in decisions, and its cost."""

    a: int
    m: int
    b: int
    n: int
    e: int
    time: float
    cost: float

    def later(self) -> "ActionPlan":
        """The rest of it after a decision."""
        if self.m > 1:
            return self._replace(m=self.m - 1)
        return self._replace(a=self.b, m=self.n, b=self.e, n=0) if self.m else self


class SeenPoints:
    """What the laser has seen in an episode, on the map of odometry."""

    def __init__(self) -> None:
        self._sweeps: list[Array] = []
        # what the newest sweep may hide
        self._hidden: Array = np.empty((0, 2))
        # x, y, heading on the map
        self.pose = (0.0, 0.0, 0.0)

    def move(self, distance: float, turn: float) -> None:
        """Move the robot on the map."""
        x, y, heading = self.pose
        middle = heading + 0.5 * turn
        self.pose = x + distance * cos(middle), y + distance * sin(middle), heading + turn

    def add(self, points: Array, since: tuple[float, float, float], *, hide: bool = True) -> None:
        """Take a sweep's points; `since` is the robot's motion after the sweep (x, y, turn), in the sweep's frame.

        `hide`: the places behind each point count as points until the next sweep.
        """
        self._sweeps.append(self._on_map(points, since))
        del self._sweeps[:-SWEEPS]
        if not hide:
            return
        away = np.maximum(np.hypot(points[:, 0], points[:, 1]), 1e-6)[:, None]
        self._hidden = self._on_map(np.concatenate([points * (1.0 + each / away) for each in HIDDEN]), since)

    def _on_map(self, points: Array, since: tuple[float, float, float]) -> Array:
        ahead, left, turn = since
        back_x, back_y = points[:, 0] - ahead, points[:, 1] - left
        c, s = cos(turn), sin(turn)
        x, y, heading = self.pose
        here_x, here_y = c * back_x + s * back_y, c * back_y - s * back_x
        c, s = cos(heading), sin(heading)
        return np.column_stack((x + c * here_x - s * here_y, y + s * here_x + c * here_y))

    def near(self) -> Array:
        """The points in the robot's frame that lie on the grid, each place once; shape (n, 2), m."""
        if not self._sweeps:
            return np.empty((0, 2))
        points = np.concatenate([*self._sweeps, self._hidden])
        x, y, heading = self.pose
        east, north = points[:, 0] - x, points[:, 1] - y
        c, s = cos(heading), sin(heading)
        here = np.column_stack((c * east + s * north, c * north - s * east))
        here = here[np.abs(here).max(axis=1) < 0.5 * CELLS * CELL]
        places = np.floor(here / APART).astype(np.int64)
        _, first = np.unique(places[:, 0] * 10_000 + places[:, 1], return_index=True)
        found: Array = here[first]
        return found


@compiled
def distances(points: Array) -> Array:
    """Distance from the middle of each cell of the grid to the nearest point, m; `REACH` where it is more."""
    found = np.full((CELLS, CELLS), REACH)
    middle, around = CELLS // 2, int(REACH / CELL) + 1
    for p in range(points.shape[0]):
        at_i, at_j = round(points[p, 0] / CELL) + middle, round(points[p, 1] / CELL) + middle
        for i in range(max(0, at_i - around), min(CELLS, at_i + around + 1)):
            x = (i - middle) * CELL - points[p, 0]
            for j in range(max(0, at_j - around), min(CELLS, at_j + around + 1)):
                y = (j - middle) * CELL - points[p, 1]
                found[i, j] = min(found[i, j], sqrt(x * x + y * y))
    return found


@compiled
def room(grid: Array, body: tuple[float, float, float], x: float, y: float, heading: float) -> float:
    """The room between the body at a pose in the robot's frame and the nearest point, m; inf off the grid."""
    radius, apart, ahead = body
    c, s = cos(heading), sin(heading)
    least = inf
    middle = CELLS // 2
    for disc in range(-1, 2):
        east, north = x + (ahead + disc * apart) * c, y + (ahead + disc * apart) * s
        u, v = east / CELL + middle, north / CELL + middle
        i, j = floor(u), floor(v)
        if 0 <= i < CELLS - 1 and 0 <= j < CELLS - 1:
            u, v = u - i, v - j
            here = (grid[i, j] * (1.0 - u) + grid[i + 1, j] * u) * (1.0 - v)
            here += (grid[i, j + 1] * (1.0 - u) + grid[i + 1, j + 1] * u) * v
            least = min(least, here - radius)
    return least


@compiled
def fine(clear: float) -> float:
    """Return the cost of too little room, decisions."""
    if clear < NEAREST:
        return TOUCHES + STEEP * (MARGIN - clear)
    return STEEP * max(0.0, MARGIN - clear)


@compiled
def clear_along(
    pose: tuple[float, float, float, float, float],
    b: int,
    steps: int,
    k: Array,
    c: Array,
    scale: float,
    grid: Array,
    body: tuple[float, float, float],
    least: float,
    stop: float = NEAREST,
) -> tuple[tuple[float, float, float, float, float], float]:
    """Drive an action for some decisions; the pose, distance and curvature at the end, and the least room on the way.

    Nothing is driven on once there is less room than `stop`, m.
    """
    x, y, heading, distance, curvature = pose
    for _ in range(steps):
        distance = k[0] * distance + c[0, b]
        curvature = k[1] * curvature + c[1, b]
        turn = scale * curvature * distance
        x, y = x + distance * cos(heading + 0.5 * turn), y + distance * sin(heading + 0.5 * turn)
        heading += turn
        least = min(least, room(grid, body, x, y, heading))
        if least < stop:
            break
    return (x, y, heading, distance, curvature), least


class _Search(NamedTuple):
    """The fixed quantities of a search."""

    light: tuple[float, float]
    k: Array
    c: Array
    scale: float
    goal: float
    spread: tuple[float, float, float]
    grid: Array
    body: tuple[float, float, float]
    sharpest: float
    """The largest curvature, 1/m."""
    step: float
    """The longest distance in a decision, m."""
    circle: int
    """Decisions of the smallest circle, the most that a piece of a plan takes."""


@compiled
def _begun(
    distance: float,
    curvature: float,
    pending: Array,
    k: Array,
    c: Array,
    scale: float,
    grid: Array,
    body: tuple[float, float, float],
) -> tuple[tuple[float, float, float, float, float], float, float]:
    """The pose after the actions under way, the sharpest curvature (1/m) and the longest step (m) of all actions."""
    pose = (0.0, 0.0, 0.0, distance, curvature)
    for one in pending:
        pose, _ = clear_along(pose, one, 1, k, c, scale, grid, body, inf)
    sharpest, step = 1e-3, 1e-9
    for b in range(c.shape[1] - 1):
        sharpest = max(sharpest, abs(scale * c[1, b] / (1.0 - k[1])))
        step = max(step, abs(c[0, b] / (1.0 - k[0])))
    return pose, sharpest, step


@compiled
def _driven(
    pose: tuple[float, float, float, float, float], low: float, b: int, steps: int, search: _Search
) -> tuple[tuple[float, float, float, float, float], float]:
    """Drive a piece of a plan, as `clear_along`."""
    return clear_along(pose, b, steps, search.k, search.c, search.scale, search.grid, search.body, low)  # type: ignore[no-any-return]


@compiled
def _least(pose: tuple[float, float, float, float, float], low: float, done: int, search: _Search) -> float:
    """The least cost of a plan that is at a pose after `done` decisions, with the rest straight ahead at top speed."""
    away = hypot(search.light[0] - pose[0], search.light[1] - pose[1]) - search.goal
    cost: float = done + max(0.0, away) / search.step + fine(low)
    return cost


@compiled
def _ended(
    pose: tuple[float, float, float, float, float], low: float, e: int, done: int, best: float, search: _Search
) -> tuple[float, float]:
    """Cost and time of a plan that ends with action e after `done` decisions; inf if it costs no less than `best`."""
    x, y, heading, distance, curvature = pose
    east, north = search.light[0] - x, search.light[1] - y
    cos_h, sin_h = cos(heading), sin(heading)
    ahead, left = cos_h * east + sin_h * north, cos_h * north - sin_h * east
    k, c, scale = search.k, search.c, search.scale
    last = onwards(
        ahead, left, heading, distance, curvature, e, k, c, scale, search.goal, search.spread, search.sharpest
    )
    if done + last + fine(low) >= best:
        return inf, inf
    _, low = _driven(pose, low, e, int(min(last, search.circle)) + 1, search)
    return done + last + fine(low), done + last


@compiled
def _second_piece(
    pose: tuple[float, float, float, float, float], low: float, b: int, done: int, best: float, search: _Search
) -> tuple[float, float, int, int]:
    """The least cost of the plans that drive b for n decisions and then e; its time, n and e.

    Returns `best` and an infinite time if all of them cost more.
    """
    time, piece, last = inf, 0, b
    for n in range(1, search.circle):
        pose, low = _driven(pose, low, b, 1, search)
        if _least(pose, low, done + n, search) >= best:
            break
        if n % STRIDE:
            continue
        for e in range(search.c.shape[1] - 1):
            if e != b:
                cost, takes = _ended(pose, low, e, done + n, best, search)
                if cost < best:
                    best, time, piece, last = cost, takes, n, e
    return best, time, piece, last


@compiled
def quickest_clear(
    light: Belief,
    distance: float,
    curvature: float,
    pending: Array,
    k: Array,
    c: Array,
    scale: float,
    goal: float,
    graze: float,
    grid: Array,
    body: tuple[float, float, float],
    before: tuple[int, int, int, int, int],
) -> tuple[int, int, int, int, int, float, float]:
    """The plan (a, m, b, n, e) of the least cost, its time in decisions, and its cost; `before`: the first to be tried.

    The other arguments are those of `quickest`, and the result of `distances`.
    """
    x, y, xx, yy, xy = light
    pose, sharpest, step = _begun(distance, curvature, pending, k, c, scale, grid, body)
    circle = int(min(2.0 * pi / (sharpest * step), 1e3))
    spread = (xx + graze * graze, yy + graze * graze, xy)
    search = _Search((x, y), k, c, scale, goal, spread, grid, body, sharpest, step, circle)
    best, time, plan = inf, inf, (0, 0, 0, 0, 0)
    a, m, b, n, e = before
    if m >= 0:
        there, low = _driven(pose, inf, a, m, search)
        there, low = _driven(there, low, b, n, search)
        best, time = _ended(there, low, e, m + n, inf, search)
        plan = before if best < inf else plan
    actions = c.shape[1] - 1
    for a in range(actions):
        there, low = pose, inf
        for m in range(circle):
            if m:
                there, low = _driven(there, low, a, 1, search)
            if _least(there, low, m, search) >= best:
                break
            if m > 2 and m % STRIDE:
                continue
            for b in range(actions):
                if (b == a) != (m == 0):
                    continue
                cost, takes = _ended(there, low, b, m, best, search)
                if cost < best:
                    best, time, plan = cost, takes, (a, m, b, 0, b)
                if m:
                    cost, takes, n, e = _second_piece(there, low, b, m, best, search)
                    if cost < best:
                        best, time, plan = cost, takes, (a, m, b, n, e)
    return plan[0], plan[1], plan[2], plan[3], plan[4], time, best


@compiled
def clearest(
    wanted: int,
    distance: float,
    curvature: float,
    pending: Array,
    k: Array,
    c: Array,
    scale: float,
    grid: Array,
    body: tuple[float, float, float],
) -> tuple[int, float]:
    """The wanted action, if the robot can keep clear for a circle after it; otherwise the action with most room.

    With that room, m, but no more than `MARGIN`.
    """
    pose, sharpest, step = _begun(distance, curvature, pending, k, c, scale, grid, body)
    actions = c.shape[1] - 1
    circle = int(min(2.0 * pi / (sharpest * step), 200.0))
    best, most = wanted, -inf
    for offset in range(actions):
        a = (wanted + offset) % actions
        first, low_a = clear_along(pose, a, 2, k, c, scale, grid, body, inf, 0.0)
        for b in range(actions):
            _, low = clear_along(first, b, circle, k, c, scale, grid, body, low_a, 0.0)
            if offset == 0 and low >= MARGIN:
                return wanted, MARGIN
            if min(low, MARGIN) > most:
                best, most = a, min(low, MARGIN)
    return best, most
