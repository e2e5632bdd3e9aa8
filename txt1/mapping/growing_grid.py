"""The occupancy grid of a map in the making: new keyframes are added; after a loop has moved them all are drawn
again.
"""

from __future__ import annotations

from math import radians
from typing import Final

import numpy as np

from txt1.mapping.grid_files import FLOOR_MARGIN, RESOLUTION, fitting, occupancy
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
        self.resolution = resolution
        """Side of a cell, m; it is doubled when the map has become too large."""
        self._poses = np.empty((0, 3))
        # indices of the lower left cell
        self._left = self._bottom = 0
        self._hits = self._passes = np.zeros((0, 0), np.int32)

    def update(self, mapper: Mapper) -> Grid | None:
        """Return the grid of a mapper's keyframes; None if it is unchanged."""
        poses = mapper.graph.poses.copy()
        known = len(self._poses)
        steps = difference(self._poses, poses[:known])
        moved = (np.hypot(steps[:, 0], steps[:, 1]) > SHIFTED) | (np.abs(steps[:, 2]) > TURNED)
        if len(poses) == known and not moved.any():
            return None
        coarsened = self._coarsened(poses, mapper)
        if moved.any() or coarsened:
            known = 0
            self._hits = self._passes = np.zeros((0, 0), np.int32)
        ends = [placed(pose, key.cloud.points) for pose, key in zip(poses[known:], mapper.keys[known:], strict=True)]
        self._make_room([*ends, poses[known:, :2]])
        corner = np.array([self._left, self._bottom])
        for pose, end in zip(poses[known:], ends, strict=True):
            x, y = pose[:2] / self.resolution - corner
            mapper.loops.carve(self._hits, self._passes, end / self.resolution - corner, x, y)
        self._poses = poses
        origin = self._left * self.resolution, self._bottom * self.resolution, 0.0
        return Grid(occupancy(self._hits, self._passes), self.resolution, origin)

    def _coarsened(self, poses: Array, mapper: Mapper) -> bool:
        """Enlarge the cells if the map has become too large; return whether they are larger now."""
        rows, columns = self._hits.shape
        corner = np.array([self._left, self._bottom], float) * self.resolution
        ends = [
            placed(pose, key.cloud.points)
            for pose, key in zip(poses[len(self._poses) :], mapper.keys[len(self._poses) :], strict=True)
        ]
        every = np.concatenate((poses[:, :2], *ends))
        low, high = every.min(axis=0) - FLOOR_MARGIN - ROOM, every.max(axis=0) + FLOOR_MARGIN + ROOM
        if rows:
            low = np.minimum(low, corner)
            high = np.maximum(high, corner + self.resolution * np.array([columns, rows]))
        before, self.resolution = self.resolution, fitting(low, high, self.resolution)
        return self.resolution > before

    def _make_room(self, points: list[Array]) -> None:
        """Enlarge the grid so that it contains all points, m."""
        found = [each for each in points if len(each)]
        low = (np.min([each.min(axis=0) for each in found], axis=0) - FLOOR_MARGIN) / self.resolution
        high = (np.max([each.max(axis=0) for each in found], axis=0) + FLOOR_MARGIN) / self.resolution
        rows, columns = self._hits.shape
        left, bottom = (int(each) for each in np.floor(low))
        right, top = (int(each) + 1 for each in np.floor(high))
        if rows:
            inside = left >= self._left and bottom >= self._bottom
            if inside and right <= self._left + columns and top <= self._bottom + rows:
                return
            more = int(ROOM / self.resolution)
            left = self._left if left >= self._left else left - more
            bottom = self._bottom if bottom >= self._bottom else bottom - more
            right = self._left + columns if right <= self._left + columns else right + more
            top = self._bottom + rows if top <= self._bottom + rows else top + more
        hits, passes = np.zeros((2, top - bottom, right - left), np.int32)
        if rows:
            up, right_on = self._bottom - bottom, self._left - left
            there = slice(up, up + rows), slice(right_on, right_on + columns)
            hits[there], passes[there] = self._hits, self._passes
        self._hits, self._passes, self._left, self._bottom = hits, passes, left, bottom
