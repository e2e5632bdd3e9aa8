"""Tells every input of the tasks, and its place among their steps: a replay needs all of them.

A robot on the real clock tells three things: every input before it takes effect (`Journal.begin`), every reading of a
sensor and report of the hardware (`Journal.report`), and every step of a task (`Journal.watched`). In virtual time the
steps and the hardware's reports follow from the rest, so they are not told. Without a listener nothing is told.
"""

from collections.abc import Coroutine
from typing import Any

from txt1.kernel.scheduler import PeriodicTask, Scheduler
from txt1.kernel.ticks import Ticks
from txt1.sensors.base import Reading
from txt1.tasks import inputs
from txt1.telemetry.bus import Bus


class Journal:
    """Tells a robot's bus the inputs of its tasks; `stepwise`: the steps are told, too."""

    def __init__(self, bus: Bus, scheduler: Scheduler, stepwise: bool) -> None:
        self._bus, self._scheduler, self._stepwise = bus, scheduler, stepwise
        self.source = ""
        """The present step's task, if it is a user's, the driver's or a sensor's; else ""."""

    def begin(self, kind: str, text: str = "", values: tuple[float, ...] = (), given: float | None = None) -> float:
        """Return the time (s of the run) of an action from outside, and tell the action before it takes effect."""
        now = self._scheduler.now
        if self._bus.wanted(inputs.INPUT):
            given = now if given is None else given
            event = inputs.Input(self._scheduler.steps, self.source, kind, text, given, values)
            self._bus.publish(inputs.INPUT, event, now)
        return now

    def report(self, source: str, kind: str, text: str = "", value: Any = None, time: float = 0.0) -> None:
        """Tell a report."""
        if self._bus.wanted(inputs.REPORT):
            report = inputs.Report(self._scheduler.steps, source, kind, text, time, value)
            self._bus.publish(inputs.REPORT, report, self._scheduler.now)

    def reading(self, task: str, kind: str, text: str, reading: Reading[Any] | None) -> None:
        """Tell a sensor's reading, or its failure."""
        time, value = (0.0, None) if reading is None else reading
        self.report(task, kind, text, value, time)

    def watched(self, name: str, task: PeriodicTask, number: int, named: bool) -> PeriodicTask:
        """Return the task with its steps told, by its `number`.

        `named`: inputs during a step name the task as their source.
        """
        told = self._stepwise and self._bus.wanted(inputs.STEP)
        if not told and not named:
            return task

        def watched(ticks: Ticks) -> Coroutine[Any, Any, None]:
            def begins(now: float) -> None:
                if told:
                    self._bus.publish(inputs.STEP, (number, now, ticks.missed), now)
                if named:
                    self.source = name

            def ends() -> None:
                self.source = ""

            ticks.begins = begins
            if named:
                ticks.ends = ends
            return task(ticks)

        return watched
