"""The quickest course to the light that keeps clear of what the laser has seen.

A plan is "a for m decisions, b for n, then e", with e for good. Its cost is its time, and more where the body comes
nearer than `MARGIN` to a point that the laser has seen:

    cost = time + STEEP * max(0, MARGIN - clearance)  [+ TOUCHES where the clearance is less than NEAREST]

All plans are searched by branch and bound. What a plan costs at least is known from its first pieces: the time so far,
the straight way to the goal at the highest speed, and the clearance so far, which can only become less. The rest of the
plan before is tried first, so a course that was found clear is still there when the next decision comes.

The body is three discs in a row. The clearance comes from a grid of distances to the points, in the robot's frame.
"""

from math import cos, floor, hypot, inf, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from txt1.learning.planner import Array, Belief, compiled, onwards
from txt1.sim.batch import compiled as compiled_anew

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
# m, up to which distances count: more than the body's discs and the margin
REACH: Final = 0.6


class Discs(NamedTuple):
    """The robot's body, m: three discs of this radius, so far apart, the middle one so far ahead of the pose."""

    radius: float
    apart: float
    ahead: float


def body_of(length: float, width: float, centre: float) -> Discs:
    """The discs that cover a rectangle."""
    return Discs(hypot(length / 6.0, 0.5 * width), length / 3.0, centre)


class ActionPlan(NamedTuple):
    """Action a for m decisions, b for n, then e; what it takes, decisions, and its cost."""

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
        # x, y, heading on the map
        self.pose = (0.0, 0.0, 0.0)

    def move(self, distance: float, turn: float) -> None:
        """Move the robot on the map."""
        x, y, heading = self.pose
        middle = heading + 0.5 * turn
        self.pose = x + distance * cos(middle), y + distance * sin(middle), heading + turn

    def add(self, points: Array, since: tuple[float, float, float]) -> None:
        """Take a sweep's points, seen `since` the robot has moved by (x, y, turn) in its frame of then."""
        ahead, left, turn = since
        back_x, back_y = points[:, 0] - ahead, points[:, 1] - left
        c, s = cos(turn), sin(turn)
        x, y, heading = self.pose
        here_x, here_y = c * back_x + s * back_y, c * back_y - s * back_x
        c, s = cos(heading), sin(heading)
        self._sweeps.append(np.column_stack((x + c * here_x - s * here_y, y + s * here_x + c * here_y)))
        del self._sweeps[:-SWEEPS]

    def near(self) -> Array:
        """The points in the robot's frame that lie on the grid, each place once; shape (n, 2), m."""
        if not self._sweeps:
            return np.empty((0, 2))
        points = np.concatenate(self._sweeps)
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
    """What too little room costs, decisions."""
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
) -> tuple[tuple[float, float, float, float, float], float]:
    """Drive an action for some decisions; the pose, distance and curvature at the end, and the least room on the way.

    Nothing is driven on after a contact.
    """
    x, y, heading, distance, curvature = pose
    for _ in range(steps):
        distance = k[0] * distance + c[0, b]
        curvature = k[1] * curvature + c[1, b]
        turn = scale * curvature * distance
        x, y = x + distance * cos(heading + 0.5 * turn), y + distance * sin(heading + 0.5 * turn)
        heading += turn
        least = min(least, room(grid, body, x, y, heading))
        if least < NEAREST:
            break
    return (x, y, heading, distance, curvature), least


@compiled_anew
def _rest(
    pose: tuple[float, float, float, float, float],
    light: tuple[float, float],
    e: int,
    k: Array,
    c: Array,
    scale: float,
    goal: float,
    spread: tuple[float, float, float],
    sharpest: float,
) -> float:
    """Decisions that an action takes from a pose to the goal, as `onwards`."""
    x, y, heading, distance, curvature = pose
    east, north = light[0] - x, light[1] - y
    cos_h, sin_h = cos(heading), sin(heading)
    ahead, left = cos_h * east + sin_h * north, cos_h * north - sin_h * east
    time: float = onwards(ahead, left, heading, distance, curvature, e, k, c, scale, goal, spread, sharpest)
    return time


@compiled_anew
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


@compiled_anew
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

    The other arguments are those of `quickest`, and what `distances` returns.
    """
    lx, ly, xx, yy, xy = light
    at = (lx, ly)
    spread = (xx + graze * graze, yy + graze * graze, xy)
    pose, sharpest, step = _begun(distance, curvature, pending, k, c, scale, grid, body)
    actions = c.shape[1] - 1
    circle = int(min(2.0 * pi / (sharpest * step), 1e3))
    best, time = inf, inf
    plan = (0, 0, 0, 0, 0)
    a, m, b, n, e = before
    if m >= 0:
        there, low = clear_along(pose, a, m, k, c, scale, grid, body, inf)
        there, low = clear_along(there, b, n, k, c, scale, grid, body, low)
        last = _rest(there, at, e, k, c, scale, goal, spread, sharpest)
        if last < inf:
            _, low = clear_along(there, e, int(min(last, circle)) + 1, k, c, scale, grid, body, low)
            best, time, plan = m + n + last + fine(low), m + n + last, before
    for a in range(actions):
        first, low_a = pose, inf
        for m in range(circle):
            if m:
                first, low_a = clear_along(first, a, 1, k, c, scale, grid, body, low_a)
            nearest = max(0.0, hypot(lx - first[0], ly - first[1]) - goal) / step
            if m + nearest + fine(low_a) >= best:
                break
            if m > 2 and m % STRIDE:
                continue
            for b in range(actions):
                if (b == a) != (m == 0):
                    continue
                last = _rest(first, at, b, k, c, scale, goal, spread, sharpest)
                if m + last + fine(low_a) < best:
                    _, low = clear_along(first, b, int(min(last, circle)) + 1, k, c, scale, grid, body, low_a)
                    if m + last + fine(low) < best:
                        best, time, plan = m + last + fine(low), m + last, (a, m, b, 0, b)
                if m == 0:
                    continue
                second, low_b = first, low_a
                for n in range(1, circle):
                    second, low_b = clear_along(second, b, 1, k, c, scale, grid, body, low_b)
                    nearest = max(0.0, hypot(lx - second[0], ly - second[1]) - goal) / step
                    if m + n + nearest + fine(low_b) >= best:
                        break
                    if n % STRIDE:
                        continue
                    for e in range(actions):
                        if e == b:
                            continue
                        last = _rest(second, at, e, k, c, scale, goal, spread, sharpest)
                        if m + n + last + fine(low_b) < best:
                            _, low = clear_along(second, e, int(min(last, circle)) + 1, k, c, scale, grid, body, low_b)
                            if m + n + last + fine(low) < best:
                                best, time, plan = m + n + last + fine(low), m + n + last, (a, m, b, n, e)
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
) -> int:
    """The wanted action, if the robot can keep clear for a circle after it; otherwise the action with most room."""
    pose, sharpest, step = _begun(distance, curvature, pending, k, c, scale, grid, body)
    actions = c.shape[1] - 1
    circle = int(min(2.0 * pi / (sharpest * step), 200.0))
    best, most = wanted, -inf
    for offset in range(actions):
        a = (wanted + offset) % actions
        first, low_a = clear_along(pose, a, 2, k, c, scale, grid, body, inf)
        for b in range(actions):
            _, low = clear_along(first, b, circle, k, c, scale, grid, body, low_a)
            if offset == 0 and low >= MARGIN:
                return wanted
            if min(low, MARGIN) > most:
                best, most = a, min(low, MARGIN)
    return best
