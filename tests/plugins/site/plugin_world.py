"""A world: the light drifts away along x, odometry doubles every way, and there is a post."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from txt1 import Odometry
from txt1.config import Config
from txt1.learning.agent import Readings
from txt1.learning.world import LightWorld, Pose

SPEED = 0.02  # m/s


class Odd(LightWorld):
    @staticmethod
    def settings(config: Config) -> Mapping[str, Any]:
        return {"sim.obstacles": [{"kind": "post", "x": -1.6, "y": 0.0, "radius": 0.1}]}

    def goal(self, now: float) -> tuple[float, float]:
        return SPEED * now, 0.0

    def see(self, now: float, pose: Pose) -> Readings:
        x, y, theta = pose
        return super().see(now, (x - SPEED * now, y, theta))  # as if the light stood still

    def odometry(self, now: float, odometry: Odometry) -> Odometry:
        return odometry._replace(x=2.0 * odometry.x, y=2.0 * odometry.y, v=2.0 * odometry.v)
