"""The recorded inputs through the tasks once more, in virtual time, to see whether the robot does what it did.

Everything that came from outside is in the recording, exactly, with its time and the number of the step behind which it
came: messages and actions (`/input`), the sensors' readings and, of hardware, its reports (`/reports`). It is given
again to a fresh runtime made from the recorded configuration, and what that one tells is compared with the recording
message by message (`txt1.record.comparison`). So guards, the estimate and whatever else reads a sensor work as ever;
only the sensors and the hardware beneath them are recorded ones (`txt1.record.replay`).

In virtual time the scheduler runs the tasks at the very times of then, and simulated hardware is simulated anew. On the
real clock every step is in the recording, too (`/steps`), and hardware reports what it reported.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from txt1.errors import RecordingError, TaskFault
from txt1.hal.base import Hal
from txt1.hal.registry import create, in_world
from txt1.kernel.clock import NS_PER_S
from txt1.kernel.loop import run
from txt1.kernel.scheduler import Scheduler
from txt1.model.channels import Channels
from txt1.record.comparison import Comparison, Difference
from txt1.record.reading import robots_in
from txt1.record.recorded import Recorded, read
from txt1.record.recorder import Recorder
from txt1.record.replay import Following, RecordedHal, RecordedSensor, Script, StepByStep
from txt1.record.settings import RecordConfig
from txt1.runtime import Runtime
from txt1.sensors.base import SENSORS
from txt1.sim.room import Room
from txt1.sim.world import World
from txt1.tasks.fields import VEHICLES

Attach = Callable[[Runtime], None]


class Verdict(NamedTuple):
    """The result of a replay."""

    compared: int
    """Messages."""
    difference: Difference | None
    """The first; None if there is none."""
    topics: dict[str, int] = {}  # noqa: RUF012 - never changed
    """The messages that were compared, by topic."""
    left_out: tuple[str, ...] = ()
    """The topics in the recording that were not compared, and those in its snapshots."""
    exact: bool = True
    """Whether every bit had to be the same; else numbers within 1e-6, as processor or libraries are others."""
    lacks: str = ""
    """Something that the recording lacks, as it is older than this version."""


def verify(path: Path, robot: str | None = None, attach: Attach = lambda runtime: None) -> Verdict:
    """The verdict on a recorded run, of several robots on that one; None: on all of them.

    `attach` is called with each runtime before it starts, as by `Robot.open`: with guards of a program's own, for
    example. Robots that were simulated together are so again.

    Raises RecordingError: the file cannot be read, is no recording of txt1's, or not of what can be run again.
    """
    names = robots_in(path)
    if robot is not None and robot not in names:
        raise RecordingError(f"{path}: robot '{robot}' is not in it; choose one of: {', '.join(names) or 'none'}")
    robots = [read(path, name) for name in names]
    together = len(robots) > 1 and not robots[0].steps
    groups = [robots] if together else [[each] for each in robots if robot in (None, each.robot)]
    found: list[Comparison] = []
    for group in groups:
        found += run(_replay(group, attach), speed="max")
    chosen = [each for each in found if robot in (None, each.robot)]
    differences = [each.difference for each in chosen if each.difference is not None]
    topics: Counter[str] = sum((each.compared for each in chosen), Counter())
    left_out = sorted({name for each in chosen for name in each.left_out})
    return Verdict(
        topics.total(), min(differences, default=None, key=lambda each: each.time), dict(sorted(topics.items())),
        tuple(left_out), robots[0].alike, robots[0].lacks,
    )  # fmt: skip


async def _replay(robots: list[Recorded], attach: Attach) -> list[Comparison]:
    """Run robots again, in one world where they were in one."""
    sim = robots[0].config.sim
    shared = robots[0].shared or len(robots) > 1
    world = World(Room(sim.room.length, sim.room.width), sim.room.light, sim.obstacles) if shared else None
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
            config = config.model_copy(update={"channels": Channels()})  # its reports are put right already
        else:
            config = config if world is None else in_world(config, world)
            hal = create(config, world)
        self.runtime = Runtime(
            config, lambda message: None, hal,
            scheduler=StepByStep if recorded.steps else Following, sensing=recorded.sensed,
            through=lambda name, sensor: RecordedSensor(name, sensor, self.script),
        )  # fmt: skip
        self.comparison = Comparison(
            recorded.path, recorded.robot, self.runtime,
            exact=recorded.alike, real=bool(recorded.steps), sensed=recorded.sensed,
            ends=recorded.reports,
        )  # fmt: skip
        self.recorder = Recorder(self.runtime, [self.comparison], config.section(RecordConfig).epoch, batch=1.0)
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
            self.comparison.leave_out(SENSORS)  # a program added some, which nobody has here
        if self._alone:
            self.comparison.leave_out(VEHICLES)  # the others have recordings of their own
        script, scheduler = self.script, self.runtime.scheduler
        if isinstance(scheduler, Following):
            if not script.has_end:
                scheduler.end_at(self._recorded.last + 1.0 / NS_PER_S)
            scheduler.after = script.give_due
            script.start()  # in this turn of the loop, ahead of the first step

    async def run(self) -> None:
        """Run it to its end."""
        scheduler = self.runtime.scheduler
        with suppress(TaskFault):  # it failed when it was recorded, too, or the messages differ
            try:
                if isinstance(scheduler, StepByStep):
                    await self._take_steps(scheduler)
                else:
                    await self._follow(scheduler)
            finally:
                if self._recorded.reports:
                    self.runtime.watch = None  # it stood, or not, in its own time
                await self.runtime.stop()
        await self.recorder.close()
        if self.script.failure is not None:
            raise self.script.failure

    async def _follow(self, scheduler: Scheduler) -> None:
        """Run in virtual time: the scheduler runs the tasks at the very times of then."""
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
