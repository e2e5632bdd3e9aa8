"""Boxes that move along paths. The place of a box depends on time alone, so a run repeats."""

from bisect import bisect_right
from itertools import accumulate, pairwise
from math import atan2, dist

from txt1.sim.parameters import Box, Mover


class Moving:
    """A mover on its path; raises ValueError if the path has no length."""

    def __init__(self, mover: Mover) -> None:
        points = [mover.path[0], *(after for before, after in pairwise(mover.path) if after != before)]
        if mover.lap and points[-1] != points[0]:
            points.append(points[0])
        if len(points) < 2:
            raise ValueError("all points of its path are the same: give two that are apart")
        self.mover, self._points = mover, points
        self._travelled = [0.0, *accumulate(dist(before, after) for before, after in pairwise(points))]

    def at(self, time: float) -> Box:
        """Return the mover's box, `time` s after the start of the first run in its world."""
        length = self._travelled[-1]
        along = max(time, 0.0) * self.mover.speed % (length if self.mover.lap else 2.0 * length)
        along = min(along, 2.0 * length - along) if not self.mover.lap else along
        k = min(bisect_right(self._travelled, along), len(self._points) - 1) - 1
        (x0, y0), (x1, y1) = self._points[k : k + 2]
        share = (along - self._travelled[k]) / (self._travelled[k + 1] - self._travelled[k])
        place = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
        return Box(*place, self.mover.length, self.mover.width, atan2(y1 - y0, x1 - x0))
