"""Poses in the plane as arrays (..., 3) of x, y, theta (m, rad): composition, difference, comparison."""

from __future__ import annotations

from math import atan2, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def wrapped(angle: Any) -> Any:
    """Return the angle within [-pi, pi), rad."""
    return (angle + pi) % (2.0 * pi) - pi


def composed(pose: Any, step: Any) -> Array:
    """Return the pose at `step` from `pose`; the step is in the frame of `pose`."""
    pose, step = np.asarray(pose, dtype=np.float64), np.asarray(step, dtype=np.float64)
    cosine, sine = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    return np.stack(
        (
            pose[..., 0] + cosine * step[..., 0] - sine * step[..., 1],
            pose[..., 1] + sine * step[..., 0] + cosine * step[..., 1],
            wrapped(pose[..., 2] + step[..., 2]),
        ),
        axis=-1,
    )


def difference(pose: Any, other: Any) -> Array:
    """Return `other` in the frame of `pose`: the step with composed(pose, step) equal to `other`."""
    pose, other = np.asarray(pose, dtype=np.float64), np.asarray(other, dtype=np.float64)
    cosine, sine = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = other[..., 0] - pose[..., 0], other[..., 1] - pose[..., 1]
    return np.stack((cosine * x + sine * y, cosine * y - sine * x, wrapped(other[..., 2] - pose[..., 2])), axis=-1)


def placed(pose: Any, points: Array) -> Array:
    """Return points (n, 2), given in the frame of a pose, in the frame of reference of the pose."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(points @ np.array([[cosine, sine], [-sine, cosine]]) + np.asarray(pose)[:2])


def accumulated(start: Any, steps: Array) -> Array:
    """Return the poses along steps from `start` on: one more than there are steps."""
    theta = start[2] + np.concatenate(([0.0], np.cumsum(steps[:, 2])))
    cosine, sine = np.cos(theta[:-1]), np.sin(theta[:-1])
    x = np.concatenate(([0.0], np.cumsum(cosine * steps[:, 0] - sine * steps[:, 1])))
    y = np.concatenate(([0.0], np.cumsum(sine * steps[:, 0] + cosine * steps[:, 1])))
    return np.stack((start[0] + x, start[1] + y, wrapped(theta)), axis=-1)


def trajectory_error(poses: Array, reference: Array) -> float:
    """Return the absolute trajectory error in m: rms difference of positions after the best rigid alignment.

    In the plane the rotation has a closed form (Horn 1987). Tests compare the result with evo's, if it is installed.
    """
    a, b = poses[:, :2] - poses[:, :2].mean(axis=0), reference[:, :2] - reference[:, :2].mean(axis=0)
    angle = atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))
    rotated = placed((0.0, 0.0, angle), a)
    return float(np.sqrt(np.mean(np.sum((rotated - b) ** 2, axis=1))))
