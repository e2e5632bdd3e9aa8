"""What each action does, as it was seen to do, and the quickest course to the light by it.

    d' = k d + c(a),  (h/d)' = l (h/d) + e(a)        a: the action in force, d and h: distance and turn in a decision

by least squares that forget; a plan is "a for m decisions, then b", with b for good.
"""

from functools import partial
from math import acos, atan2, cos, erfc, floor, hypot, inf, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from txt1.sim.batch import compiled as compiled_anew

Array = NDArray[np.float64]
Place = tuple[float, float]
compiled = partial(compiled_anew, cache=True)  # as everything that these functions call stands in this file


class Effects:
    """What each action does to distance and curvature, were it in force 0, 1, 2, ... decisions after it was taken.

    y' = k y + c(a), with one k for all, by least squares that forget; the last action stands for none.
    """

    def __init__(self, actions: int, delays: int) -> None:
        self.sums = np.zeros((delays, 2, actions + 1, 5))  # of 1, y, y', y^2, y y': of distance, and of curvature
        self.sums[..., 3] = 1e-6
        self.error = np.zeros(delays)  # mean squares of what was foretold wrong
        self.k = np.zeros((delays, 2))
        self.c = np.zeros((delays, 2, actions + 1))

    def learn(self, taken: NDArray[np.int64], distance: Place, curvature: Place, forgets: float) -> None:
        """Take distances and curvatures before and after a decision; `taken` are the last actions, the latest first."""
        learn_effects(self.sums, self.error, self.k, self.c, taken, distance, curvature, forgets)

    def numbers(self) -> Array:
        """How wrong each delay is, k, c, and weight, mean and mean square of what was before; alike for like robots."""
        weight, before, square = self.sums[..., 0], self.sums[..., 1], self.sums[..., 3]
        once = weight > 1e-9
        means = [np.divide(each, weight, out=np.zeros_like(weight), where=once) for each in (before, square)]
        return np.concatenate([each.ravel() for each in (self.error, self.k, self.c, weight, *means)])

    def take(self, numbers: Array) -> None:
        """Take over what `numbers` gave: what followed on what was before is what its k and c say."""
        ends = np.cumsum([self.error.size, self.k.size, self.c.size])
        error, k, c, rest = np.split(numbers, ends)
        weight, mean, square = rest.reshape(3, *self.c.shape)
        weight = np.maximum(weight, 0.0)
        before, squared = weight * mean, weight * np.maximum(square, mean * mean) + 1e-6
        self.error, self.c = np.maximum(error, 0.0), c.reshape(self.c.shape).copy()
        self.k = np.clip(k, 0.0, 0.95).reshape(self.k.shape)
        slope = self.k[..., None]
        after, product = slope * before + self.c * weight, slope * squared + self.c * before
        self.sums = np.stack([weight, before, after, squared, product], axis=-1)


@compiled
def learn_effects(
    sums: Array,
    error: Array,
    k: Array,
    c: Array,
    taken: NDArray[np.int64],
    distance: Place,
    curvature: Place,
    forgets: float,
) -> None:
    """See `Effects.learn`."""
    weight = distance[1] * distance[1]
    for delay in range(sums.shape[0]):
        a = taken[delay]
        miss = (k[delay, 1] * curvature[0] + c[delay, 1, a] - curvature[1]) ** 2 * weight
        miss += (k[delay, 0] * distance[0] + c[delay, 0, a] - distance[1]) ** 2
        error[delay] += 0.03 * (miss - error[delay])
        for row in range(2):
            y, y_next = distance if row == 0 else curvature
            w = 1.0 if row == 0 else weight
            one = sums[delay, row]
            one[a] *= forgets
            one[a, 0] += w
            one[a, 1] += w * y
            one[a, 2] += w * y_next
            one[a, 3] += w * y * y
            one[a, 4] += w * y * y_next
            within = across = 1e-12
            for b in range(one.shape[0]):
                within += one[b, 3] - one[b, 1] * one[b, 1] / (one[b, 0] + 1e-12)
                across += one[b, 4] - one[b, 1] * one[b, 2] / (one[b, 0] + 1e-12)
            k[delay, row] = min(max(across / within, 0.0), 0.95)
            for b in range(one.shape[0]):
                c[delay, row, b] = (one[b, 2] - k[delay, row] * one[b, 1]) / (one[b, 0] + 1e-12)


@compiled
def _to_circle(ahead: float, left: float, curvature: float, goal: float) -> tuple[float, float]:
    """Distance along an arc to a circle of radius `goal` around the light at (ahead, left), how deep it enters.

    A depth below 0 is by how much it misses it; the distance is then that to the place nearest to the light.
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
def quickest(
    ahead: float, left: float, distance: float, curvature: float, pending: NDArray[np.int64], k: Array, c: Array,
    every: Array, scale: float, goal: float, doubt: float, horizon: int,
) -> tuple[int, float]:  # fmt: skip
    """The first action of the plan "a for m decisions, then b" that is quickest on average, and its decisions.

    The light is at (ahead, left), which like the goal's distance has the standard deviation `doubt`: a plan that grazes
    the goal may miss it, and then costs a circle more. Distance and curvature are those of the last decision. Actions
    that are under way come first. `k`, `c` and `every` (with the action that stands for none): see `Effects`.
    """
    settle = 6  # decisions after which distance and curvature of an action have come to rest
    for a in pending:
        distance = k[0] * distance + every[0, a]
        curvature = k[1] * curvature + every[1, a]
        turn = scale * curvature * distance
        cos_turn, sin_turn = cos(turn), sin(turn)
        x, y = ahead - distance * cos(0.5 * turn), left - distance * sin(0.5 * turn)
        ahead, left = cos_turn * x + sin_turn * y, cos_turn * y - sin_turn * x
    sharpest = 1e-3
    for b in range(c.shape[1]):
        sharpest = max(sharpest, abs(scale * c[1, b] / (1.0 - k[1])))
    best, action = inf, 0
    for a in range(c.shape[1]):
        at_x, at_y, step, bend = ahead, left, distance, curvature
        for m in range(horizon):
            if m <= 6 or m % 3 == 0:
                for b in range(c.shape[1]):
                    if b == a and m > 0:
                        continue
                    x, y, d, e = at_x, at_y, step, bend
                    time = float(m)
                    r = hypot(x, y)
                    for _ in range(settle):
                        d = k[0] * d + c[0, b]
                        e = k[1] * e + c[1, b]
                        turn = scale * e * d
                        cos_turn, sin_turn = cos(turn), sin(turn)
                        x, y = x - d * cos(0.5 * turn), y - d * sin(0.5 * turn)
                        x, y = cos_turn * x + sin_turn * y, cos_turn * y - sin_turn * x
                        before, r = r, hypot(x, y)
                        if r <= goal:
                            time += (before - goal) / max(before - r, 1e-9)
                            break
                        time += 1.0
                    if r > goal:
                        d, e = c[0, b] / (1.0 - k[0]), scale * c[1, b] / (1.0 - k[1])
                        if abs(d) < 1e-9:
                            continue
                        length, deep = _to_circle(x, y, e, goal) if d > 0.0 else _to_circle(-x, y, -e, goal)
                        misses = 0.5 * erfc(deep / doubt * sqrt(0.5))
                        time += (length + misses * 2.0 * pi / sharpest) / abs(d)
                    if time < best:
                        best, action = time, a if m > 0 else b
            step = k[0] * step + c[0, a]
            bend = k[1] * bend + c[1, a]
            turn = scale * bend * step
            cos_turn, sin_turn = cos(turn), sin(turn)
            at_x, at_y = at_x - step * cos(0.5 * turn), at_y - step * sin(0.5 * turn)
            at_x, at_y = cos_turn * at_x + sin_turn * at_y, cos_turn * at_y - sin_turn * at_x
            if hypot(at_x, at_y) <= goal:
                break
    return action, best
