"""The quickest course to the light, by the effects of each action as observed (`action_effects`).

    d' = k d + c(a),  (h/d)' = l (h/d) + e(a)        a: the action in force, d and h: distance and turn in a decision

A plan is "a for m decisions, then b", with b for good.
"""

from functools import partial
from math import acos, atan2, cos, erfc, floor, hypot, inf, pi, sin, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.sim import machine_code

Array = NDArray[np.float64]
Place = tuple[float, float]
# the light's place (forward, left); variances, and covariance
Belief = tuple[float, float, float, float, float]
# decisions after which an action's distance and curvature have settled
SETTLE: Final = 6
compiled = partial(machine_code.compiled, cache=True)


@compiled
def _to_circle(ahead: float, left: float, curvature: float, goal: float) -> tuple[float, float]:
    """Return the distance along an arc to a circle of radius `goal` around the light, and how deep the arc enters it.

    The light is at (ahead, left). A negative depth is the distance by which the arc misses the circle; the distance is
    then that to the arc's nearest place to the light.
    """
    if abs(curvature) < 1e-3:
        if ahead < 0.0:
            return 0.0, goal - hypot(ahead, left)
        return ahead - sqrt(max(goal * goal - left * left, 0.0)), goal - abs(left)
    if curvature < 0.0:
        left = -left
    radius = 1.0 / abs(curvature)
    rho = hypot(ahead, left - radius)
    cosine = (rho * rho + radius * radius - goal * goal) / (2.0 * rho * radius + 1e-12)
    angle = atan2(left - radius, ahead) - acos(min(max(cosine, -1.0), 1.0)) + 0.5 * pi
    return radius * (angle - 2.0 * pi * floor(angle / (2.0 * pi))), goal - abs(rho - radius)


@compiled
def _driven(
    ahead: float,
    left: float,
    heading: float,
    distance: float,
    curvature: float,
    a: int,
    k: Array,
    c: Array,
    scale: float,
) -> tuple[float, float, float, float, float]:
    """The light's place in the robot's frame, heading, distance and curvature, after a decision with a in force."""
    distance = k[0] * distance + c[0, a]
    curvature = k[1] * curvature + c[1, a]
    turn = scale * curvature * distance
    cos_turn, sin_turn = cos(turn), sin(turn)
    x, y = ahead - distance * cos(0.5 * turn), left - distance * sin(0.5 * turn)
    return cos_turn * x + sin_turn * y, cos_turn * y - sin_turn * x, heading + turn, distance, curvature


@compiled
def onwards(
    ahead: float,
    left: float,
    heading: float,
    distance: float,
    curvature: float,
    b: int,
    k: Array,
    c: Array,
    scale: float,
    goal: float,
    spread: tuple[float, float, float],
    sharpest: float,
) -> float:
    """Return the mean number of decisions that action b takes to the goal; a grazing course may miss and go round
    again.

    `spread` holds the variances of the place of the goal's edge, and their covariance, in the frame of heading 0. The
    result is infinite if the action does not move the robot.
    """
    time, near = 0.0, hypot(ahead, left)
    for _ in range(SETTLE):
        ahead, left, heading, distance, curvature = _driven(ahead, left, heading, distance, curvature, b, k, c, scale)
        before, near = near, hypot(ahead, left)
        if near <= goal:
            time += max(before - goal, 0.0) / max(before - near, 1e-9)
            break
        time += 1.0
    step, bend = c[0, b] / (1.0 - k[0]), scale * c[1, b] / (1.0 - k[1])
    if abs(step) < 1e-9:
        return time if near <= goal else inf
    length, deep = _to_circle(ahead if step > 0.0 else -ahead, left, bend, goal)
    if near > goal:
        time += length / abs(step)
    across = heading + (0.5 * pi if abs(bend) < 1e-3 else atan2(left - 1.0 / bend, ahead))
    x, y = cos(across), sin(across)
    doubt = sqrt(max(x * x * spread[0] + y * y * spread[1] + 2.0 * x * y * spread[2], 1e-12))
    misses = 0.5 * erfc(deep / doubt * sqrt(0.5))
    # the way round, and what is left of the way to the goal
    again = 2.0 * pi / sharpest + max(-deep, 0.0)
    on_average: float = time + misses * again / abs(step)
    return on_average


@compiled
def quickest(
    light: Belief,
    distance: float,
    curvature: float,
    pending: NDArray[np.int64],
    k: Array,
    c: Array,
    scale: float,
    goal: float,
    graze: float,
) -> Array:
    """Return the mean number of decisions to the goal by the quickest plan "a for m, then b"; shape (actions a,).

    Distance and curvature are those of the last decision; pending actions come first. The goal's distance has the
    standard deviation `graze`. `k` and `c`: see `Effects`.
    """
    ahead, left, xx, yy, xy = light
    spread = xx + graze * graze, yy + graze * graze, xy
    heading = 0.0
    for a in pending:
        ahead, left, heading, distance, curvature = _driven(ahead, left, heading, distance, curvature, a, k, c, scale)
    # the last action stands for "no action"
    actions = c.shape[1] - 1
    sharpest = 1e-3
    for b in range(actions):
        sharpest = max(sharpest, abs(scale * c[1, b] / (1.0 - k[1])))
    step = max([abs(c[0, b] / (1.0 - k[0])) for b in range(actions)])
    # decisions; no plan turns farther than a circle at first
    circle = int(min(2.0 * pi / (sharpest * step + 1e-9), 1e4))
    best = np.full(actions, inf)
    for a in range(actions):
        best[a] = onwards(ahead, left, heading, distance, curvature, a, k, c, scale, goal, spread, sharpest)
        x, y, h, d, e = ahead, left, heading, distance, curvature
        for m in range(1, circle):
            x, y, h, d, e = _driven(x, y, h, d, e, a, k, c, scale)
            if m >= best[a] or hypot(x, y) <= goal:
                break
            for b in range(actions):
                if b != a:
                    best[a] = min(best[a], m + onwards(x, y, h, d, e, b, k, c, scale, goal, spread, sharpest))
    return best
