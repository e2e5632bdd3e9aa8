"""The occupancy grid of a map in the making: new keyframes are added; after a loop has moved them all are drawn
again.
"""

from __future__ import annotations

from math import radians
from typing import Final

import numpy as np

from txt1.mapping.grid_files import CELLS_MAX, MARGIN, RESOLUTION, occupancy
from txt1.mapping.mapper import Mapper
from txt1.mapping.poses import Array, difference, placed
from txt1.maps.grid import Grid

ROOM: Final = 2.0
"""m by which the grid grows at a time, so that it is seldom copied."""
SHIFTED: Final = 0.02
"""m that a keyframe may move before everything is drawn again."""
TURNED: Final = radians(0.3)
"""rad, the same."""


class GrowingGrid:
    """Counts of rays in each cell, for the keyframes so far."""

    def __init__(self, resolution: float = RESOLUTION) -> None:
        self._resolution = resolution
        self._poses = np.empty((0, 3))
        # indices of the lower left cell
        self._left = self._bottom = 0
        self._hits = self._passes = np.zeros((0, 0), np.int32)
        self.full = False
        """Whether the map has become too large to be published."""

    def update(self, mapper: Mapper) -> Grid | None:
        """Return the grid of a mapper's keyframes; None if it is unchanged, or too large."""
        poses = mapper.graph.poses.copy()
        known = len(self._poses)
        steps = difference(self._poses, poses[:known])
        moved = (np.hypot(steps[:, 0], steps[:, 1]) > SHIFTED) | (np.abs(steps[:, 2]) > TURNED)
        if len(poses) == known and not moved.any():
            return None
        if moved.any():
            known = 0
            self._hits = self._passes = np.zeros((0, 0), np.int32)
        ends = [placed(pose, key.cloud.points) for pose, key in zip(poses[known:], mapper.keys[known:], strict=True)]
        self._make_room([*ends, poses[known:, :2]])
        if self.full:
            return None
        corner = np.array([self._left, self._bottom])
        for pose, end in zip(poses[known:], ends, strict=True):
            x, y = pose[:2] / self._resolution - corner
            mapper.loops.carve(self._hits, self._passes, end / self._resolution - corner, x, y)
        self._poses = poses
        origin = self._left * self._resolution, self._bottom * self._resolution, 0.0
        return Grid(occupancy(self._hits, self._passes), self._resolution, origin)

    def _make_room(self, points: list[Array]) -> None:
        """Enlarge the grid so that it contains all points, m."""
        found = [each for each in points if len(each)]
        low = (np.min([each.min(axis=0) for each in found], axis=0) - MARGIN) / self._resolution
        high = (np.max([each.max(axis=0) for each in found], axis=0) + MARGIN) / self._resolution
        rows, columns = self._hits.shape
        left, bottom = (int(each) for each in np.floor(low))
        right, top = (int(each) + 1 for each in np.floor(high))
        if rows:
            inside = left >= self._left and bottom >= self._bottom
            if inside and right <= self._left + columns and top <= self._bottom + rows:
                return
            more = int(ROOM / self._resolution)
            left = self._left if left >= self._left else left - more
            bottom = self._bottom if bottom >= self._bottom else bottom - more
            right = self._left + columns if right <= self._left + columns else right + more
            top = self._bottom + rows if top <= self._bottom + rows else top + more
        self.full = (right - left) * (top - bottom) > CELLS_MAX
        if self.full:
            return
        hits, passes = np.zeros((2, top - bottom, right - left), np.int32)
        if rows:
            up, right_on = self._bottom - bottom, self._left - left
            there = slice(up, up + rows), slice(right_on, right_on + columns)
            hits[there], passes[there] = self._hits, self._passes
        self._hits, self._passes, self._left, self._bottom = hits, passes, left, bottom
