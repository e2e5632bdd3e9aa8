"""The frame in which positions are measured, found by laying the driven path over them."""

from collections.abc import Collection
from math import atan2, cos, sin
from typing import Final

import numpy as np

from txt1.estimation.ekf import Array, State, X, Y

# rad, the standard deviation at which a heading found from positions is good enough
ALIGNED: Final = 0.25

# pairs that a frame is found from
LEAST: Final = 5
# sigma from where a fit has it, beyond which a position is left out: 99.9 % of two numbers
FAR: Final = 3.7


def aligned(pairs: Collection[tuple[float, ...]]) -> tuple[float, float, float, Array] | None:
    """The turn (rad) and move (m) that bring positions p onto measured ones z, and their covariance; None: too vague.

    Least squares in closed form, S. Umeyama, PAMI 13(4), 1991, in the plane and without scale: with both centred,
    turn = atan2(sum p x z, sum p . z). Its variance is sigma^2 / sum |p|^2, that of the centre sigma^2 / n. Each pair
    is p, z, and sigma, m. Pairs that are left more than `FAR` sigma away are left out, the farthest first (trimmed
    least squares, P. J. Rousseeuw, JASA 79, 1984).
    """
    kept = np.array(list(pairs))
    while len(kept) >= LEAST:
        turn, x, y, spread, variance = _fitted(kept)
        c, s = cos(turn), sin(turn)
        px, py, zx, zy, sigma = kept.T[:5]
        left = np.hypot(zx - x - c * px + s * py, zy - y - s * px - c * py) / sigma
        worst = int(left.argmax())
        if left[worst] > FAR:
            kept = np.delete(kept, worst, axis=0)
            continue
        if spread * ALIGNED**2 < variance:
            return None
        return turn, x, y, np.diag((variance / len(kept), variance / len(kept), variance / spread))
    return None


def _fitted(pairs: Array) -> tuple[float, float, float, float, float]:
    """The turn, the move, the spread of the positions and the variance of a measured one."""
    px, py, zx, zy, sigma = pairs.T[:5]
    cx, cy, dx, dy = px.mean(), py.mean(), zx.mean(), zy.mean()
    px, py, zx, zy = px - cx, py - cy, zx - dx, zy - dy
    turn = atan2(float(px @ zy - py @ zx), float(px @ zx + py @ zy))
    c, s = cos(turn), sin(turn)
    spread, variance = float(px @ px + py @ py), float(np.mean(sigma**2))
    return turn, float(dx - c * cx + s * cy), float(dy - s * cx - c * cy), spread, variance


def about(spread: Array, mean: State, turn: float, pairs: Collection[tuple[float, ...]]) -> Array:
    """The covariance of a frame (x, y, turn) at the centre of the pairs, at where the robot is instead."""
    px, py = np.mean([pair[:2] for pair in pairs], axis=0)
    dx, dy = mean[X] - float(px), mean[Y] - float(py)
    c, s = cos(turn), sin(turn)
    j = np.eye(3)
    j[0, 2], j[1, 2] = -(s * dx + c * dy), c * dx - s * dy
    moved: Array = j @ spread @ j.T
    return moved


def leaning(pairs: Collection[tuple[float, ...]]) -> tuple[float, float, float, float, float]:
    """How a turn leans whose pairs lean, rad, and the means of p and of its lean, m; each pair ends with that of p.

    The derivative of the fit's turn by a parameter that moves the positions p, as `ekf.Lean` has it.
    """
    rows = np.array(list(pairs))
    cx, cy, lx, ly = (float(each) for each in rows[:, (0, 1, 5, 6)].mean(axis=0))
    px, py, by_x, by_y = (rows[:, (0, 1, 5, 6)] - (cx, cy, lx, ly)).T
    return -float(px @ by_y - py @ by_x) / float(px @ px + py @ py), cx, cy, lx, ly
