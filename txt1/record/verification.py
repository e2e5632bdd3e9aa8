"""Run a recording's inputs through the tasks again, in virtual time, and compare the outputs with the recorded outputs.

How it works
============

The tasks are a function: the same inputs, in the same order between the same steps, give the same outputs to the last
bit. A recording holds the configuration, all inputs and all outputs. So a replay makes a fresh runtime from the
configuration, gives it the inputs, and compares its outputs with the recorded outputs, message by message.

**Inputs** come from four sides. Each is recorded with its time and with `step`, the number of task steps before it. It
is given again by a class of `txt1.record.recorded_inputs`:

==================================  ===========  ================================================================
input                               topic        how it is given again
==================================  ===========  ================================================================
messages and actions of the user    `/input`     `Script` calls the runtime: arm, stop, set-point ...
a sensor's reading                  `/reports`   `RecordedSensor` stands in the place of the driver
a report of real hardware           `/reports`   `RecordedHal` stands in the place of the HAL
a task's step, on the real clock    `/steps`     `StepByStep` stands in the place of the scheduler
==================================  ===========  ================================================================

Guards, the estimate and other readers of sensors are the ordinary ones. Simulated hardware is simulated anew: it is
a function of its inputs, too, so recording it would only hide a difference.

**Two kinds of time** make two ways to run:

- *Virtual time* (`_Again._follow`). The scheduler is deterministic there. It runs every task at the very time of the
  recording by itself, so the steps are not in the recording. `Following` only calls the script behind each step,
  which gives the inputs that came behind that step.
- *The real clock* (`_Again._take_steps`). When a task ran depended on the computer. So each step is recorded with its
  time and the cycles missed before it, and is run when its turn comes; nothing waits for a clock.

**The outputs** go from the fresh runtime's bus through an ordinary recorder into a `comparison.Comparison`, which takes
the place of the file. It reads the recording once more from the front and holds each message against the next recorded
one. Two kinds of messages may differ and are not compared: those of the robot's commanders, and, on the real clock, the
tasks' run times. The first difference is the verdict. Causes come before their effects, so it names the topic that
differed first.

**Several robots** that were simulated together meet in one world, so they run again together. If the file holds
only one of them, it runs alone, and the others' places are not compared.

"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from txt1.errors import TaskFault
from txt1.hal.base import Hal
from txt1.hal.registry import create, in_world, world_of
from txt1.kernel.clock import NS_PER_S
from txt1.kernel.loop import run
from txt1.kernel.scheduler import Scheduler
from txt1.model.channels import Channels
from txt1.record.comparison import Comparison, Difference
from txt1.record.reader import robot_in, robots_in
from txt1.record.recorded_inputs import Following, RecordedHal, RecordedSensor, Script, StepByStep
from txt1.record.recorded_run import Recorded, read
from txt1.record.recorder import Origin, Recorder
from txt1.record.session import close
from txt1.runtime import Runtime
from txt1.sensors.base import SENSORS
from txt1.sim.world import World
from txt1.tasks.fields import VEHICLES

Attach = Callable[[Runtime], None]


class Verdict(NamedTuple):
    """The result of a replay."""

    compared: int
    """Messages."""
    difference: Difference | None
    """The first; None if there is none."""
    topics: dict[str, int] = {}  # noqa: RUF012
    """Counts of compared messages, by topic."""
    uncompared: dict[str, int] = {}  # noqa: RUF012
    """Counts of recorded messages that were not compared, by topic; after a difference only those before it."""
    left_out: tuple[str, ...] = ()
    """Recorded topics that were not compared, and topics in snapshots that were not."""
    exact: bool = True
    """Whether every bit had to be equal; on another processor or with other libraries, numbers within 1e-6."""
    lacks: str = ""
    """Contents that an older version did not record, and that were not compared."""
    former: str = ""
    """The version of txt1 that made the recording, if it is an earlier one."""


def verify(path: Path, robot: str | None = None, attach: Attach = lambda runtime: None) -> Verdict:
    """Return the verdict on a recorded run; with several robots, on the `robot` of that name, or for None on all.

    `attach` is called with each runtime before it starts, as by `Robot.open`, for example to add a program's own
    guards. Robots that were simulated together are simulated together again.

    Raises RecordingError: the file cannot be read, is no recording of txt1, or cannot be run again.
    """
    names = robots_in(path)
    if robot is not None:
        robot = robot_in(path, robot)
    robots = [read(path, name) for name in names]
    together = len(robots) > 1 and not robots[0].steps
    groups = [robots] if together else [[each] for each in robots if robot in (None, each.robot)]
    found: list[Comparison] = []
    for group in groups:
        found += run(_replay(group, attach), speed="max")
    chosen = [each for each in found if robot in (None, each.robot)]
    differences = [each.difference for each in chosen if each.difference is not None]
    topics: Counter[str] = sum((each.compared for each in chosen), Counter())
    uncompared: Counter[str] = sum((each.uncompared for each in chosen), Counter())
    left_out = sorted({name for each in chosen for name in each.left_out})
    return Verdict(
        topics.total(),
        min(differences, default=None, key=lambda each: each.time),
        dict(sorted(topics.items())),
        dict(sorted(uncompared.items())),
        tuple(left_out),
        robots[0].alike,
        robots[0].lacks,
        robots[0].former,
    )


async def _replay(robots: list[Recorded], attach: Attach) -> list[Comparison]:
    """Run robots again, in one world if they shared one."""
    shared = robots[0].shared or len(robots) > 1
    world = world_of(robots[0].config) if shared else None
    again = [_Again(recorded, world, len(robots) == 1, attach) for recorded in robots]
    for each in again:
        await each.start()
    await asyncio.gather(*(each.run() for each in again))
    return [each.comparison for each in again]


class _Again:
    """A robot that is run again."""

    def __init__(self, recorded: Recorded, world: World | None, alone: bool, attach: Attach) -> None:
        self._recorded, config = recorded, recorded.config
        self._alone = recorded.shared and alone
        hal: Hal
        if recorded.reports and recorded.hardware is not None:
            hal = RecordedHal(*recorded.hardware).as_hal()
            # what the channels' settings put right is so in the reports already
            config = config.model_copy(update={"channels": Channels()})
        else:
            config = config if world is None else in_world(config, world)
            hal = create(config, world)
        self.runtime = Runtime(
            config,
            lambda message: None,
            hal,
            scheduler=StepByStep if recorded.steps else Following,
            sensing=recorded.sensed,
            through=lambda name, sensor: RecordedSensor(name, sensor, self.script),
        )
        self.comparison = Comparison(
            recorded.path,
            recorded.robot,
            self.runtime,
            exact=recorded.alike,
            real=bool(recorded.steps),
            sensed=recorded.sensed,
            ends=recorded.reports,
        )
        self.recorder = Recorder(self.runtime, [self.comparison], Origin(recorded.epoch), batch=1.0)
        attach(self.runtime)
        self.script = Script(self.runtime, recorded.given)

    async def start(self) -> None:
        """Bring it up."""
        await self.runtime.start()
        for polled in self.runtime.sensors.values():
            if isinstance(polled.sensor, RecordedSensor):
                polled.needed = polled.sensor.needed
        self.comparison.begin()
        if any(what.kind == "task" and what.text.startswith("sensor ") for _, what in self._recorded.given):
            # a program added sensors, which nobody has here
            self.comparison.leave_out(SENSORS)
        if self._alone:
            # the others have recordings of their own
            self.comparison.leave_out(VEHICLES)
        script, scheduler = self.script, self.runtime.scheduler
        if isinstance(scheduler, Following):
            if not script.has_end:
                scheduler.end_at(self._recorded.last + 1.0 / NS_PER_S)
            scheduler.after = script.give_due
            # in this turn of the loop, ahead of the first step
            script.start()

    async def run(self) -> None:
        """Run it to its end."""
        scheduler = self.runtime.scheduler
        # a task that fails here failed when it was recorded, too, or the messages differ
        with suppress(TaskFault):
            try:
                if isinstance(scheduler, StepByStep):
                    await self._take_steps(scheduler)
                else:
                    await self._follow(scheduler)
            finally:
                if self._recorded.reports:
                    # whether the hardware stood is in its reports; nobody waits for it here
                    self.runtime.watch = None
                await self.runtime.stop()
        await close([self.recorder], [self.comparison])
        if self.script.failure is not None:
            raise self.script.failure

    async def _follow(self, scheduler: Scheduler) -> None:
        """Run in virtual time: the scheduler runs the tasks at the recorded times."""
        script = self.script
        await asyncio.wait({scheduler.ended, script.ended}, return_when=asyncio.FIRST_COMPLETED)
        if script.may_go_on or script.ended.done():
            await script.ended

    async def _take_steps(self, scheduler: StepByStep) -> None:
        """Run on the real clock's times: every step and every input in the recorded order."""
        hal = self.runtime.hal
        with suppress(TaskFault):
            for number, step in enumerate(self._recorded.steps):
                self.script.give_up_to(number)
                if isinstance(hal, RecordedHal):
                    hal.expect(step.reports)
                scheduler.step(step.task, step.time, step.missed)
                if scheduler.ended.done():
                    await scheduler.ended
                await self.recorder.written()
        self.script.give_up_to(scheduler.steps)
