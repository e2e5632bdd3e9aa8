"""Beliefs that know less than before: of the slip, of the speed, of where the car is."""

from collections.abc import Sequence
from math import cos, hypot, sin
from typing import Final

import numpy as np

from txt1.estimation.averaging import SLOT
from txt1.estimation.ekf import OMEGA, ROLLED, SIZE, SLIP, THETA, WIDTH, Array, Belief, Row, belief_of

# m/s, standard deviation of the speed at the start: it may be driving already
SPEED: Final = 0.5

_UNITS: Final = np.eye(SIZE)


def considered(belief: Belief, residual: Sequence[float], h: Sequence[Row], sigmas: Sequence[float]) -> Belief:
    """The belief with the rates that wheels tell, which alone tell nothing of their slip.

    Slip and width are consider states (S. F. Schmidt, Advances in Control Systems 3, 1966): their uncertainty counts,
    but they are not estimated, and the pose follows from the rates. Joseph's form holds for any gain.
    """
    p, rows = belief.covariance, np.array([_UNITS[row] if isinstance(row, int) else row for row in h])
    noise = np.diag(np.square(sigmas))
    rates = rows.copy()
    rates[:, SLIP:] = 0.0
    gain = np.zeros((SIZE, len(rows)))
    both = [ROLLED, OMEGA]
    gain[both] = np.linalg.solve(rates @ p @ rates.T + noise, rates @ p[:, both]).T
    left = np.eye(SIZE) - gain @ rows
    lean = belief.lean
    if lean is not None:
        x, y, theta, rolled, omega, bias, slip, width = (left @ lean.by).tolist()
        lean = lean._replace(by=(x, y, theta, rolled, omega, bias, slip, width))
    return belief_of(np.array(belief.mean) + gain @ np.array(residual), left @ p @ left.T + gain @ noise @ gain.T, lean)


def slipping(belief: Belief, dt: float, density: float) -> Belief:
    """The belief when slip varies for dt seconds with this spectral density, 1/s, and nothing tells of it.

    Way and turn are off by the same share. The slip that lasts is a state of the belief.
    """
    _, _, theta, rolled, omega, _, slip, _ = belief.mean
    v = rolled * (1.0 - slip)
    missed = np.array([v * cos(theta), v * sin(theta), omega])
    covariance = belief.covariance
    covariance[:3, :3] += density * max(dt, 0.0) * np.outer(missed, missed)
    return belief_of(belief.mean, covariance, belief.lean)


def slip_unknown(belief: Belief, sigma: float, track_sigma: float) -> Belief:
    """The belief when nothing is known of slip and track width but their standard deviations.

    The car's speed stays as it is.
    """
    v, covariance = belief.mean[ROLLED] * (1.0 - belief.mean[SLIP]), belief.covariance
    covariance[SLIP:, :] = covariance[:, SLIP:] = 0.0
    covariance[SLIP, SLIP], covariance[WIDTH, WIDTH] = sigma**2, track_sigma**2
    covariance[ROLLED, ROLLED] += SPEED**2
    x, y, theta, _, omega, bias, _, _ = belief.mean
    return belief_of((x, y, theta, v, omega, bias, 0.0, 0.0), covariance, belief.lean)


def widened(belief: Belief, by: Array) -> Belief:
    """The belief with a covariance that is larger by a matrix, shape (8, 8)."""
    return belief_of(belief.mean, belief.covariance + by, belief.lean)


def moved(belief: Belief, by: tuple[float, float, float]) -> Belief:
    """The belief somewhere else (m, m), with this slip."""
    x, y, theta, rolled, omega, bias, _, width = belief.mean
    return Belief((x + by[0], y + by[1], theta, rolled, omega, bias, by[2], width), belief.triangle, belief.lean)


def grown(rows: Sequence[int], residual: Sequence[float], slid: float) -> Array:
    """The covariance of a pose that is off by a residual, and of motion that has changed, shape (8, 8)."""
    spread = np.zeros((SIZE, SIZE))
    size = hypot(*residual[:2])
    for row, each in zip(rows, residual, strict=False):
        spread[row, row] = each * each if row == THETA else 0.5 * size * size
    spread[ROLLED, ROLLED] = (size / SLOT) ** 2 if slid == 0.0 else 0.0
    spread[SLIP, SLIP] = slid * slid
    return spread
