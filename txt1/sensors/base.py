"""The interface between the robot and a sensor that is not part of its hardware layer.

A driver is one module: a class with `open`, `close`, `read` and a topic, and a function that makes the sensor from a
`Setup`. `txt1.sensors.conformance` checks any sensor against the rules in this module; docs/sensors.md has an example.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final, Generic, NamedTuple, Protocol, TypeVar

from txt1.errors import ConfigError
from txt1.telemetry.messages import define
from txt1.telemetry.topics import TOPICS, Rule, Topic, declare

# imported for types only: the schema takes 0.4 s to load, and the screens' process does not need it
if TYPE_CHECKING:
    from txt1.config import Config

T = TypeVar("T")

Pose = tuple[float, float, float]


class Reading(NamedTuple, Generic[T]):
    """One reading of a sensor."""

    time: float
    """When the reading was taken, s of the run."""
    value: T
    """Immutable, of the type of the sensor's topic."""


class Sensor(Protocol[T]):
    """A sensor. Times are seconds since the run started; the times of readings rise, and are never in the future.

    When the hardware fails, it raises HalError or OSError: the sensor is marked unhealthy and read again at each
    period, and the robot goes on. Every other exception is a mistake in the program and stops the robot.
    """

    @property
    def topic(self) -> Topic[T]:
        """Name, type, units and message of its values; constant."""

    @property
    def period(self) -> float:
        """Seconds between two calls of `read`, unless configured otherwise; constant."""

    @property
    def simulated(self) -> bool:
        """Whether the sensor needs no hardware, so that it works in virtual time; constant."""

    async def open(self) -> None:
        """Make the hardware ready; may wait. Raises HalError with the cause and the remedy in one line."""

    async def close(self) -> None:
        """Release the hardware; harmless when it is already closed. The sensor can be opened again."""

    def read(self, now: float) -> Reading[T] | None:
        """Return the newest reading at `now`; None if there is no new reading.

        It never waits, and takes less than 0.2 ms of the processor: the event loop has only 20 ms for everything.
        Longer work belongs in a thread; `read` then returns the thread's newest result.
        """


class Setup(NamedTuple):
    """The arguments with which a driver makes a sensor."""

    name: str
    options: Mapping[str, Any]
    """Its own settings, from ``sensors.NAME.options``."""
    config: Config
    pose: Callable[[], Pose | None] | None = None
    """Returns the robot's true pose (x, y, theta) in the room, m and rad; None unless the robot is simulated."""
    hal: Any = None
    """The hardware layer, for a sensor that shares a simulated world or a link with it."""
    armed: Callable[[], bool] = lambda: False
    """Returns whether the robot is armed, so that it may move; a sensor may call it in its own thread."""


class SensorState(NamedTuple):
    """The health of a sensor, and its last values."""

    name: str
    units: str
    # numbers of the last reading, by their paths in the topic's message
    values: dict[str, float]
    # time of the last reading, s of the run; None before the first
    time: float | None
    # whether the last reading came in time and the hardware has not failed since
    healthy: bool
    # why the sensor is unhealthy; empty if it is healthy
    reason: str
    readings: int
    failures: int


VALUE: Final = define("txt1_msgs/Value", "std_msgs/Header header\nfloat64 value")

SENSORS: Final = declare(
    Topic(
        "/sensors",
        tuple[SensorState, ...],
        "",
        "diagnostic_msgs/DiagnosticArray",
        Rule.SECOND,
        "every sensor: whether it is healthy, and its last reading",
        make=lambda states: {"status": [_status(state) for state in states]},
    )
)


def _status(state: SensorState) -> dict[str, Any]:
    values = {**state.values, "time": state.time, "readings": state.readings, "failures": state.failures}
    return {
        "level": 0 if state.healthy else 2,
        "name": state.name,
        "message": state.reason or "healthy",
        "values": [{"key": key, "value": str(value)} for key, value in values.items() if value is not None],
    }


def numbers(topic: Topic[T], value: T) -> dict[str, float]:
    """Return the numbers of a value for a line on a screen.

    They are the value's own `summary`, or the numbers of its topic's message by their paths; None if it has neither.
    """
    summary: Callable[[], dict[str, float]] | None = getattr(value, "summary", None)
    if summary is not None:
        return summary()
    made = topic.make(value)
    return {} if isinstance(made, Mapping) else dict(zip(topic.paths, made, strict=True))


def reading_topic(
    name: str,
    kind: type[T],
    units: str,
    about: str,
    message: str = VALUE,
    paths: tuple[str, ...] = ("value",),
    make: Callable[[T], tuple[float, ...] | Mapping[str, Any]] = lambda value: (value,),  # type: ignore[assignment,return-value]
    constants: Mapping[str, Any] | None = None,
) -> Topic[T]:
    """Return the topic ``/sensors/NAME`` of a sensor's values, by default plain numbers.

    Raises ConfigError if a sensor of another kind has this name, or the name is malformed.
    """
    topic = Topic(f"/sensors/{name}", kind, units, message, Rule.EVENT, about, constants or {}, paths, make)
    known = TOPICS.get(topic.name)
    if known is None:
        try:
            return declare(topic)
        except ValueError as error:
            raise ConfigError(f"sensors.{name}: {error}") from None
    if (known.type, known.units, known.message, known.paths) != (kind, units, message, paths):
        raise ConfigError(f"sensors.{name}: a sensor of another kind has that name already; choose another one")
    return known
