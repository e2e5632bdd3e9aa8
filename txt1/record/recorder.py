"""The recorder: a task of the lowest priority that samples the state, and a witness of all that is given from outside.

In the loop it only keeps references. Every batch goes to another thread, which makes bytes of it and writes them. On
the real clock a writer that falls behind loses batches, which are counted; in virtual time the simulation waits.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Mapping, Sequence
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from typing import Any, Final, NamedTuple, Protocol

from txt1.errors import RecordingError
from txt1.kernel.loop import VirtualTimeLoop
from txt1.kernel.scheduler import PeriodicTask
from txt1.kernel.ticks import Ticks
from txt1.model.light import Readings
from txt1.protocol.layout import numbers
from txt1.protocol.messages import Message, Velocity
from txt1.record import topics
from txt1.record.encoder import INFO, WARN, Block, Encoder, Extra, Input, Sample, Tick
from txt1.runtime import Runtime
from txt1.tasks import controller

PRIORITY: Final = -100
"""Below every task of the robot's and the user's: it sees what they have done in the same instant."""

BATCH: Final = 0.5
"""s between two batches on the real clock: what a crash may lose, with what the disk needs."""

BATCH_MAX: Final = 5.0
"""s of the robot's time in a batch at full speed."""

BACKLOG: Final = 20
"""Batches that may wait for the writer on the real clock."""

SECOND: Final = round(1.0 / controller.PERIOD)
"""Samples in a second."""

TURNS: Final = 20
"""Cycles in which the tasks' statistics may be looked at, one task in each, and what has a turn besides."""

ROBOT_TASKS: Final = (
    "controller", "serial", "encoder", "mode", "display", "odometry", "battery", "button", "recorder",
)  # fmt: skip
"""The robot's own; their places here are their numbers in the messages about ticks."""


class Sink(Protocol):
    """Where encoded batches go; called in the writer's thread."""

    def write(self, block: Block) -> int:
        """Take a block; how many messages were lost with it. Raises RecordingError when nothing more can be taken."""

    def close(self, dropped: int, end: Mapping[str, str]) -> None:
        """No block comes any more; so many messages were lost, and so the run ended. Raises RecordingError."""


class _Batch(NamedTuple):
    samples: list[Sample]
    extras: list[Extra]
    skipped: int
    """Samples lost before it."""


class Recorder:
    """Watches a runtime.

    Args:
        runtime: not started yet.
        sinks: what takes the blocks.
        epoch: added to the run's time in every time stamp, s.
        batch: s between batches; None: as the clock asks for.
        keep_ticks: whether to record which of the robot's tasks ran when; None: on the real clock, where a simulation
            can be run again when that is known. What has a line cannot: that has a time of its own.

    """

    def __init__(
        self,
        runtime: Runtime,
        sinks: Sequence[Sink],
        epoch: float,
        batch: float | None = None,
        keep_ticks: bool | None = None,
    ) -> None:
        self._overflowed = 0  # messages lost because the writer was behind; counted in the loop
        self._not_written = 0  # ... and because the disk did not take them; counted in the writer's thread
        self._runtime = runtime
        self._sinks = sinks
        self._loop = asyncio.get_running_loop()
        self._virtual = isinstance(self._loop, VirtualTimeLoop)
        if batch is None:
            speed = self._loop.speed if isinstance(self._loop, VirtualTimeLoop) else 1.0
            batch = BATCH_MAX if speed is None else min(BATCH * speed, BATCH_MAX)
        self._batch_samples = max(1, round(batch / controller.PERIOD))
        self._cycle = 0
        if keep_ticks is None:
            lone = runtime.name == runtime.hal.name and not hasattr(
                runtime.hal, "tap_line"
            )  # no board, no board's host
            keep_ticks = lone and runtime.hal.capabilities.simulated and not self._virtual
        self._keeps_ticks = keep_ticks
        self._ticks: list[Tick] = []
        self._ticks_before = 0
        self.source = ""
        """The user's or the driver's task that is at work."""
        self._samples: list[Sample] = []
        self._extras: list[Extra] = []
        self._skipped = 0
        self._last_event: object = None
        self._last_faults: dict[str, int] | None = None
        self._tasks: dict[str, dict[str, object]] = {}
        self._told = False
        self._end: dict[str, str] = {}
        self._failure: RecordingError | None = None
        capabilities = runtime.hal.capabilities
        self._encoder = Encoder(epoch, ticks=capabilities.ticks, pose=capabilities.pose)
        self._queue: SimpleQueue[_Batch | None] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._job: asyncio.Future[None] | None = None
        # all the tasks' statistics, one a cycle, and not too often: a histogram's percentiles take their time
        self._statistics_period = SECOND * (2 if not self._virtual else 10)

    @property
    def dropped(self) -> int:
        """Messages lost so far, because the writer or the disk did not take them."""
        return self._overflowed + self._not_written

    def attach(self) -> None:
        """Start watching; the runtime is started afterwards."""
        runtime = self._runtime
        runtime.witness = self
        tap_line = getattr(runtime.hal, "tap_line", None)  # where there is a line
        if tap_line is not None:
            tap_line(self.line)
        runtime.add_task("recorder", PRIORITY, controller.PERIOD, self._sample)
        if not self._virtual:
            self._thread = threading.Thread(target=self._write_all, name="txt1 recorder", daemon=True)
            self._thread.start()

    async def close(self) -> None:
        """Write what is left and close the sinks.

        Raises:
            RecordingError: they have failed, on the way or now.

        """
        self._runtime.witness = None
        self._take_events()
        if self._virtual:
            await self.written()
            if self._failure is None:
                await self._loop.run_in_executor(None, self._write, self._take_batch())
        else:
            self._queue.put(self._take_batch())
            self._queue.put(None)
            if self._thread is not None:
                await self._loop.run_in_executor(None, self._thread.join)
        await self._loop.run_in_executor(None, self._close_sinks)
        if self._failure is not None:
            raise self._failure

    async def written(self) -> None:
        """Wait until the sinks have what was handed over; in virtual time, where nothing else goes on meanwhile."""
        if self._job is not None:
            with suppress(RecordingError):
                await self._job

    def _close_sinks(self) -> None:
        for sink in self._sinks:
            try:
                sink.close(self.dropped, self._end)
            except RecordingError as error:
                self._failure = self._failure or error

    # -- in the loop -------------------------------------------------------------------------------------------

    async def _sample(self, ticks: Ticks) -> None:
        """Keep what there is to be seen, once per controller cycle."""
        runtime = self._runtime
        state, gate = runtime.state, runtime.gate
        events = state.events
        try:
            async for now in ticks:
                samples = self._samples
                samples.append(
                    Sample(
                        now, state.odometry, state.control, state.gains.linear, state.encoders, state.pose,
                        state.battery, gate.armed, gate.stopped, gate.reason, state.link, state.power, state.panel,
                    )
                )  # fmt: skip
                if events and events[-1] is not self._last_event:
                    self._take_events()
                if self._cycle % SECOND < 2 or self._cycle % self._statistics_period < TURNS:
                    self._take_turns(now)
                self._cycle += 1
                if len(samples) >= self._batch_samples:
                    self._hand_over()
        finally:  # the run has ended; what the hardware does in closing is none of it
            self._end = {
                "duration": repr(runtime.now),
                "cycles": str(self._cycle),
                "received": str(state.received),
            }

    def _take_turns(self, now: float) -> None:
        """What need not be looked at in every cycle, spread over the cycles."""
        turn = self._cycle % self._statistics_period
        names = self._runtime.task_names[: TURNS - 1]
        if turn < len(names):
            self._tasks[names[turn]] = self._statistics(names[turn])
        elif turn == len(names):
            self._extra(now, topics.DIAGNOSTICS, self._tasks)
            self._tasks = {}
        if self._cycle % SECOND == 0:
            faults = {name: count for name, count in self._runtime.faults().items() if count}
            if faults != self._last_faults:
                self._last_faults = faults
                self._extra(now, topics.FAULTS, faults)
        snapshot = self._runtime.state.snapshot
        if self._cycle % SECOND == 1 and snapshot is not None:
            # the tasks' times are the processor's, and different in every run
            self._extra(snapshot.time, topics.SNAPSHOT, snapshot._replace(tasks=()) if self._virtual else snapshot)
        if self._failure is not None:
            raise self._failure
        if self.dropped and not self._told:
            self._told = True
            self._runtime.state.tell(now, "the recording loses messages: the disk is full or too slow")

    def _statistics(self, name: str) -> dict[str, object]:
        task = self._runtime.statistics()[name]
        shown: dict[str, object] = {"cycles": task.cycles, "misses": task.misses}
        if not self._virtual:  # there nobody is late, and the times are those of the processor
            for what, percentiles in (
                ("lateness", task.lateness.percentiles()),
                ("run_time", task.run_time.percentiles()),
            ):
                shown |= {f"{what}_{name}_s": f"{value:.9f}" for name, value in percentiles._asdict().items()}
        return shown

    def _take_events(self) -> None:
        """The lines that were added to the event log since the last time."""
        fresh = []
        for event in reversed(self._runtime.state.events):
            if event is self._last_event:
                break
            fresh.append(event)
        for event in reversed(fresh):
            self._last_event = event
            warn = event.text.startswith(("disarmed", "link lost", "batteries"))
            self._extra(event.time, topics.LOG, (WARN if warn else INFO, event.text))

    def _extra(self, now: float, topic: str, content: Any) -> None:
        self._extras.append(Extra(len(self._samples), now, topic, content))

    def _take_batch(self) -> _Batch:
        if self._ticks:
            self._extra(self._ticks[-1][1], topics.TICKS, self._ticks.copy())
            self._ticks_before += len(self._ticks)
            self._ticks.clear()
        batch = _Batch(self._samples, self._extras, self._skipped)
        self._samples, self._extras, self._skipped = [], [], 0
        return batch

    def _hand_over(self) -> None:
        """Give the batch to the writer, or drop it where it is too far behind."""
        if self._virtual:
            job = self._loop.run_in_executor(None, self._write, self._take_batch())
            job.add_done_callback(self._done)
            self._job = job
        elif self._queue.qsize() < BACKLOG:
            self._queue.put(self._take_batch())
        else:
            self._overflowed += len(self._samples) * self._encoder.sampled + len(self._extras)
            self._ticks_before += len(self._ticks)
            self._ticks.clear()
            skipped = self._skipped + len(self._samples)
            self._samples, self._extras, self._skipped = [], [], skipped

    def _done(self, job: asyncio.Future[None]) -> None:
        if not job.cancelled() and isinstance(error := job.exception(), RecordingError):
            self._failure = error

    # -- what is given from outside ----------------------------------------------------------------------------

    def message(self, message: Message, time: float) -> None:
        """A message was posted, which its author gave at `time`."""
        now = self._runtime.now
        self._input(now, type(message).__name__, "", time, numbers(message))
        if isinstance(message, Velocity):
            self._extra(now, topics.COMMAND, (message.v, message.omega))

    def action(self, now: float, kind: str, text: str = "", values: tuple[float, ...] = ()) -> None:
        """Something else was done: arm, disarm, stop, press, place."""
        self._input(now, kind, text, now, values)

    def task(self, name: str, priority: int, period: float | None, task: PeriodicTask) -> PeriodicTask:
        """The task itself, or one in its place that says when it is at work."""
        if name not in ROBOT_TASKS:
            self._input(self._runtime.now, "task", name, 0.0, (float(priority), period or 0.0))
            return partial(self._named, name, task)
        return partial(self._kept, ROBOT_TASKS.index(name), task) if self._keeps_ticks else task

    def _kept(self, number: int, task: PeriodicTask, ticks: Ticks) -> Coroutine[Any, Any, None]:
        """One of the robot's own tasks, of which it is kept when it ran."""
        keep = self._ticks.append
        ticks.begins = lambda now: keep((number, now, ticks.missed))
        return task(ticks)

    async def _named(self, name: str, task: PeriodicTask, ticks: Ticks) -> None:
        """A task of the user's, which is the source of what comes in while it is at work."""

        def begins(_: float) -> None:
            self.source = name

        def ends() -> None:
            self.source = ""

        ticks.begins, ticks.ends = begins, ends
        try:
            await task(ticks)
        except Exception as error:
            self.failed(error)
            raise

    def failed(self, error: Exception) -> None:
        """The task of the user's that is at work has raised."""
        now = self._runtime.now
        self._input(now, "failure", str(error), now, ())

    def _input(self, now: float, kind: str, text: str, given: float, values: tuple[float, ...]) -> None:
        tick = self._ticks_before + len(self._ticks)
        received = self._runtime.state.received
        self._extra(now, topics.INPUT, Input(self._cycle, tick, received, self.source, kind, text, given, values))

    def line(self, direction: str, data: bytes) -> None:
        """Bytes have come ("in") or gone ("out") on the line."""
        self._extra(self._runtime.now, topics.LINK, (direction, data))

    def light(self, lux: Readings) -> None:
        """The light sensors were read."""
        self._extra(self._runtime.now, topics.LIGHT, lux)

    def learning_step(self, episode: int, state: int, action: int, reward: float, values: tuple[float, ...]) -> None:
        """A learner has decided."""
        self._extra(self._runtime.now, topics.LEARNING, (episode, state, action, reward, values))

    # -- in the writer's thread --------------------------------------------------------------------------------

    def _write(self, batch: _Batch) -> None:
        if batch.skipped:
            self._encoder.skip(batch.skipped)
        block = self._encoder.block(batch.samples, batch.extras)
        for sink in self._sinks:
            lost = sink.write(block)
            self._not_written += lost

    def _write_all(self) -> None:
        while (batch := self._queue.get()) is not None:
            if self._failure is None:
                try:
                    self._write(batch)
                except RecordingError as error:
                    self._failure = error
                except Exception as error:
                    self._failure = RecordingError(f"the recorder failed: {error!r}")
                    self._failure.__cause__ = error
