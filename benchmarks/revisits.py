"""How well a map fits where the robot came back to a place: the offset of each such keyframe from the older scans.

A keyframe is a revisit if it lies within `NEAR` of one that is at least `WAY` of driving older, and its scan fits the
scans round the older one with a score of at least `FITS`. It is matched with these scans alone, all at their places on
the map. Its offset is how far it has to be moved so that it fits best, m.
"""

from __future__ import annotations

from math import hypot, radians
from typing import Final

import numpy as np

from txt1.mapping.mapper import Mapper
from txt1.mapping.matcher import LocalMap, joined, sparse
from txt1.mapping.poses import Array, composed, difference

NEAR: Final = 1.5  # m
WAY: Final = 6.0  # m
FITS: Final = 0.35
AROUND: Final = 8  # keyframes on each side of the older one
REACH: Final = 0.6  # m
TURN: Final = radians(8.0)


def offsets(mapper: Mapper, poses: Array) -> dict[int, float]:
    """The offset of each revisit, m, by its keyframe; `poses` are those of the keyframes, shape (n, 3)."""
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
    found = {}
    for new, pose in enumerate(poses):
        older = int(np.searchsorted(along, along[new] - WAY))
        away = np.hypot(*(poses[:older, :2] - pose[:2]).T)
        if not older or away.min() > NEAR:
            continue
        nearest = int(away.argmin())
        around = range(max(0, nearest - AROUND), min(nearest + AROUND + 1, older))
        clouds = [mapper.keys[k].cloud for k in around]
        there = LocalMap(joined(clouds, difference(pose, poses[list(around)])), mapper.loops)
        cloud, here = mapper.keys[new].cloud, np.zeros(3)
        score, start = there.search(sparse(cloud, 200), here, REACH, TURN, (2.0 * REACH, 2.0 * TURN), FITS)
        if score > FITS:
            step = there.align(cloud, start, start, 1e-6 * np.eye(3))[0]
            found[new] = hypot(step[0], step[1])
    return found


def by_wheels(mapper: Mapper, odometry: Array) -> Array:
    """The keyframes' poses by odometry alone, in the frame of the first; `odometry` has a row for each scan."""
    rows = odometry[[key.number for key in mapper.keys]]
    return composed(mapper.graph.poses[0], difference(rows[0], rows))
