"""A sensor whose readings come late, or not at all."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

import numpy as np

from txt1.sensors.base import Reading, Sensor
from txt1.telemetry.topics import Topic

T = TypeVar("T")


class Impaired(Generic[T]):
    """Another sensor, its readings delayed and some of them lost; they keep the times at which they were taken.

    Args:
        sensor: the sound one.
        delay: of each reading, s.
        drop_out: share of the readings that are lost.
        rng: draws which.

    """

    def __init__(self, sensor: Sensor[T], delay: float, drop_out: float, rng: np.random.Generator) -> None:
        self._sensor = sensor
        self._delay = delay
        self._drop_out = drop_out
        self._rng = rng
        self._under_way: deque[Reading[T]] = deque()
        self.topic: Topic[T] = sensor.topic
        self.period = sensor.period
        self.simulated = sensor.simulated

    async def open(self) -> None:
        """Open the sensor."""
        self._under_way.clear()
        await self._sensor.open()

    async def close(self) -> None:
        """Close the sensor."""
        await self._sensor.close()

    def read(self, now: float) -> Reading[T] | None:
        """The newest reading that has arrived by `now`."""
        reading = self._sensor.read(now)
        if reading is not None and self._rng.random() >= self._drop_out:
            self._under_way.append(reading)
        arrived = None
        while self._under_way and self._under_way[0].time + self._delay <= now:
            arrived = self._under_way.popleft()
        return arrived
