"""The effects of each action, as observed, and the quickest course to the light by them.

    d' = k d + c(a),  (h/d)' = l (h/d) + e(a)        a: the action in force, d and h: distance and turn in a decision

The coefficients come from least squares that forget. A plan is "a for m decisions, then b", with b for good.
"""

from functools import partial
from math import acos, atan2, cos, erfc, floor, hypot, inf, pi, sin, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.sim.batch import compiled as compiled_anew

Array = NDArray[np.float64]
Place = tuple[float, float]
# the light's place (forward, left); variances, and covariance
Belief = tuple[float, float, float, float, float]
# decisions after which an action's distance and curvature have settled
SETTLE: Final = 6
# for functions that call no function of another file, as the cache would not notice its change
compiled = partial(compiled_anew, cache=True)


class Effects:
    """The effects of each action on distance and curvature, for each delay of 0, 1, 2, ... decisions.

    y' = k y + c(a), with one k for all actions, by least squares that forget; the last action stands for "no action".
    """

    def __init__(self, actions: int, delays: int) -> None:
        # sums of 1, y, y', y^2, y y': for distance, and for curvature
        self.sums = np.zeros((delays, 2, actions + 1, 5))
        self.sums[..., 3] = 1e-6
        # mean square error of the predictions
        self.error = np.zeros(delays)
        self.k = np.zeros((delays, 2))
        self.c = np.zeros((delays, 2, actions + 1))

    def learn(self, taken: NDArray[np.int64], distance: Place, curvature: Place, forgets: float) -> None:
        """Take distances and curvatures before and after a decision; `taken` are the last actions, the latest first."""
        learn_effects(self.sums, self.error, self.k, self.c, taken, distance, curvature, forgets)

    def numbers(self, delays: int) -> Array:
        """Return the first `delays` delays' errors, k, c, and weight, mean and mean square of the inputs.

        They are equal for equal robots.
        """
        sums = self.sums[:delays]
        weight, before, square = sums[..., 0], sums[..., 1], sums[..., 3]
        once = weight > 1e-9
        means = [np.divide(each, weight, out=np.zeros_like(weight), where=once) for each in (before, square)]
        own = self.error[:delays], self.k[:delays], self.c[:delays]
        return np.concatenate([each.ravel() for each in (*own, weight, *means)])

    def take(self, numbers: Array) -> None:
        """Take over the result of `numbers`; the outputs are computed from its k and c.

        The effects of longer delays are then as those of the last one, and fit worse.
        """
        one = self.c[0].size
        delays = len(numbers) // (1 + 2 + 4 * one)
        error, k, c, rest = np.split(numbers, np.cumsum([delays, 2 * delays, one * delays]))
        longer = np.minimum(np.arange(len(self.error)), delays - 1)
        error = error[longer] + (np.arange(len(self.error)) >= delays) * (1.0 + error.max())
        k, c = k.reshape(delays, 2)[longer], c.reshape(delays, *self.c.shape[1:])[longer]
        weight, mean, square = rest.reshape(3, delays, *self.c.shape[1:])[:, longer]
        weight = np.maximum(weight, 0.0)
        before, squared = weight * mean, weight * np.maximum(square, mean * mean) + 1e-6
        self.error, self.c = np.maximum(error, 0.0), c.copy()
        self.k = np.clip(k, 0.0, 0.95)
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
