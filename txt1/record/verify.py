"""The recorded inputs through the tasks once more, in virtual time, to see whether the robot does what it did.

Everything that came from outside is in the recording with its exact time and its place among the ticks of the same
instant. It is given again to a fresh runtime made from the recorded configuration, and what that one does is compared
with the recording message by message, byte by byte.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from pydantic import ValidationError

from txt1.board import create_hal
from txt1.config import Config
from txt1.errors import NotArmed, RecordingError, TaskFault
from txt1.hal.base import Button
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.kernel.loop import run
from txt1.kernel.scheduler import Ticks
from txt1.protocol.messages import (
    BatteryLevels,
    CombinedOdometry,
    EncoderOdometry,
    Message,
    PidResponse,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)
from txt1.record import topics
from txt1.record.encoder import Block, Input
from txt1.record.reading import Decoding, Item, Reading, flat
from txt1.record.recorder import Recorder
from txt1.record.topics import TOPICS
from txt1.runtime import Runtime
from txt1.tasks.controller import PERIOD

PATIENCE: Final = 100
"""Turns of the loop in which an input waits for what came before it; more only where a recording was altered."""

_MESSAGES: Final[dict[str, Callable[..., Message]]] = {
    kind.__name__: kind for kind in (Velocity, CombinedOdometry, EncoderOdometry, BatteryLevels)
}
_COUNTS: Final[dict[str, Callable[..., Message]]] = {kind.__name__: kind for kind in (PwmTest, PwmCommand)}


class Difference(NamedTuple):
    """Where a replay first departs from its recording.

    Attributes:
        cycle: the controller cycle, counted from 0.
        time: s of the run.
        topic: whose messages differ.
        field: the first that differs, dotted; empty when a message is missing or there is one too many.
        recorded: its value in the recording.
        replayed: its value now.

    """

    cycle: int
    time: float
    topic: str
    field: str
    recorded: object
    replayed: object

    def __str__(self) -> str:
        where = f"{self.topic} {self.field}".rstrip()
        return (
            f"first difference in cycle {self.cycle} (t = {self.time:.3f} s): {where} was {self.recorded!r}, "
            f"now it is {self.replayed!r}"
        )


class Verdict(NamedTuple):
    """What a replay found: how many messages were compared, and the first difference, None if there is none."""

    compared: int
    difference: Difference | None


def verify(path: Path) -> Verdict:
    """The verdict on a recorded simulation.

    Raises:
        RecordingError: the file cannot be read, is no recording of txt1's, or was not made in virtual time.

    """
    reading = Reading(path)
    inputs = [(item.message.log_time, _input(decoded)) for item, decoded in _decoded(reading, topics.INPUT)]
    about = reading.metadata.get("txt1")
    if about is None or "config" not in about:
        raise RecordingError(f"{path}: no configuration in it, so there is nothing to run; was it made by txt1?")
    if about.get("clock") != "virtual":
        raise RecordingError(
            f"{path}: recorded on the real clock, whose ticks come late by amounts that are not recorded; "
            "only a run in virtual time (--speed) replays exactly"
        )
    try:
        config = Config.model_validate(json.loads(about["config"]))
    except (ValueError, ValidationError) as error:
        raise RecordingError(f"{path}: its configuration is not one of this version's: {error}") from None
    epoch_ns = nanoseconds(config.record.epoch)
    timed = [((time_ns - epoch_ns) / NS_PER_S, given) for time_ns, given in inputs]
    return run(_replay(path, config, timed), speed="max")


def _decoded(reading: Reading, topic: str) -> Iterator[tuple[Item, Any]]:
    decoding = Decoding()
    for item in reading:
        if item.topic == topic:
            yield item, decoding.message(item)


def _input(message: Any) -> Input:
    values = tuple(float(value) for value in message.values)
    return Input(message.cycle, message.received, message.source, message.kind, message.text, message.given, values)


class _Comparison:
    """A sink that compares what comes with a recording."""

    def __init__(self, path: Path, epoch_ns: int) -> None:
        self.epoch_ns = epoch_ns
        self._recorded = iter(Reading(path))
        self._decoding = Decoding()
        self.compared = 0
        self.difference: Difference | None = None

    def write(self, block: Block) -> int:
        """Compare a block with as many messages of the recording."""
        for channel, time, data in block.messages():
            if self.difference is not None:
                return 0
            topic = TOPICS[channel - 1].name
            item = next(self._recorded, None)
            if item is None:
                return 0  # what the recording lacks at its end is no difference: it may break off
            if (item.topic, item.message.log_time, item.message.data) != (topic, time, data):
                self.difference = self._explain(item, topic, time, data)
            self.compared += 1
        return 0

    def close(self, dropped: int, end: Mapping[str, str]) -> None:
        """What is left of the recording was not said again."""
        del dropped, end
        if self.difference is None and (item := next(self._recorded, None)) is not None:
            at = self._run_time(item.message.log_time)
            self.difference = Difference(_cycle(at), at, item.topic, "", "a message", "none")

    def _run_time(self, stamp: int) -> float:
        return (stamp - self.epoch_ns) / NS_PER_S

    def _explain(self, item: Item, topic: str, time: int, data: bytes) -> Difference:
        at = self._run_time(min(item.message.log_time, time))
        if item.topic != topic:
            return Difference(_cycle(at), at, item.topic, "", "a message", f"one on {topic}")
        message = item.message
        now = Item(topic, item.schema, item.channel, type(message)(message.channel_id, time, data, time, 0))
        before, after = dict(flat(self._decoding.values(item))), dict(flat(self._decoding.values(now)))
        for name in dict.fromkeys((*before, *after)):
            old, new = before.get(name), after.get(name)
            if repr(old) != repr(new):
                return Difference(_cycle(at), at, topic, name, old, new)
        return Difference(_cycle(at), at, topic, "", "so many bytes", "other ones")


def _cycle(time: float) -> int:
    return int(time / PERIOD + 1e-6)


async def _replay(path: Path, config: Config, inputs: list[tuple[float, Input]]) -> Verdict:
    comparison = _Comparison(path, nanoseconds(config.record.epoch))
    runtime = Runtime(config, lambda message: None, create_hal(config))
    recorder = Recorder(runtime, [comparison], config.record.epoch, batch=1.0)
    recorder.attach()
    end = _end(path, comparison.epoch_ns)
    script = _Script(runtime, inputs, end)
    await runtime.start()
    if end.before_tick:
        runtime.scheduler.end_at(end.time)
    script.start()
    try:
        await asyncio.wait({runtime.scheduler.ended, script.ended}, return_when=asyncio.FIRST_COMPLETED)
        script.finish()
    finally:
        with suppress(TaskFault):  # it failed when it was recorded, too, or the messages differ
            await runtime.stop()
    await recorder.close()
    return Verdict(comparison.compared, comparison.difference)


class _End(NamedTuple):
    """How a recorded run ended.

    Attributes:
        time: s of the run.
        before_tick: no task ran any more at that very instant.
        received: messages that the serial task had taken.

    """

    time: float
    before_tick: bool
    received: int


def _end(path: Path, epoch_ns: int) -> _End:
    """How a recorded run ended: as it says itself, or, where it breaks off, behind its last cycle."""
    reading = Reading(path)
    last_ns = max((item.message.log_time for item in reading if item.topic == topics.SETPOINT), default=epoch_ns)
    said = reading.metadata.get("txt1.end", {})
    if not {"duration", "cycles", "received"} <= set(said):
        return _End((last_ns - epoch_ns + 1) / NS_PER_S, True, 0)
    time = float(said["duration"])
    return _End(time, nanoseconds(time) <= int(said["cycles"]) * nanoseconds(PERIOD), int(said["received"]))


class _Script:
    """Gives the recorded inputs again, each at its time and at its place among the tasks."""

    def __init__(self, runtime: Runtime, inputs: list[tuple[float, Input]], end: _End) -> None:
        self._runtime = runtime
        self._loop = asyncio.get_running_loop()
        self._began = 0.0
        self._outside: deque[tuple[float, Input]] = deque()
        self._by_source: dict[str, list[tuple[float, Input]]] = {}
        for time, given in inputs:
            if given.source and given.kind != "task":
                self._by_source.setdefault(given.source, []).append((time, given))
            else:
                self._outside.append((time, given))
        if not end.before_tick:
            self._outside.append((end.time, Input(0, end.received, "", "end", "", 0.0, ())))
        self._turns = 0
        self.ended: asyncio.Future[None] = self._loop.create_future()

    def start(self) -> None:
        """Begin with what was given before the first tick, and set a timer for what came next."""
        self._began = self._loop.time() - self._runtime.now
        self._step()

    def _step(self) -> None:
        """Give what is due of the inputs that came from no task, and see to the one behind."""
        while self._outside:
            time, given = self._outside[0]
            if time > self._runtime.now:
                self._loop.call_at(self._began + time, self._due, given.cycle)
                return
            if self._runtime.state.received < given.received and self._turns < PATIENCE:
                self._turns += 1
                self._loop.call_soon(self._step)  # what was given before it was carried out first
                return
            self._turns = 0
            self._outside.popleft()
            self._give(given)

    def finish(self) -> None:
        """Give what was given in the very instant of the end, when no task ran any more."""
        while self._outside:
            self._give(self._outside.popleft()[1])

    def _due(self, cycle: int) -> None:
        """It is time: at once, or behind the tasks of this instant, if they had run already."""
        if cycle > round(self._runtime.now / PERIOD):
            self._loop.call_soon(self._step)
        else:
            self._step()

    def _add_source(self, name: str, priority: float, period: float) -> None:
        """Add a task that gives what the one of that name gave, in its place among the others."""
        inputs = self._by_source.get(name, [])
        self._runtime.add_task(name, round(priority), period, partial(self._repeat, inputs))

    async def _repeat(self, inputs: list[tuple[float, Input]], ticks: Ticks) -> None:
        position = 0
        async for now in ticks:
            while position < len(inputs) and inputs[position][0] <= now + 1e-9:
                self._give(inputs[position][1])
                position += 1

    def _give(self, given: Input) -> None:
        runtime, values = self._runtime, given.values
        match given.kind:
            case "end":
                if not self.ended.done():
                    self.ended.set_result(None)
            case "look":
                runtime.look()
            case "tell":
                runtime.tell(given.text)
            case "task":
                self._add_source(given.text, values[0], values[1])
            case "arm":
                with suppress(NotArmed):
                    runtime.arm()
            case "disarm":
                runtime.disarm(given.text)
            case "stop":
                runtime.emergency_stop()
            case "press":
                runtime.press(Button(round(values[0])))
            case "place":
                runtime.place(values[0], values[1], values[2])
            case _:
                runtime.post(message(given.kind, values), given.given)


def message(kind: str, values: tuple[float, ...]) -> Message:
    """The message that a recording names by its kind and its numbers; the inverse of `recorder.numbers`.

    Raises:
        RecordingError: there is no such kind, or it does not have so many numbers.

    """
    try:
        if kind == PidSet.__name__:
            linear, rest = values[:3], values[3:]
            sets = tuple(rest[start : start + 4] for start in range(0, len(rest), 4))
            return PidSet(linear, sets)  # type: ignore[arg-type]
        if kind == PowerControl.__name__:
            return PowerControl(Switch(round(values[0])), bool(values[1]))
        if kind == PidResponse.__name__:
            return PidResponse(bool(values[0]))
        if kind in _COUNTS:
            return _COUNTS[kind](*map(round, values))
        return _MESSAGES[kind](*values)
    except (KeyError, TypeError, ValueError, IndexError):
        raise RecordingError(f"{topics.INPUT}: no message {kind!r} with {len(values)} numbers") from None
