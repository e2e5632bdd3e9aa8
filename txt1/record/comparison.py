"""Compares the messages of a replayed robot with its recording, message by message."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import Any, Final, NamedTuple

from txt1.errors import RecordingError
from txt1.hal.base import LINK
from txt1.record.mcap_records import Block
from txt1.record.reader import Decoding, FilePass, Item, flat
from txt1.runtime import Runtime
from txt1.sensors.base import SENSORS
from txt1.tasks import diagnostics, fields
from txt1.tasks.controller import CONTROL_PERIOD
from txt1.tasks.inputs import COMMAND, INPUT
from txt1.telemetry.snapshot import SNAPSHOT
from txt1.telemetry.topics import Topic

NUMBERS_CLOSE: Final = 1e-6
"""By which numbers may differ between two processors, absolute, or as a share of the number where that is more."""


class Difference(NamedTuple):
    """Where a replay first departs from its recording: `time` in s of the run, and the two values."""

    time: float
    topic: str
    # the first that differs, dotted; empty when a message is missing or there is one too many
    field: str
    recorded: object
    replayed: object

    @property
    def cycle(self) -> int:
        """The controller cycle, counted from 0."""
        return int(self.time / CONTROL_PERIOD + 1e-6)

    def __str__(self) -> str:
        where = f"{self.topic} {self.field}".rstrip()
        return (
            f"first difference in cycle {self.cycle} (t = {self.time:.3f} s): {where} was {self.recorded!r}, "
            f"now it is {self.replayed!r}"
        )


class Comparison:
    """A sink that compares the messages of the robot's own tasks with a recording.

    It leaves out values that the real clock measures. It also leaves out the messages of those who command the robot,
    such as a learner: their commands are inputs here.

    Args:
        path: of the recording.
        robot: the name of the robot in it.
        runtime: the robot that is run again.
        exact: whether each byte has to be the same; else numbers may differ by `NUMBERS_CLOSE`.
        real: whether the recording was made on the real clock.
        sensed: whether the sensors' readings are in it, and are given again.
        ends: whether nothing is compared behind the end of the run: hardware takes its own time to stand.

    """

    def __init__(
        self, path: Path, robot: str, runtime: Runtime, *, exact: bool, real: bool, sensed: bool, ends: bool
    ) -> None:
        self.robot = robot
        self._runtime, self._exact, self._real, self._sensed, self._ends = runtime, exact, real, sensed, ends
        self._reading, self._decoding = FilePass(path, robot), Decoding()
        self._own: frozenset[str] = frozenset()
        self._in_snapshots: frozenset[str] = frozenset()
        self._recorded = self._own_items()
        self._over = False
        self.compared: Counter[str] = Counter()
        """The messages that were compared, by topic."""
        self.uncompared: Counter[str] = Counter()
        """The messages of the recording that were not compared, by topic."""
        self.left_out: set[str] = set()
        """The topics of the recording that were not."""
        self.difference: Difference | None = None
        """The first."""

    def begin(self) -> None:
        """Find out which topics are compared: the robot has its sensors now."""
        runtime = self._runtime
        own = {*runtime.bus.offered, INPUT, COMMAND, fields.LOG}
        if runtime.line_tapped:
            own.add(LINK)
        if self._real:
            own.discard(diagnostics.TASKS)
        if self._sensed:
            own |= {polled.sensor.topic for polled in runtime.sensors.values()}
        else:
            own -= {SENSORS, SNAPSHOT}
        self._own = frozenset(topic.name for topic in own)
        measured = {fields.TASK_REPORTS, fields.EVENTS, fields.TRAFFIC, fields.WARNINGS} if self._real else set()
        self._in_snapshots = frozenset(topic.name for topic in {*runtime.bus.offered} - measured)

    def leave_out(self, topic: Topic[Any]) -> None:
        """Do not compare a topic."""
        self._own -= {topic.name}
        self._in_snapshots -= {topic.name}

    def write(self, block: Block) -> int:
        """Compare a block with as many messages of the recording."""
        for (_, topic), time, data in block.messages():
            if topic.name not in self._own:
                continue
            if self.difference is not None or self._over:
                return 0
            item = next(self._recorded, None)
            if item is None:
                # what the recording lacks at its end is no difference: it may break off
                return 0
            if (item.name, item.message.log_time, item.message.data) != (topic.name, time, data):
                self.difference = self._explain(item, topic.name, time, data)
            self.compared[topic.name] += 1
            self._over = self._ends and topic is INPUT and self._decoding.message(item).kind == "end"
        return 0

    def close(self, dropped: int) -> None:
        """Take the rest of the recording for a difference, as it was not said again."""
        del dropped
        if self.difference is None and not self._over and (item := next(self._recorded, None)) is not None:
            self.difference = Difference(self._reading.run_time(item), item.name, "", "a message", "none")
        if self.difference is None:
            # those behind the end of the run
            self.uncompared.update(item.name for item in self._recorded)

    def _own_items(self) -> Iterator[Item]:
        for item in self._reading:
            if item.name in self._own:
                yield item
            else:
                self.uncompared[item.name] += 1
                self.left_out.add(item.name)

    def _explain(self, item: Item, topic: str, time: int, data: bytes) -> Difference | None:
        """The first difference of two messages; None when they say the same."""
        now = item._replace(message=replace(item.message, data=data, log_time=time))
        at = min(map(self._reading.run_time, (item, now)))
        if item.name != topic:
            return Difference(at, item.name, "", "a message", f"one on {topic}")
        values = self._snapshot if topic == SNAPSHOT.name else self._values
        try:
            before, after = values(item), values(now)
        except (RecordingError, ValueError, LookupError, TypeError, AttributeError):
            return Difference(at, topic, "", "a damaged message", "a sound one")
        # as late as the processor was
        late = self._real and topic == fields.LOG.name
        for name in dict.fromkeys((*before, *after)):
            old, new = before.get(name), after.get(name)
            if repr(old) != repr(new) and not (late and name.startswith("stamp.")) and not self._close(old, new):
                return Difference(at, topic, name, old, new)
        same = late or topic == SNAPSHOT.name or not self._exact
        return None if same else Difference(at, topic, "", "so many bytes", "other ones")

    def _close(self, old: Any, new: Any) -> bool:
        """Return whether two values are equal but for rounding on another processor."""
        if self._exact or type(old) is not type(new):
            return False
        if isinstance(old, list):
            return len(old) == len(new) and all(map(self._close, old, new))
        if isinstance(old, dict):
            return old.keys() == new.keys() and all(self._close(old[key], new[key]) for key in old)
        if isinstance(old, float):
            return isclose(old, new, rel_tol=NUMBERS_CLOSE, abs_tol=NUMBERS_CLOSE) or repr(old) == repr(new)
        return bool(old == new)

    def _values(self, item: Item) -> dict[str, Any]:
        """A message's values by dotted path."""
        return dict(flat(self._decoding.values(item)))

    def _snapshot(self, item: Item) -> dict[str, Any]:
        """A snapshot's values by topic and dotted path, as far as they are compared."""
        told = json.loads(self._decoding.values(item)["data"])
        topics = told.pop("topics")
        if self._real:
            # later than the step's
            del told["time"]
        self.left_out |= {f"{SNAPSHOT.name} {name}" for name in topics.keys() - self._in_snapshots}
        return dict(flat(told)) | dict(flat({name: topics[name] for name in topics if name in self._in_snapshots}))
