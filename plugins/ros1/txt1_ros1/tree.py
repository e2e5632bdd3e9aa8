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
from txt1.sensors.mounts import SensorFrames, mounted
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
        # from the start on: readings tell where their sensors sit
        self._frames, self._moved = SensorFrames(), False
        sensors = [polled.sensor.topic for polled in runtime.sensors.values()]
        for topic in sensors:
            self._first.setdefault(topic.type, topic)
            self._frames.link(topic)
        runtime.bus.subscribe(self._see, sensors)

    def begin(self) -> None:
        """Begin to collect."""
        self.end()
        self._moved = True
        self._leave = self._runtime.bus.subscribe(self._take)

    def places(self) -> list[dict[str, Any]]:
        """Return the transforms of the sensors' places if they are not as at the last call; else none."""
        moved, self._moved = self._moved, False
        return list(mounted(self._frames.mounts)["transforms"]) if moved else []

    def end(self) -> None:
        """Collect nothing more."""
        self._leave()
        self._leave = lambda: None
        self._waiting.clear()
        self._moved = False

    def take(self, epoch: float) -> list[Told]:
        """Return the messages since the last call, with times of day for a run that started at `epoch`, s."""
        waiting, self._waiting = self._waiting, deque(maxlen=READINGS_MAX)
        return [
            (name, topic.message, round((epoch + time) * NS_PER_S), tree(topic, value))
            for name, topic, value, time in waiting
        ]

    def _see(self, topic: Topic[Any], value: Any, _time: float) -> None:
        self._moved |= self._frames.see(topic, value)

    def _take(self, topic: Topic[Any], value: Any, time: float) -> None:
        if not topic.name.startswith("/sensors/"):
            return
        for name, _, each in sensor(topic, self._first.setdefault(topic.type, topic) is topic):
            if not each.message.startswith(OWN):
                framed = self._frames.framed(each, topic)
                self._waiting.append((name.removeprefix("~/"), framed, value, time))


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
