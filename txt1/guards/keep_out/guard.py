"""A guard of the safety gate that keeps the robot out of the areas that its map says to keep out of.

Its speed allows a stop before the body touches an area, forward and backward, as far as the robot knows its pose on the
map. A robot that stands inside an area, because it was carried there, may leave it.
"""

from __future__ import annotations

from math import cos, hypot, inf, sin
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from txt1.guards.obstacle_stop.free_distance import free_distance, stopping_speed
from txt1.guards.obstacle_stop.guard import LaserGuard
from txt1.guards.obstacle_stop.settings import ObstacleStop
from txt1.maps.keep_out import Area, border, inside
from txt1.tasks.on_map import MapInUse

if TYPE_CHECKING:
    from txt1.runtime import Runtime

BORDER_SPACING: Final = 0.03
"""m between the points of a border."""
OVERRUN: Final = 0.02
"""m by which the body counts as longer at both ends: that much farther it may roll."""


class AreaGuard:
    """Keeps the speed such that the robot can stop before it enters an area."""

    def __init__(self, runtime: Runtime, there: MapInUse, parameters: ObstacleStop) -> None:
        self._runtime, self._there, self._parameters = runtime, there, parameters
        self._alone = runtime.part(LaserGuard) is None
        self._borders: tuple[tuple[Area, Any], ...] = ()
        self._areas: tuple[Area, ...] = ()
        self._slowed = False

    def __call__(self, v: float, omega: float, now: float) -> tuple[float, float]:
        """Return the set-point with its speed lowered, on the same arc."""
        gate, limit = self._runtime.gate, self._limit(v, omega)
        slowed = abs(v) > limit
        if self._alone or slowed:
            gate.limited = slowed
        if slowed and not self._slowed:
            self._runtime.state.tell(now, f"slowed to {limit:.2f} m/s: the map says to keep out of what is ahead")
        self._slowed = slowed
        return (v * limit / abs(v), omega * limit / abs(v)) if slowed else (v, omega)

    @property
    def margin(self) -> float:
        """The distance kept round the body, m."""
        return self._parameters.margin if self._there.keep_out() else 0.0

    def _limit(self, v: float, omega: float) -> float:
        """Return the largest speed on the arc of a set-point, m/s; inf if no area is near, or the pose is unknown."""
        areas, pose = self._there.keep_out(), self._there.pose()
        if v == 0.0 or not areas or pose is None or pose.lost:
            return inf
        if areas is not self._areas:
            self._areas, self._borders = areas, tuple((area, border(area, BORDER_SPACING)) for area in areas)
        outside = [points for area, points in self._borders if not inside(area, pose.x, pose.y)]
        if not outside:
            return inf
        p, body = self._parameters, self._runtime.config.geometry
        dx, dy = (np.concatenate(outside) - (pose.x, pose.y)).T
        reach = abs(v) * p.reaction + 0.5 * v * v / p.deceleration + hypot(body.length, body.width) + p.margin
        near = np.hypot(dx, dy) < reach
        if not near.any():
            return inf
        dx, dy, c, s = dx[near], dy[near], cos(pose.theta), sin(pose.theta)
        # backward, the body and what is behind it are mirrored
        gear = 1.0 if v > 0.0 else -1.0
        x, y, centre = gear * (c * dx + s * dy), c * dy - s * dx, gear * body.centre
        # a body that is partly inside may leave
        length = body.length + 2.0 * OVERRUN
        left = (x < centre) & (x > centre - 0.5 * length) & (np.abs(y) < 0.5 * body.width)
        points = np.column_stack((x, y))[~left]
        free = free_distance(points, omega / v, length, body.width, p.margin, centre)
        return inf if free == inf else stopping_speed(free, p.reaction, p.deceleration)


async def prepare(runtime: Runtime, _: object) -> AreaGuard | None:
    """Add the guard to the safety gate; return None without a map in which the robot drives."""
    there = runtime.part(MapInUse)
    if there is None or there.making:
        return None
    guard = AreaGuard(runtime, there, runtime.config.section(ObstacleStop))
    runtime.guard("keep_out", guard)
    return guard
