"""Stand-ins that give a runtime its recorded inputs again.

How it works
============

`txt1.record.verification` says what a replay is. Here are its four stand-ins and the order in which they give inputs.

**Order is all.** Two inputs at the same time may have different effects, depending on the task that ran between them.
So the recorder notes with each input the count of task steps before it (`step`), and that count decides here. Time only
says when to look. The scheduler counts its steps in the replay as in the recorded run.

Inputs fall into two groups, by who gave them (`source`):

- *From outside* (`source` is empty): an operator, a bridge, a program's own coroutine. They came between two steps.
  `Script` keeps them in one queue, in the order of the recording.
- *In a step* (`source` is the name of a task): a task of the user's, or the task that reads a sensor. They came in the
  course of that task's step. Each source has a queue of its own, and takes from it in its own step: `Script._repeat`
  stands for a user's task, `RecordedSensor` for a sensor's driver.

**In virtual time** two things may bring an input from outside due. `Following` calls `Script.give_due` after every
step, which gives the inputs that came right after it. An input in an instant without any step needs a timer
(`Script.start`). The timer is set `EARLY` ahead of the tasks' timers of the same nanosecond, so that an input which
came before the steps of its instant is not late. If it came behind them, its `step` is still ahead, and the timer is
set again, until the steps have run. A step that never comes would make the timer go on for ever. So after `TURNS_MAX`
turns the clock moves on by a nanosecond, and the input is given.

**On the real clock** there is no timer at all. `verification` goes through the recorded steps, calls
`Script.give_up_to` for the inputs ahead of each, and `StepByStep.step` to run it at its recorded time.

**Hardware** (`RecordedHal`) repeats its reports: a reading, or the error that it raised. `expect` gets the reports of a
step ahead of that step. A report that is not read in the replay still counts as the newest state, since the recorded
tasks saw it before their next step. Commands to the hardware do nothing, as the outputs are compared already.

An input that was refused (not armed, a fault of the hardware, a value out of range) is refused again. So `Script.give`
passes over exactly these errors. An error of a user's own task is recorded as "failure" and raised again.

"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, NamedTuple, cast

from txt1.errors import HalError, NotArmed, RecordingError
from txt1.hal.base import Button, Capabilities, Hal, Inputs
from txt1.hal.plain_hal import PlainHal
from txt1.hal.recorded_hal import CALLS
from txt1.kernel.clock import NS_PER_S
from txt1.kernel.scheduler import PeriodicTask, Scheduler
from txt1.kernel.ticks import Ticks
from txt1.protocol.layout import from_numbers
from txt1.runtime import OnFault, Runtime
from txt1.sensors.base import Reading, Sensor
from txt1.tasks.inputs import INPUT, REPORT, Input, Report
from txt1.telemetry import exact

EARLY: Final = 0.4 / NS_PER_S
"""s by which an input's timer is ahead of the tasks' timer for the same ns of virtual time."""

TURNS_MAX: Final = 100
"""Turns of the event loop that an input waits for the steps of its own instant."""


@dataclass
class TaskStep:
    """A step of a task: its number, its time, the cycles missed before it, and what the hardware reported in it."""

    task: int
    time: float
    missed: int
    reports: list[Report] = field(default_factory=list)


class Given(NamedTuple):
    """An input with its time, s of the run."""

    time: float
    what: Input | Report


class UserError(Exception):
    """Stands for an error that a user's task raised in the recorded run."""


class RecordedHal(PlainHal):
    """Hardware that repeats its recorded reports, and ignores commands."""

    def __init__(self, name: str, capabilities: Capabilities) -> None:
        self.name, self.capabilities = name, capabilities
        self._reports: deque[Report] = deque()
        self._inputs = Inputs()
        for method in CALLS:
            setattr(self, method, partial(self._call, method))

    def expect(self, reports: Sequence[Report]) -> None:
        """Take the reports of the next step."""
        # what nobody has read is how it is now, all the same
        while self._reports:
            self._inputs = self._reports.popleft().value or self._inputs
        self._reports.extend(reports)

    async def open(self) -> None:
        """Do nothing: there is no hardware."""

    async def close(self) -> None:
        """Do nothing: there is no hardware."""

    def read(self, now: float) -> Inputs:
        """Return the recorded report; HalError: the recorded report was a failure."""
        self._call("read", now)
        return self._inputs

    def _call(self, method: str, *arguments: object) -> None:
        del arguments
        if self._reports and self._reports[0].kind == method:
            report = self._reports.popleft()
            if report.text:
                raise HalError(report.text)
            self._inputs = report.value

    def as_hal(self) -> Hal:
        """Return itself, as a hardware layer."""
        return cast("Hal", self)


class RecordedSensor:
    """A sensor that repeats its recorded readings in the same steps; `made` is its ordinary driver."""

    simulated = True

    def __init__(self, name: str, made: Sensor[Any], script: Script) -> None:
        self.topic, self.period = made.topic, made.period
        self._name, self._script = name, script
        self._given = script.of(f"sensor {name}")
        self._needed = True

    async def open(self) -> None:
        """Do nothing: there is no hardware."""

    async def close(self) -> None:
        """Do nothing: there is no hardware."""

    def needed(self) -> bool:
        """Return whether the sensor was read in this step."""
        while self._due() and self._given[0].what.kind in ("idle", "asked"):
            self._needed = self._given.popleft().what.kind == "asked"
        return self._needed

    def read(self, now: float) -> Reading[Any] | None:
        """Return this step's reading, None if there was none; HalError: the recorded reading was a failure."""
        del now
        reading = None
        while self._due():
            time, what = self._given.popleft()
            # an input from within a sensor is, for example, a look at where a simulated robot is
            if isinstance(what, Input):
                self._script.give(time, what)
            elif what.kind == "fails":
                raise HalError(what.text)
            elif what.kind == "reading":
                reading = Reading(what.time, self._value(what))
        return reading

    def _due(self) -> bool:
        return bool(self._given) and self._given[0].what.step <= self._script.steps

    def _value(self, report: Report) -> Any:
        try:
            return exact.decode(self.topic.type, report.value)
        except ValueError as error:
            self._script.fail(
                f"{REPORT.name}: a reading of '{self._name}' at {report.time:.3f} s cannot be given again: {error}"
            )
            raise


class Script:
    """Gives the recorded inputs again, each at its time and after the same step."""

    def __init__(self, runtime: Runtime, given: Sequence[Given]) -> None:
        self._runtime = runtime
        self._scheduler = runtime.scheduler
        self._loop = asyncio.get_running_loop()
        self._outside: deque[Given] = deque()
        self._by_source: dict[str, deque[Given]] = {}
        for each in given:
            inside = each.what.source not in ("", "hal") and each.what.kind != "task"
            (self.of(each.what.source) if inside else self._outside).append(each)
        self._end_step = self._outside[-1].what.step if self.has_end else None
        self.ended: asyncio.Future[None] = self._loop.create_future()
        # turns of the loop in which an input was waiting in vain
        self._turns = 0
        self.failure: RecordingError | None = None
        """The reason why the recording cannot be given again."""

    def fail(self, reason: str) -> None:
        """Note that the recording cannot be replayed, and why."""
        self.failure = self.failure or RecordingError(reason)

    def of(self, source: str) -> deque[Given]:
        """Return the inputs of a task or the readings of a sensor."""
        return self._by_source.setdefault(source, deque())

    @property
    def steps(self) -> int:
        """The count of all tasks' steps."""
        return self._scheduler.steps

    @property
    def has_end(self) -> bool:
        """Whether the recording reaches the end of the run."""
        return bool(self._outside) and self._outside[-1].what.kind == "end"

    @property
    def may_go_on(self) -> bool:
        """Whether inputs remain after the recorded steps."""
        return self.has_end and self._outside[0].what.step <= self.steps

    def start(self) -> None:
        """Give the inputs before the first step, and set a timer for the next input."""
        try:
            self.give_due()
        except RecordingError as error:
            # in a timer it would only be logged
            self.ended.set_exception(error)
            return
        if self._outside:
            ahead = self._outside[0].time - self._runtime.now
            self._turns = 0 if ahead > 0.0 else self._turns + 1
            # one that waits for a step of this instant, which does not come, is given a nanosecond later
            ahead = 1.0 / NS_PER_S if self._turns > TURNS_MAX else ahead - EARLY
            self._loop.call_at(self._loop.time() + ahead, self.start)

    def give_due(self) -> None:
        """Give the outside inputs that came right after this step."""
        outside = self._outside
        while outside:
            (time, given), now = outside[0], self._runtime.now
            # behind its time it is given in any case
            if time > now or (time == now and given.step > self.steps):
                break
            self.give(*outside.popleft())
        if self._end_step == self.steps:
            # no step came any more
            self._scheduler.end_at(self._runtime.now)

    def give_up_to(self, step: int) -> None:
        """Give the outside inputs that came after this step or an earlier one."""
        while self._outside and self._outside[0].what.step <= step:
            self.give(*self._outside.popleft())

    def give(self, time: float, given: Input | Report) -> None:
        """Give an input now."""
        runtime = self._runtime
        if isinstance(self._scheduler, StepByStep):
            self._scheduler.time = time
        if isinstance(given, Report):
            if isinstance(runtime.hal, RecordedHal):
                runtime.hal.expect([given])
            return
        # what was refused then is refused now
        with suppress(NotArmed, HalError, ValueError):
            self._do(given)

    def _do(self, given: Input) -> None:
        runtime, text, values = self._runtime, given.text, given.values
        match given.kind:
            case "task":
                runtime.add_task(text, round(values[0]), values[1], partial(self._repeat, self.of(text)))
            case "end":
                if not self.ended.done():
                    self.ended.set_result(None)
            case "failure":
                raise UserError(text)
            case "look":
                runtime.look()
            case "tell":
                runtime.tell(text)
            case "arm":
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

    async def _repeat(self, inputs: deque[Given], ticks: Ticks) -> None:
        """Replace a user's task: give its inputs again in the same steps."""
        async for _ in ticks:
            while inputs and inputs[0].what.step <= self.steps:
                time, what = inputs.popleft()
                # nobody here consumes the readings of a user's sensor
                if isinstance(what, Input):
                    self.give(time, what)


class Following(Scheduler):
    """Calls `after` after every step."""

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


class StepByStep(Scheduler):
    """Runs a task's step on request, at the time of the request; it reads no other clock."""

    time = 0.0  # s of the run

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self.time

    def add(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> None:
        """Add a task; the recording decides when it runs."""
        self._add(name, priority, period, task)

    def add_sporadic(self, name: str, priority: int, task: PeriodicTask) -> Callable[[], None]:
        """Add a task that runs on arrival; the recording decides when it runs."""
        self._add(name, priority, None, task)
        return lambda: None

    def step(self, number: int, now: float, missed: int) -> None:
        """Run a cycle of the task with this number at `now`, after the given count of missed cycles."""
        if not number < len(self._entries):
            raise RecordingError(f"a step of task {number}, and there are {len(self._entries)} tasks")
        entry = self._entries[number]
        self.time, entry.ticks.missed = now, missed
        entry.statistics.cycles += 1
        try:
            entry.send(now)
        except Exception as error:
            self._raised(entry, error)
