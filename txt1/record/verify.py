"""The recorded inputs through the tasks once more, in virtual time, to see whether the robot does what it did.

Everything that came from outside is in the recording with its exact time and its place among the ticks of the same
instant. It is given again to a fresh runtime made from the recorded configuration, and what that one does is compared
with the recording message by message, byte by byte.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

from pydantic import ValidationError

from txt1.config import Config
from txt1.errors import NotArmed, RecordingError, TaskFault
from txt1.hal.base import Button
from txt1.hal.registry import create
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.kernel.loop import run
from txt1.kernel.scheduler import PeriodicTask, Scheduler
from txt1.kernel.statistics import TaskStatistics
from txt1.kernel.ticks import Ticks
from txt1.protocol.layout import from_numbers
from txt1.protocol.messages import Message
from txt1.record import topics
from txt1.record.encoder import Block, Input, Tick
from txt1.record.reading import Decoding, Item, Reading, flat
from txt1.record.recorder import ROBOT_TASKS, Recorder
from txt1.record.topics import TOPICS
from txt1.runtime import OnFault, Runtime
from txt1.tasks.controller import PERIOD

PATIENCE: Final = 100
"""Turns of the loop in which an input waits for what came before it; more only where a recording was altered."""


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
        RecordingError: the file cannot be read, is no recording of txt1's, or not of what can be run again.

    """
    recorded = _recorded(path)
    return run(_replay(recorded) if recorded.ticks is None else _replay_ticks(recorded, recorded.ticks), speed="max")


class _Recorded(NamedTuple):
    """What is run again.

    Attributes:
        path: of the recording.
        config: of its robot.
        inputs: what was given from outside, and when, s of the run.
        ticks: which of the robot's tasks ran when; None where virtual time says that.

    """

    path: Path
    config: Config
    inputs: list[tuple[float, Input]]
    ticks: list[Tick] | None

    @property
    def epoch_ns(self) -> int:
        """What was added to the time of the run, ns."""
        return nanoseconds(self.config.record.epoch)


def _recorded(path: Path) -> _Recorded:
    reading, decoding = Reading(path), Decoding()
    inputs: list[tuple[int, Input]] = []
    ticks: list[Tick] = []
    cycles, whole = 0, True
    for item in reading:
        if item.topic == topics.INPUT:
            inputs.append((item.message.log_time, _input(decoding.message(item))))
        elif item.topic == topics.TICKS:
            message = decoding.message(item)
            ticks += zip(message.task, map(float, message.time), message.missed, strict=True)
        elif item.topic == topics.SETPOINT:
            whole = whole and item.message.sequence == cycles
            cycles += 1
    about = reading.metadata.get("txt1")
    if about is None or "config" not in about:
        raise RecordingError(f"{path}: no configuration in it, so there is nothing to run; was it made by txt1?")
    if "part" in about:
        raise RecordingError(f"{path}: a later part of a recording; only the first begins where the run does")
    if not whole:
        raise RecordingError(
            f"{path}: messages are missing in the middle, so it cannot be repeated; see 'txt1 log info'"
        )
    try:
        config = Config.model_validate(json.loads(about["config"]))
    except (ValueError, ValidationError) as error:
        raise RecordingError(f"{path}: its configuration is not one of this version's: {error}") from None
    virtual = about.get("clock") == "virtual"
    if not virtual and not ticks:
        raise RecordingError(
            f"{path}: on the real clock only a simulation without a line can be repeated, as hardware and lines have "
            "a time of their own; a line repeats in virtual time: 'txt1 run --hal serial --port virtual --speed max'"
        )
    epoch_ns = nanoseconds(config.record.epoch)
    timed = [((time_ns - epoch_ns) / NS_PER_S, given) for time_ns, given in inputs]
    return _Recorded(path, config, timed, None if virtual else ticks)


def _input(message: Any) -> Input:
    values = tuple(float(value) for value in message.values)
    return Input(
        message.cycle, message.tick, message.received, message.source, message.kind, message.text, message.given, values
    )


OUTSIDE: Final = frozenset((topics.LIGHT, topics.LEARNING))
"""Of who commands the robot, such as the learning task, and not of its own tasks: its commands are inputs here."""

MEASURED: Final = frozenset((topics.DIAGNOSTICS, topics.SNAPSHOT, topics.TICKS))
"""On the real clock they hold times of the processor's, or say them."""


class _Comparison:
    """A sink that compares what comes with a recording."""

    def __init__(self, recorded: _Recorded) -> None:
        self._epoch_ns = recorded.epoch_ns
        self._real = recorded.ticks is not None
        self._left_out = OUTSIDE | MEASURED if self._real else OUTSIDE
        self._recorded = (item for item in Reading(recorded.path) if item.topic not in self._left_out)
        self._decoding = Decoding()
        self.compared = 0
        self.difference: Difference | None = None

    def write(self, block: Block) -> int:
        """Compare a block with as many messages of the recording."""
        for channel, time, data in block.messages():
            topic = TOPICS[channel - 1].name
            if topic in self._left_out:
                continue
            if self.difference is not None:
                return 0
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
        return (stamp - self._epoch_ns) / NS_PER_S

    def _explain(self, item: Item, topic: str, time: int, data: bytes) -> Difference | None:
        at = self._run_time(min(item.message.log_time, time))
        if item.topic != topic:
            return Difference(_cycle(at), at, item.topic, "", "a message", f"one on {topic}")
        message = item.message
        now = Item(topic, item.schema, item.channel, type(message)(message.channel_id, time, data, time, 0))
        before, after = dict(flat(self._decoding.values(item))), dict(flat(self._decoding.values(now)))
        for name in dict.fromkeys((*before, *after)):
            old, new = before.get(name), after.get(name)
            if repr(old) != repr(new) and not (self._real and topic == topics.LOG and name.startswith("stamp.")):
                return Difference(_cycle(at), at, topic, name, old, new)
        if self._real and topic == topics.LOG:
            return None  # a line of the log is as late as the processor was
        return Difference(_cycle(at), at, topic, "", "so many bytes", "other ones")


def _cycle(time: float) -> int:
    return int(time / PERIOD + 1e-6)


async def _replay(recorded: _Recorded) -> Verdict:
    """The verdict on a run in virtual time: the scheduler runs the tasks at the very times of then."""
    comparison, config = _Comparison(recorded), recorded.config
    runtime = Runtime(config, lambda message: None, create(config))
    recorder = Recorder(runtime, [comparison], config.record.epoch, batch=1.0)
    recorder.attach()
    end = _end(recorded)
    script = _Script(runtime, recorded.inputs, end)
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


async def _replay_ticks(recorded: _Recorded, ticks: list[Tick]) -> Verdict:
    """The verdict on a run on the real clock: every cycle and every input in the recorded order, at its time."""
    comparison, config = _Comparison(recorded), recorded.config
    runtime = Runtime(config, lambda message: None, create(config), scheduler=_TickByTick)
    scheduler = runtime.scheduler
    assert isinstance(scheduler, _TickByTick)
    recorder = Recorder(runtime, [comparison], config.record.epoch, batch=1.0, keep_ticks=True)
    recorder.attach()
    inputs = deque(recorded.inputs)

    def give_up_to(tick: int) -> None:
        while inputs and inputs[0][1].tick <= tick:
            scheduler.time, given = inputs.popleft()
            recorder.source = given.source
            if given.kind == "failure":
                recorder.failed(error := _Failure(given.text))
                scheduler.fail(given.source, error)
            give(runtime, given)

    await runtime.start()
    try:
        with suppress(TaskFault):  # it failed when it was recorded, too, or the messages differ
            for number, (task, time, missed) in enumerate(ticks):
                give_up_to(number)
                scheduler.cycle(ROBOT_TASKS[task], time, missed)
                await recorder.written()
            give_up_to(len(ticks))
    finally:
        await runtime.stop()
    await recorder.close()
    return Verdict(comparison.compared, comparison.difference)


class _TickByTick(Scheduler):
    """Runs a task's cycle when it is told to, at the time that it is told; no other clock plays a part."""

    def __init__(self, on_fault: OnFault) -> None:
        super().__init__(on_fault)
        self.time = 0.0
        """s of the run."""
        self._failed = on_fault
        self._tasks: dict[str, tuple[Ticks, Coroutine[Any, Any, None], TaskStatistics]] = {}
        self._started = False

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self.time

    def add(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> None:
        """Add a task."""
        del priority
        ticks = Ticks(period)
        self._tasks[name] = ticks, task(ticks), TaskStatistics()
        if self._started:
            self._tasks[name][1].send(None)

    def add_sporadic(self, name: str, priority: int, task: PeriodicTask) -> Callable[[], None]:
        """Add a task; that it is due is for the recording to say."""
        self.add(name, priority, None, task)
        return lambda: None

    def start(self) -> None:
        """Run every task up to its first tick."""
        self._started = True
        for _, coroutine, _ in self._tasks.values():
            coroutine.send(None)

    def cycle(self, name: str, now: float, missed: int) -> None:
        """Run a task's cycle at `now`, so many having been missed before it.

        Raises:
            TaskFault: it raised.

        """
        ticks, coroutine, _ = self._tasks[name]
        self.time, ticks.missed = now, missed
        try:
            coroutine.send(now)
        except Exception as error:
            self.fail(name, error)

    def fail(self, name: str, error: Exception) -> NoReturn:
        """End the run, as that task has raised this."""
        self._failed(name, error)
        raise TaskFault(name, error) from error

    def stop(self) -> None:
        """Close every task."""
        for _, coroutine, _ in self._tasks.values():
            coroutine.close()

    def statistics(self) -> dict[str, TaskStatistics]:
        """Nothing: nobody is late here."""
        return {name: statistics for name, (_, _, statistics) in self._tasks.items()}


class _End(NamedTuple):
    """How a recorded run ended.

    Attributes:
        time: s of the run.
        before_tick: no task ran any more at that very instant.
        cycle: cycles of the recorder.
        received: messages that the serial task had taken.

    """

    time: float
    before_tick: bool
    cycle: int = 0
    received: int = 0


def _end(recorded: _Recorded) -> _End:
    """How a recorded run ended: as it says itself, or, where it breaks off, behind its last cycle."""
    reading, epoch_ns = Reading(recorded.path), recorded.epoch_ns
    last_ns = max((item.message.log_time for item in reading if item.topic == topics.SETPOINT), default=epoch_ns)
    said = reading.metadata.get("txt1.end", {})
    if not {"duration", "cycles", "received"} <= set(said):
        return _End((last_ns - epoch_ns + 1) / NS_PER_S, True)
    time, cycle = float(said["duration"]), int(said["cycles"])
    ran = any(given.source and when == time for when, given in recorded.inputs)
    return _End(time, not ran and nanoseconds(time) <= cycle * nanoseconds(PERIOD), cycle, int(said["received"]))


class _Failure(Exception):
    """What a task of the user's raised then."""


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
            self._outside.append((end.time, Input(end.cycle, 0, end.received, "", "end", "", 0.0, ())))
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
        if given.kind == "task":
            self._add_source(given.text, given.values[0], given.values[1])
        elif given.kind != "end":
            give(self._runtime, given)
        elif not self.ended.done():
            self.ended.set_result(None)


def give(runtime: Runtime, given: Input) -> None:
    """Give an input again; of a task of the user's there is only what it gave."""
    values = given.values
    match given.kind:
        case "task":
            runtime.add_task(given.text, round(values[0]), values[1], _idle)
        case "failure":
            raise _Failure(given.text)
        case "look":
            runtime.look()
        case "tell":
            runtime.tell(given.text)
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


async def _idle(ticks: Ticks) -> None:
    async for _ in ticks:
        pass


def message(kind: str, values: tuple[float, ...]) -> Message:
    """Return the message that a recording names by its kind and its numbers.

    Raises:
        RecordingError: there is no such kind, or it does not have so many numbers.

    """
    try:
        return from_numbers(kind, values)
    except ValueError as error:
        raise RecordingError(f"{topics.INPUT}: {error}") from None
