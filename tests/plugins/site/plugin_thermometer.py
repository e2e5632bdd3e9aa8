"""A thermometer, simulated: it warms up by a tenth of a degree a second."""

from __future__ import annotations

from txt1.sensors import Reading, Setup, reading_topic


class Thermometer:
    period, simulated = 0.5, True

    def __init__(self, setup: Setup) -> None:
        self.topic = reading_topic(setup.name, float, "degrees Celsius", "a temperature")
        self._start = float(setup.options.get("start", 20.0))
        self._last = -1.0

    async def open(self) -> None:
        self._last = -1.0

    async def close(self) -> None: ...

    def read(self, now: float) -> Reading[float] | None:
        if now <= self._last:
            return None
        self._last = now
        return Reading(now, self._start + 0.1 * now)


create = Thermometer
