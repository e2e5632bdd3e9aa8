"""A toy car as a HAL: it closes its own loops, and drives exactly as it is told."""

from __future__ import annotations

from math import isfinite

from txt1 import Odometry
from txt1.config import Config
from txt1.hal import Capabilities, Inputs, Outputs, PlainHal, advance


class Toy(PlainHal):
    name = "toy"
    capabilities = Capabilities(place=True, pose=True, simulated=True)

    def __init__(self, config: Config) -> None:
        self._time = 0.0
        self.outputs = Outputs()
        self._odometry = self._true = Odometry()

    async def open(self) -> None:
        self.outputs = Outputs()

    async def close(self) -> None:
        self.outputs = Outputs()

    def read(self, now: float) -> Inputs:
        self._advance_to(now)
        return Inputs(odometry=self._odometry, odometry_time=now, pose=self._true[:3])

    def write(self, outputs: Outputs, now: float) -> None:
        self._advance_to(now)
        self.outputs = outputs

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        if not (isfinite(x) and isfinite(y) and isfinite(theta)):
            raise ValueError(f"cannot stand at ({x}, {y}, {theta})")
        self._advance_to(now)
        self._true = Odometry(x, y, theta)

    def _advance_to(self, now: float) -> None:
        v, omega, dt = self.outputs.v, self.outputs.omega, now - self._time
        self._odometry, self._true = advance(self._odometry, v, omega, dt), advance(self._true, v, omega, dt)
        self._time = now


create = Toy
