"""Rough ground: a height at every place, from random waves, and the roll and pitch of a car on it."""

from math import atan, cos, pi, sin
from typing import Final

import numpy as np

from txt1.model.vehicle import Geometry
from txt1.sim.parameters import Roughness
from txt1.sim.random_streams import random_stream

# waves of random direction, length and phase that make the ground
WAVES: Final = 24


class Ground:
    """The ground of a seed, around the room's origin."""

    def __init__(self, parameters: Roughness, body: Geometry, seed: int) -> None:
        rng = np.random.default_rng(random_stream(seed, "ground").getrandbits(128))
        lengths = np.exp(rng.uniform(np.log(parameters.shortest), np.log(parameters.longest), WAVES))
        directions = rng.uniform(-pi, pi, WAVES)
        self.flat = parameters.height == 0.0
        self._amplitude = parameters.height * np.sqrt(2.0 / WAVES)
        self._kx, self._ky = 2.0 * pi / lengths * np.cos(directions), 2.0 * pi / lengths * np.sin(directions)
        self._phases = rng.uniform(-pi, pi, WAVES)
        self._body = body

    def height(self, x: float, y: float) -> float:
        """Return the height at a place in the room, m."""
        return float(self._amplitude * np.sin(self._kx * x + self._ky * y + self._phases).sum())

    def attitude(self, pose: tuple[float, float, float]) -> tuple[float, float]:
        """Return roll (left side up) and pitch (nose down positive), rad, of a car at a pose, from its axles
        and tracks.
        """
        if self.flat:
            return 0.0, 0.0
        x, y, theta = pose
        c, s = cos(theta), sin(theta)
        half, ahead = 0.5 * self._body.track_width, 0.5 * self._body.wheelbase
        side = self.height(x - half * s, y + half * c) - self.height(x + half * s, y - half * c)
        nose = self.height(x + ahead * c, y + ahead * s) - self.height(x - ahead * c, y - ahead * s)
        return atan(side / self._body.track_width), -atan(nose / self._body.wheelbase)
