"""The frame in which positions are measured, found by laying the driven path over them."""

from collections.abc import Collection
from math import atan2, cos, sin
from typing import Final

import numpy as np

from txt1.estimation.ekf import Array, Seven, X, Y

ALIGNED: Final = 0.1  # rad, the standard deviation at which a heading found from positions is good enough


def aligned(pairs: Collection[tuple[float, ...]]) -> tuple[float, float, float, Array] | None:
    """The turn (rad) and move (m) that bring positions p onto measured ones z, and their covariance; None: too vague.

    Least squares in closed form, S. Umeyama, PAMI 13(4), 1991, in the plane and without scale: with both centred,
    turn = atan2(sum p x z, sum p . z). Its variance is sigma^2 / sum |p|^2, that of the centre sigma^2 / n. Each pair
    is p, z, and sigma, m.
    """
    if len(pairs) < 5:
        return None
    px, py, zx, zy, sigma = np.array(pairs).T
    cx, cy, dx, dy = px.mean(), py.mean(), zx.mean(), zy.mean()
    px, py, zx, zy = px - cx, py - cy, zx - dx, zy - dy
    spread, variance = float(px @ px + py @ py), float(np.mean(sigma**2))
    if spread * ALIGNED**2 < variance:
        return None
    turn = atan2(float(px @ zy - py @ zx), float(px @ zx + py @ zy))
    c, s = cos(turn), sin(turn)
    return (
        turn,
        float(dx - c * cx + s * cy),
        float(dy - s * cx - c * cy),
        np.diag((variance / len(pairs), variance / len(pairs), variance / spread)),
    )


def about(spread: Array, mean: Seven, turn: float, pairs: Collection[tuple[float, ...]]) -> Array:
    """The covariance of a frame (x, y, turn) at the centre of the pairs, at where the robot is instead."""
    px, py = np.mean([pair[:2] for pair in pairs], axis=0)
    dx, dy = mean[X] - float(px), mean[Y] - float(py)
    c, s = cos(turn), sin(turn)
    j = np.eye(3)
    j[0, 2], j[1, 2] = -(s * dx + c * dy), c * dx - s * dy
    moved: Array = j @ spread @ j.T
    return moved
