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

# the screens' process does without the schema, which takes 0.4 s to load
if TYPE_CHECKING:
    from txt1.config import Config

T = TypeVar("T")

Pose = tuple[float, float, float]


class Reading(NamedTuple, Generic[T]):
    """One reading of a sensor."""

    time: float
    """When it was taken, s of the run."""
    value: T
    """Immutable, of the type that the sensor's topic names."""


class Sensor(Protocol[T]):
    """A sensor. Times are seconds since the run started; the times of readings rise, and are never in the future.

    When the hardware fails, it raises HalError or OSError: the sensor is marked unhealthy and read again at each
    period, and the robot goes on. Every other exception is a mistake in the program and stops the robot.
    """

    @property
    def topic(self) -> Topic[T]:
        """The name, type, units and message of its values; constant."""

    @property
    def period(self) -> float:
        """Seconds between two calls of `read`, unless configured otherwise; constant."""

    @property
    def simulated(self) -> bool:
        """Whether it reads nothing real, so that it works in virtual time; constant."""

    async def open(self) -> None:
        """Make the hardware ready; may wait. Raises HalError with the cause and the remedy in one line."""

    async def close(self) -> None:
        """Release the hardware; harmless when it is already closed. The sensor can be opened again."""

    def read(self, now: float) -> Reading[T] | None:
        """The newest reading at `now`, or None when there is no new one.

        It never waits, and takes less than 0.2 ms of the processor: the event loop has only 20 ms for everything.
        Longer work belongs in a thread, whose newest result it hands out.
        """


class Setup(NamedTuple):
    """The arguments with which a driver makes a sensor."""

    name: str
    options: Mapping[str, Any]
    """Its own settings, from ``sensors.NAME.options``."""
    config: Config
    pose: Callable[[], Pose | None] | None = None
    """Returns the true pose (x, y, theta) in the room now, m and rad; None where the robot is not simulated."""
    hal: Any = None
    """The hardware layer, for a sensor that shares a simulated world or a link with it."""


class SensorState(NamedTuple):
    """The health of a sensor, and its last values."""

    name: str
    units: str
    # the last reading's numbers by their paths in the topic's message
    values: dict[str, float]
    # when it was taken, s of the run; None before the first one
    time: float | None
    # the last reading came in time, and the hardware has not failed since
    healthy: bool
    # why it is not healthy; empty when it is
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
    """The numbers of a value for a line on a screen: its own `summary`, or those of its topic's message by their paths.

    None where it has neither.
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
    """The topic ``/sensors/NAME`` of a sensor's values, by default plain numbers.

    A ConfigError when a sensor of another kind has that name, or it is no name for a topic.
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
