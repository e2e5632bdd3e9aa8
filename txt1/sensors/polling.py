"""The sensors of one robot: opened and closed with it, each read by a task at its own period."""

from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from functools import partial
from math import cos, sin
from typing import Any, Final, Generic, TypeVar

from txt1.errors import HalError
from txt1.kernel.scheduler import PeriodicTask
from txt1.kernel.ticks import Ticks
from txt1.plugins import settled
from txt1.sensors.base import Reading, Sensor, SensorState, numbers
from txt1.telemetry.bus import Bus

T = TypeVar("T")

# priority below the robot's own tasks
SENSORS_PRIORITY: Final = 0
# a sensor without a reading for this number of periods,
STALE_PERIODS: Final = 10
# and for at least this number of seconds, is unhealthy: many GPS receivers send once a second
STALE_MIN: Final = 2.0
# s within which a sensor must have closed
CLOSING_MAX: Final = 5.0
# points of a scan on a screen, at most
SEEN_MAX: Final = 120

AddTask = Callable[[str, int, float, PeriodicTask], None]
Tell = Callable[[float, str], None]
Note = Callable[[str, str, str, Reading[Any] | None], None]
"""Called after each attempt to read, for a replay: the task, the kind of `txt1.tasks.inputs.Report`, an error,
a reading.
"""


@dataclass
class Polled(Generic[T]):
    """A sensor at work, with its configured name."""

    name: str
    sensor: Sensor[T]
    # s between two readings
    period: float
    last: Reading[T] | None = None
    # asked before each reading: a sensor that is not needed is not read
    needed: Callable[[], bool] = lambda: True
    # why the sensor is unhealthy; empty if it is healthy
    reason: str = ""
    readings: int = 0
    failures: int = 0
    # called with each reading
    listeners: list[Callable[[Reading[T]], None]] = field(default_factory=list)

    def state(self) -> SensorState:
        """Return the sensor's state."""
        topic, last = self.sensor.topic, self.last
        values, time = ({}, None) if last is None else (numbers(topic, last.value), last.time)
        reason = self.reason or ("" if last else "no reading yet")
        return SensorState(self.name, topic.units, values, time, not reason, reason, self.readings, self.failures)

    @property
    def task(self) -> str:
        """The name of the task that reads the sensor."""
        return f"sensor {self.name}"

    async def poll(self, ticks: Ticks, bus: Bus, tell: Tell, note: Note) -> None:
        """Read the sensor at every tick and tell its readings."""
        stale = max(STALE_PERIODS * self.period, STALE_MIN)
        # time of the first of the present failures to read
        since = 0.0
        asked = True
        async for now in ticks:
            needed = self.needed()
            if needed is not asked:
                asked = needed
                note(self.task, "asked" if asked else "idle", "", None)
            if not needed:
                since = now
                continue
            try:
                reading = self.sensor.read(now)
            except (HalError, OSError) as error:
                note(self.task, "fails", f"{error}", None)
                self.failures += 1
                self._ails(f"{error}", now, tell)
                continue
            if reading is None:
                if now - since > stale:
                    self._ails(f"no reading for {stale:g} s", now, tell)
                continue
            note(self.task, "reading", "", reading)
            since = now
            self.last = reading
            self.readings += 1
            if self.reason:
                self.reason = ""
                tell(now, f"sensor '{self.name}' is healthy again")
            bus.publish(self.sensor.topic, reading.value, reading.time)
            for listener in self.listeners:
                listener(reading)

    def _ails(self, reason: str, now: float, tell: Tell) -> None:
        """Store why the sensor is unhealthy, and tell it once."""
        if not self.reason:
            tell(now, f"sensor '{self.name}' fails: {reason}")
        self.reason = reason


class Sensors(dict[str, Polled[Any]]):
    """The sensors of a robot, by name; `bus` takes their readings, `tell` lines for the event log."""

    def __init__(self, bus: Bus, add_task: AddTask, tell: Tell) -> None:
        super().__init__()
        self._bus, self._add_task, self._tell = bus, add_task, tell
        self._opened = AsyncExitStack()

    async def add(
        self,
        name: str,
        sensor: Sensor[T],
        period: float | None = None,
        add_task: AddTask | None = None,
        note: Note = lambda task, kind, text, reading: None,
    ) -> Polled[T]:
        """Open a sensor and read it from now on; raises ValueError if the name is taken.

        `add_task` adds its task; None: as a task of the user's. `note` is called after each attempt to read.
        """
        if name in self:
            raise ValueError(f"there is a sensor '{name}' already; choose another name")
        polled = Polled(name, sensor, sensor.period if period is None else period)
        who = f"sensor '{name}'"
        # from here on `close` closes it, even if opening fails halfway
        self._opened.push_async_callback(settled, who, "closed", sensor.close, CLOSING_MAX)
        await settled(who, "opened", sensor.open)
        poll = partial(polled.poll, bus=self._bus, tell=self._tell, note=note)
        (add_task or self._add_task)(polled.task, SENSORS_PRIORITY, polled.period, poll)
        self[name] = polled
        return polled

    def seen(self, pose: tuple[float, float, float] | None) -> tuple[tuple[float, float], ...]:
        """Return at most `SEEN_MAX` points of each laser's last scan, m, as seen from a pose in the room."""
        if pose is None or not any(each.last for each in self.values()):
            return ()
        # a robot without lasers does not load numpy for this
        from txt1.sensors.readings import Scan

        x, y, theta = pose
        c, s = cos(theta), sin(theta)
        points: list[tuple[float, float]] = []
        for each in self.values():
            if each.last is not None and isinstance(each.last.value, Scan):
                found = each.last.value.points
                chosen = found[:: -(-len(found) // SEEN_MAX) or 1].tolist()
                points += [(round(x + a * c - b * s, 3), round(y + a * s + b * c, 3)) for a, b in chosen]
        return tuple(points)

    def states(self) -> tuple[SensorState, ...]:
        """Return the state of each sensor."""
        return tuple(polled.state() for polled in self.values())

    async def close(self) -> None:
        """Close all sensors, even if some fail; raises HalError if a sensor could not be closed."""
        await self._opened.aclose()
