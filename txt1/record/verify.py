"""The recorded inputs through the tasks once more, in virtual time, to see whether the robot does what it did.

Everything that came from outside is in the recording with its exact time and the number of the step behind which it
came. It is given again to a fresh runtime made from the recorded configuration, and what that one tells is compared
with the recording message by message, byte by byte.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from pydantic import ValidationError

from txt1.config import Config
from txt1.config.sources import with_values
from txt1.errors import ConfigError, NotArmed, RecordingError, TaskFault
from txt1.hal.base import LINK, Button
from txt1.hal.registry import create
from txt1.kernel.clock import NS_PER_S
from txt1.kernel.loop import run
from txt1.kernel.scheduler import PeriodicTask, Scheduler
from txt1.kernel.ticks import Ticks
from txt1.protocol.layout import from_numbers
from txt1.record.encoder import Block
from txt1.record.reading import Decoding, Item, Reading, flat, robot_in
from txt1.record.recorder import Recorder
from txt1.runtime import OnFault, Runtime
from txt1.sensors.base import SENSORS
from txt1.tasks import diagnostics
from txt1.tasks.controller import PERIOD, SETPOINT
from txt1.tasks.fields import LOG
from txt1.tasks.inputs import COMMAND, INPUT, STEP, Input
from txt1.telemetry.snapshot import SNAPSHOT
from txt1.telemetry.topics import Topic

EARLY: Final = 0.4 / NS_PER_S
"""s by which an input's timer is ahead of the tasks' timer for the same ns of virtual time."""


class Difference(NamedTuple):
    """Where a replay first departs from its recording: `time` in s of the run, and the two values."""

    time: float
    topic: str
    field: str  # the first that differs, dotted; empty when a message is missing or there is one too many
    recorded: object
    replayed: object

    @property
    def cycle(self) -> int:
        """The controller cycle, counted from 0."""
        return int(self.time / PERIOD + 1e-6)

    def __str__(self) -> str:
        where = f"{self.topic} {self.field}".rstrip()
        return (
            f"first difference in cycle {self.cycle} (t = {self.time:.3f} s): {where} was {self.recorded!r}, "
            f"now it is {self.replayed!r}"
        )


class Verdict(NamedTuple):
    """The result of a replay: how many messages were compared, and the first difference, None if there is none."""

    compared: int
    difference: Difference | None


def verify(path: Path, robot: str | None = None) -> Verdict:
    """The verdict on a recorded simulation; of several robots' on that one, the first for None.

    It drives alone then: where it met another one, this is where it differs.

    Raises RecordingError: the file cannot be read, is no recording of txt1's, or not of what can be run again.
    """
    return run(_replay(_recorded(path, robot_in(path, robot))), speed="max")


class _Recorded(NamedTuple):
    """A run to be repeated."""

    path: Path
    config: Config
    inputs: list[tuple[float, Input]]  # everything given from outside, and when, s of the run
    steps: list[tuple[int, float, int]] | None
    """Task, time and missed cycles of every step; None where virtual time says that."""
    last: float  # the time of the last message, s of the run


def _recorded(path: Path, robot: str) -> _Recorded:
    reading, decoding = Reading(path, robot), Decoding()
    inputs: list[tuple[float, Input]] = []
    steps: list[tuple[int, float, int]] = []
    cycles, last, whole = 0, 0.0, True
    for item in reading:
        time = reading.run_time(item)
        last = max(last, time)
        if item.name == INPUT.name:
            given = decoding.message(item)
            values = tuple(map(float, given.values))
            inputs.append((time, Input(given.step, given.source, given.kind, given.text, given.given, values)))
        elif item.name == STEP.name:
            step = decoding.message(item)
            steps.append((step.task, step.time, step.missed))
        elif item.name == SETPOINT.name:
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
        if "robots" in about:
            config = with_values(config, json.loads(about["robots"])[robot])
    except (ValueError, ValidationError, ConfigError) as error:
        raise RecordingError(f"{path}: its configuration is not one of this version's: {error}") from None
    virtual = about.get("clock") == "virtual"
    if not virtual and not steps:
        raise RecordingError(
            f"{path}: on the real clock only a simulation without a line can be repeated, as hardware and lines have "
            "a time of their own; a line repeats in virtual time: 'txt1 run --hal serial --port virtual --speed max'"
        )
    if not cycles:
        raise RecordingError(f"{path}: no whole cycle in it, so nothing can be compared; see 'txt1 log info'")
    return _Recorded(path, config, inputs, None if virtual else steps, last)


class _Comparison:
    """A sink that compares the messages of the robot's own tasks with a recording.

    What is measured on the real clock and what sensors say is left out. Others, such as the learner's, are of those who
    command the robot: their commands are inputs here.
    """

    def __init__(self, recorded: _Recorded, runtime: Runtime) -> None:
        self._real = recorded.steps is not None
        measured: set[Topic[Any]] = {SENSORS, SNAPSHOT, *((diagnostics.TASKS, STEP) if self._real else ())}
        self._own = {topic.name for topic in {*runtime.bus.offered, INPUT, COMMAND, LOG, LINK} - measured}
        self._reading, self._decoding = Reading(recorded.path, recorded.config.name), Decoding()
        self._recorded = (item for item in self._reading if item.name in self._own)
        self.compared = 0
        self.difference: Difference | None = None

    def write(self, block: Block) -> int:
        """Compare a block with as many messages of the recording."""
        for (_, topic), time, data in block.messages():
            if topic.name not in self._own:
                continue
            if self.difference is not None:
                return 0
            item = next(self._recorded, None)
            if item is None:
                return 0  # what the recording lacks at its end is no difference: it may break off
            if (item.name, item.message.log_time, item.message.data) != (topic.name, time, data):
                self.difference = self._explain(item, topic.name, time, data)
            self.compared += 1
        return 0

    def close(self, dropped: int) -> None:
        """Take the rest of the recording for a difference, as it was not said again."""
        del dropped
        if self.difference is None and (item := next(self._recorded, None)) is not None:
            self.difference = Difference(self._reading.run_time(item), item.name, "", "a message", "none")

    def _explain(self, item: Item, topic: str, time: int, data: bytes) -> Difference | None:
        now = item._replace(message=replace(item.message, data=data, log_time=time))
        at = min(map(self._reading.run_time, (item, now)))
        if item.name != topic:
            return Difference(at, item.name, "", "a message", f"one on {topic}")
        before, after = dict(flat(self._decoding.values(item))), dict(flat(self._decoding.values(now)))
        line_of_log = self._real and topic == LOG.name  # as late as the processor was
        for name in dict.fromkeys((*before, *after)):
            old, new = before.get(name), after.get(name)
            if repr(old) != repr(new) and not (line_of_log and name.startswith("stamp.")):
                return Difference(at, topic, name, old, new)
        return None if line_of_log else Difference(at, topic, "", "so many bytes", "other ones")


async def _replay(recorded: _Recorded) -> Verdict:
    """The verdict on a run that is repeated."""
    config, kind = recorded.config, _Following if recorded.steps is None else _StepByStep
    runtime = Runtime(config, lambda message: None, create(config), scheduler=kind)
    comparison = _Comparison(recorded, runtime)
    recorder = Recorder(runtime, [comparison], config.record.epoch, batch=1.0)
    script, scheduler = _Script(runtime, recorded.inputs), runtime.scheduler
    await runtime.start()
    with suppress(TaskFault):  # it failed when it was recorded, too, or the messages differ
        try:
            if isinstance(scheduler, _Following):
                await _follow(scheduler, script, recorded.last)
            elif isinstance(scheduler, _StepByStep):
                await _take_steps(scheduler, script, recorder, recorded.steps or [])
        finally:
            await runtime.stop()
    await recorder.close()
    return Verdict(comparison.compared, comparison.difference)


async def _follow(scheduler: _Following, script: _Script, last: float) -> None:
    """Run up to `last` s in virtual time: the scheduler runs the tasks at the very times of then."""
    if not script.has_end:
        scheduler.end_at(last + 1.0 / NS_PER_S)
    scheduler.after = script.give_due
    script.start()
    await asyncio.wait({scheduler.ended, script.ended}, return_when=asyncio.FIRST_COMPLETED)
    if script.may_go_on or script.ended.done():
        await script.ended


async def _take_steps(
    scheduler: _StepByStep, script: _Script, recorder: Recorder, steps: list[tuple[int, float, int]]
) -> None:
    """Run on the real clock's times: every step and every input in the recorded order."""
    with suppress(TaskFault):
        for number, step in enumerate(steps):
            script.give_up_to(number)
            scheduler.step(*step)
            if scheduler.ended.done():
                await scheduler.ended
            await recorder.written()
    script.give_up_to(scheduler.steps)


class _Following(Scheduler):
    """Calls `after` behind every step."""

    def __init__(self, on_fault: OnFault) -> None:
        super().__init__(on_fault)
        self.after: Callable[[], None] = lambda: None

    def _add(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> Any:
        def followed(ticks: Ticks) -> Coroutine[Any, Any, None]:
            coroutine = task(ticks)
            ends = ticks.ends

            def ended() -> None:
                if ends is not None:
                    ends()
                self.after()

            ticks.ends = ended
            return coroutine

        return super()._add(name, priority, period, followed)


class _StepByStep(Scheduler):
    """Runs a task's step when it is told to, at the time that it is told; no other clock plays a part."""

    time = 0.0  # s of the run

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self.time

    def add(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> None:
        """Add a task; that it is due is for the recording to say."""
        self._add(name, priority, period, task)

    def add_sporadic(self, name: str, priority: int, task: PeriodicTask) -> Callable[[], None]:
        """Add a task that runs on arrival; the same holds for it."""
        self._add(name, priority, None, task)
        return lambda: None

    def step(self, number: int, now: float, missed: int) -> None:
        """Run a cycle of the task that was added as this one, at `now`, so many having been missed before it."""
        entry = self._entries[number]
        self.time, entry.ticks.missed = now, missed
        self.steps += 1
        try:
            entry.send(now)
        except Exception as error:
            self._fault(entry, error)


class _Failure(Exception):
    """Stands for an error that a task of the user's raised when it was recorded."""


class _Script:
    """Gives the recorded inputs again, each at its time and behind the step that it came behind."""

    def __init__(self, runtime: Runtime, inputs: list[tuple[float, Input]]) -> None:
        self._runtime = runtime
        self._scheduler = runtime.scheduler
        self._loop = asyncio.get_running_loop()
        self._outside: deque[tuple[float, Input]] = deque()
        self._by_source: dict[str, deque[tuple[float, Input]]] = {}
        for time, given in inputs:
            inside = given.source and given.kind != "task"
            (self._by_source.setdefault(given.source, deque()) if inside else self._outside).append((time, given))
        self._end_step = self._outside[-1][1].step if self.has_end else None
        self.ended: asyncio.Future[None] = self._loop.create_future()

    @property
    def has_end(self) -> bool:
        """Whether the recording goes on to the end of the run."""
        return bool(self._outside) and self._outside[-1][1].kind == "end"

    @property
    def may_go_on(self) -> bool:
        """Whether inputs are left that come behind the steps there were."""
        return self.has_end and self._outside[0][1].step <= self._scheduler.steps

    def start(self) -> None:
        """Give what came before the first step, and set a timer for what came next."""
        try:
            self.give_due()
        except RecordingError as error:  # in a timer, where it would only be logged
            self.ended.set_exception(error)
            return
        if self._outside:
            at = self._loop.time() + self._outside[0][0] - self._runtime.now - EARLY
            self._loop.call_at(at, self.start)

    def give_due(self) -> None:
        """Give the inputs from outside that are due behind this step."""
        outside, scheduler = self._outside, self._scheduler
        while outside:
            (time, given), now = outside[0], self._runtime.now
            if time > now or (time == now and given.step > scheduler.steps):  # behind its time it is given in any case
                break
            self._give(*outside.popleft())
        if self._end_step == scheduler.steps:
            scheduler.end_at(self._runtime.now)  # no step came any more

    def give_up_to(self, step: int) -> None:
        """Give the inputs from outside that came behind this step or one before it."""
        while self._outside and self._outside[0][1].step <= step:
            self._give(*self._outside.popleft())

    def _give(self, time: float, given: Input) -> None:
        runtime, text, values = self._runtime, given.text, given.values
        if isinstance(self._scheduler, _StepByStep):
            self._scheduler.time = time
        match given.kind:
            case "task":
                inputs = self._by_source.get(text, deque())
                runtime.add_task(text, round(values[0]), values[1], partial(self._repeat, inputs))
            case "end":
                if not self.ended.done():
                    self.ended.set_result(None)
            case "failure":
                raise _Failure(text)
            case "look":
                runtime.look()
            case "tell":
                runtime.tell(text)
            case "arm":
                with suppress(NotArmed):
                    runtime.arm()
            case "disarm":
                runtime.disarm(text)
            case "slept":
                runtime.slept(values[0])
            case "stop":
                runtime.emergency_stop()
            case "press":
                runtime.press(Button(round(values[0])))
            case "place":
                runtime.place(*values)
            case _:
                try:
                    runtime.post(from_numbers(given.kind, values), given.given)
                except ValueError as error:
                    raise RecordingError(f"{INPUT.name}: {error}") from None

    async def _repeat(self, inputs: deque[tuple[float, Input]], ticks: Ticks) -> None:
        """Stand for a task of the user's: give what it gave, in the same steps."""
        async for _ in ticks:
            while inputs and inputs[0][1].step <= self._scheduler.steps:
                self._give(*inputs.popleft())
