"""The sensors of one robot: opened and closed with it, each read by a task at its own period."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final, Generic, TypeVar

from txt1.errors import HalError, Txt1Error
from txt1.kernel.scheduler import PeriodicTask
from txt1.kernel.ticks import Ticks
from txt1.sensors.base import Reading, Sensor, SensorState, numbers
from txt1.telemetry.bus import Bus

T = TypeVar("T")

PRIORITY: Final = 0
"""Below the robot's own tasks."""

STALE_PERIODS: Final = 10
STALE_MIN: Final = 1.0
"""A sensor without a reading for so many periods, and at least so many seconds, is unhealthy."""

CLOSING_MAX: Final = 5.0
"""s in which a sensor must have closed."""

AddTask = Callable[[str, int, float, PeriodicTask], None]
Tell = Callable[[float, str], None]


class Polled(Generic[T]):
    """A sensor at work.

    Args:
        name: as configured.
        sensor: to be read.
        period: between two readings, s.

    Attributes:
        last: its last reading.
        needed: asked before each reading where somebody can tell: a sensor that nobody needs is left alone.

    """

    def __init__(self, name: str, sensor: Sensor[T], period: float) -> None:
        self.name = name
        self.sensor = sensor
        self.topic = sensor.topic
        self.period = period
        self.last: Reading[T] | None = None
        self.needed: Callable[[], bool] | None = None
        self.reason = ""
        """Why it is not healthy; empty when it is."""
        self.readings = 0
        self.failures = 0
        self._stale = max(STALE_PERIODS * period, STALE_MIN)
        self._since = 0.0  # when it was last asked for the first time in vain

    def state(self) -> SensorState:
        """How it is."""
        topic, last = self.topic, self.last
        values = {} if last is None else numbers(topic, last.value)
        time = None if last is None else last.time
        healthy = not self.reason and last is not None
        reason = self.reason or ("" if healthy else "no reading yet")
        return SensorState(self.name, topic.units, values, time, healthy, reason, self.readings, self.failures)

    async def poll(self, ticks: Ticks, bus: Bus, tell: Tell) -> None:
        """Read the sensor at every tick and tell its readings."""
        read, publish, topic = self.sensor.read, bus.publish, self.topic
        async for now in ticks:
            if self.needed is not None and not self.needed():
                self._since = now
                continue
            try:
                reading = read(now)
            except (HalError, OSError) as error:
                self.failures += 1
                self._ails(f"{error}", now, tell)
                continue
            if reading is None:
                if now - self._since > self._stale:
                    self._ails(f"no reading for {self._stale:g} s", now, tell)
                continue
            self._since = now
            self.last = reading
            self.readings += 1
            if self.reason:
                self.reason = ""
                tell(now, f"sensor '{self.name}' is healthy again")
            publish(topic, reading.value, reading.time)

    def _ails(self, reason: str, now: float, tell: Tell) -> None:
        """Note why it is not healthy, and tell it once."""
        if not self.reason:
            tell(now, f"sensor '{self.name}' fails: {reason}")
        self.reason = reason


class Sensors(Mapping[str, Polled[Any]]):
    """The sensors of one robot, by name.

    Args:
        bus: takes the readings.
        add_task: adds a periodic task: its name, priority, period in s, and coroutine function.
        tell: adds a line to the event log; time in s of the run.

    """

    def __init__(self, bus: Bus, add_task: AddTask, tell: Tell) -> None:
        self._bus = bus
        self._add_task = add_task
        self._tell = tell
        self._polled: dict[str, Polled[Any]] = {}
        self._opened: list[Polled[Any]] = []

    def __getitem__(self, name: str) -> Polled[Any]:
        return self._polled[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._polled)

    def __len__(self) -> int:
        return len(self._polled)

    async def add(self, name: str, sensor: Sensor[T], period: float | None = None) -> Polled[T]:
        """Open a sensor and read it from now on.

        Raises:
            HalError: it cannot be opened.
            ValueError: the name is taken, or the period is not positive.

        """
        if name in self._polled:
            raise ValueError(f"there is a sensor '{name}' already; choose another name")
        polled = Polled(name, sensor, sensor.period if period is None else period)
        self._opened.append(polled)  # from here on `close` closes it, also when opening fails half-way
        await _settled(polled, "opened", sensor.open())
        polling = partial(polled.poll, bus=self._bus, tell=self._tell)
        self._add_task(f"sensor {name}", PRIORITY, polled.period, polling)
        self._polled[name] = polled
        return polled

    def states(self) -> tuple[SensorState, ...]:
        """How each of them is."""
        return tuple(polled.state() for polled in self._polled.values())

    async def close(self) -> None:
        """Close all of them, whichever fail.

        Raises:
            HalError: one could not be closed.

        """
        errors = []
        while self._opened:
            polled = self._opened.pop()
            try:
                await _settled(polled, "closed", polled.sensor.close(), CLOSING_MAX)
            except HalError as error:
                errors.append(error)
        if errors:
            raise errors[0]


async def _settled(polled: Polled[Any], done: str, action: Any, limit: float | None = None) -> None:
    """Wait for a sensor to be opened or closed; whatever a stranger's raises becomes a HalError that names it."""
    try:
        async with asyncio.timeout(limit):
            await action
    except TimeoutError:
        raise HalError(f"sensor '{polled.name}' is not {done} after {limit:g} s") from None
    except Txt1Error:
        raise
    except Exception as error:
        raise HalError(f"sensor '{polled.name}' cannot be {done}: {type(error).__name__}: {error}") from error
