"""Sensors' messages as trees of names and values; the node of ROS 1 turns them into its own messages."""

from __future__ import annotations

from base64 import b64encode
from collections import deque
from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any, Final

from txt1.kernel.clock import NS_PER_S
from txt1.ros.topics import sensor
from txt1.runtime import Runtime
from txt1.sensors.mounts import fixed, links_of
from txt1.telemetry.topics import Topic

# messages that wait for the node; the oldest are dropped
READINGS_MAX: Final = 500
# messages that ROS 1 does not have
OWN: Final = "txt1_msgs/"
Told = tuple[str, str, int, dict[str, Any]]
"""A message: the topic's name, its type, its time in ns, and its tree."""


class SensorFeed:
    """Collects sensors' readings from `begin` to `end`, and returns them."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        # the first sensor's topic of each type of reading
        self._first: dict[type, Topic[Any]] = {}
        self._waiting: deque[tuple[str, Topic[Any], Any, float]] = deque(maxlen=READINGS_MAX)
        self._leave: Callable[[], None] = lambda: None

    def begin(self) -> list[dict[str, Any]]:
        """Begin to collect; return the transforms of the sensors' places."""
        self.end()
        for polled in self._runtime.sensors.values():
            self._first.setdefault(polled.sensor.topic.type, polled.sensor.topic)
        self._leave = self._runtime.bus.subscribe(self._take)
        told: Any = fixed(links_of(self._first)).make(None)
        return list(told["transforms"])

    def end(self) -> None:
        """Collect nothing more."""
        self._leave()
        self._leave = lambda: None
        self._waiting.clear()

    def take(self, epoch: float) -> list[Told]:
        """Return the messages since the last call, with times of day for a run that started at `epoch`, s."""
        waiting, self._waiting = self._waiting, deque(maxlen=READINGS_MAX)
        return [
            (name, topic.message, round((epoch + time) * NS_PER_S), tree(topic, value))
            for name, topic, value, time in waiting
        ]

    def _take(self, topic: Topic[Any], value: Any, time: float) -> None:
        if not topic.name.startswith("/sensors/"):
            return
        for name, _, each in sensor(topic, self._first.setdefault(topic.type, topic) is topic):
            if not each.message.startswith(OWN):
                self._waiting.append((name.removeprefix("~/"), each, value, time))


def tree(topic: Topic[Any], value: Any) -> dict[str, Any]:
    """Return a message's values by name, nested; some values of an array by their places; bytes as {"base64": text}."""
    made: Any = topic.make(value)
    if not topic.paths:
        return {**topic.constants, **{name: _plain(each) for name, each in made.items()}}
    told = deepcopy(dict(topic.constants))
    for path, number in zip(topic.paths, made, strict=True):
        *above, last = path.split(".")
        place: dict[str, Any] = told
        for name in above:
            place = place.setdefault(name, {})
        place[last] = number
    return told


def _plain(value: Any) -> Any:
    if isinstance(value, bytes | bytearray | memoryview):
        return {"base64": b64encode(value).decode("ascii")}
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    return value
