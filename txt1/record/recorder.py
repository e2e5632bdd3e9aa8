"""The recorder writes every message of a robot's bus, in batches, to a file or to a live view.

In real time the loop makes each cycle's messages to records when the cycle is over, and a thread compresses and writes
them, batch by batch. The thread computes next to nothing that holds the interpreter's lock, so no cycle waits for it. A
writer that falls behind loses batches; they are counted. At full speed the loop does all of it itself, in batches, as
no deadline has to be met.
"""

import asyncio
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import compress
from typing import Any, Final, Protocol

from txt1.errors import RecordingError
from txt1.kernel.clock import seconds, wall_ns
from txt1.kernel.loop import VirtualTimeLoop
from txt1.record.mcap_records import Block, Encoder, Told, TopicChannel
from txt1.runtime import Runtime
from txt1.sensors.mounts import TF_STATIC, SensorFrames
from txt1.sensors.ros_messages import beside
from txt1.tasks.controller import CONTROL_PERIOD

# with it comes numpy, for 0.3 s on a slow computer: before the first tick, and not at the first report within one
from txt1.telemetry import exact  # noqa: F401
from txt1.telemetry.topics import Rule, Topic

BATCH_PERIOD: Final = 0.5
"""s between two batches on the real clock; a crash may lose this much, and the disk's delay."""
BATCH_MAX: Final = 5.0
"""s of the robot's time in a batch at full speed."""
BACKLOG: Final = 20
"""Batches that may wait for the writer on the real clock; more are lost."""


class Sink(Protocol):
    """Where encoded batches go; called in the writer's thread."""

    def write(self, block: Block) -> int:
        """Take a block; how many messages were lost with it. Raises RecordingError when nothing more can be taken."""

    def close(self, dropped: int) -> None:
        """End the sink, given the count of lost messages. Raises RecordingError."""


class Origin:
    """The time stamp of the start of a run, s since 1970; for None the time of day, known when the run has begun.

    Robots with one recording share it.
    """

    def __init__(self, epoch: float | None) -> None:
        self._epoch = epoch

    def at(self, now: float) -> float:
        """Return it, at `now` s of the run."""
        if self._epoch is None:
            # in whole us, so that readers of the file have the very number
            self._epoch = round(seconds(wall_ns()) - now, 6)
        return self._epoch


class Recorder:
    """Listens to a robot that is not started yet.

    `origin` is added to the run's time in every time stamp; `batch` s are between batches, None: as the clock asks
    for. Recorders of several robots that share their sinks share `writer`, a single thread, and `channels`.
    """

    def __init__(
        self,
        runtime: Runtime,
        sinks: Sequence[Sink],
        origin: Origin,
        batch: float | None = None,
        *,
        writer: ThreadPoolExecutor | None = None,
        channels: list[TopicChannel] | None = None,
    ) -> None:
        # messages lost because the writer was behind, counted in the loop, and because the disk did not take them,
        # counted in the writer's thread
        self._overflowed = self._not_written = 0
        self._runtime = runtime
        self._sinks = sinks
        loop = asyncio.get_running_loop()
        self._virtual = isinstance(loop, VirtualTimeLoop)
        speed = loop.speed if isinstance(loop, VirtualTimeLoop) else 1.0
        self._full_speed = speed is None
        if batch is None:
            batch = BATCH_MAX if speed is None else min(BATCH_PERIOD * speed, BATCH_MAX)
        # half a cycle less, as times are rounded
        self._batch_time = batch - CONTROL_PERIOD / 2
        # of the robot's time, s: the end of this batch, and when messages are made to records again
        self._until = self._batch_time
        self._next = self._until if self._full_speed else 0.0
        # of this cycle; at full speed, of this batch
        self._messages: list[Told] = []
        self._told = False
        self._failure: RecordingError | None = None
        self._encoder = Encoder(0.0, runtime.bus.full_name, channels)
        self._origin, self._begun = origin, False
        # of readings and other events: the topic in its sensor's frame and those of standard messages, each as a row,
        # and whether it has such a frame
        self._framed: dict[Topic[Any], tuple[list[tuple[Topic[Any]]], bool]] = {}
        self._frames = SensorFrames()
        self._writer = writer or ThreadPoolExecutor(1, "txt1 recorder")
        self._jobs: deque[Future[None]] = deque()
        self._leave = runtime.bus.subscribe(self._take, cycle=self._take_cycle)

    @property
    def dropped(self) -> int:
        """Messages lost so far, because the writer or the disk did not take them."""
        return self._overflowed + self._not_written

    async def finish(self) -> None:
        """Write the rest; the sinks stay open. RecordingError: they have failed."""
        self._leave()
        if not self._begun:
            self._encoder.epoch = self._origin.at(self._runtime.now)
        self._encode()
        self._hand_over(backlog=len(self._jobs))
        await self.written()
        if self._failure is not None:
            raise self._failure

    async def written(self) -> None:
        """Wait until the sinks have all blocks."""
        waiting = [asyncio.wrap_future(job) for job in self._jobs if not job.done()]
        if waiting:
            await asyncio.wait(waiting)

    # -- in the loop -------------------------------------------------------------------------------------------

    def _take(self, topic: Topic[Any], value: Any, time: float) -> None:
        if topic.rule is Rule.EVENT:
            self._add_reading(time, topic, value)
        else:
            self._messages.append((time, (topic,), (value,)))

    def _take_cycle(self, topics: tuple[Topic[Any], ...], values: Sequence[Any], time: float) -> None:
        if not self._begun:
            self._begin(time)
        # only between two cycles, so that a failure is raised in the telemetry task and in no other
        if time >= self._next:
            self._encode()
            if time >= self._until:
                self._until = time + self._batch_time
                self._hand_over(backlog=len(self._jobs) if self._virtual else BACKLOG)
            self._next = self._until if self._full_speed else time + CONTROL_PERIOD / 2
            if self._failure is not None:
                raise self._failure
            if self.dropped and not self._told:
                self._told = True
                self._runtime.state.tell(time, "the recording loses messages: the disk is full or too slow")
        there = [each is not None for each in values]
        if not all(there):
            topics, values = tuple(compress(topics, there)), tuple(compress(values, there))
        self._messages.append((time, topics, values))

    def _begin(self, time: float) -> None:
        """Note when the run began, and tell the frames that every robot has."""
        self._begun = True
        self._encoder.epoch = self._origin.at(self._runtime.now)
        # the clock began anew with the run: a slow computer's reports before it would be from the future
        self._messages = [(min(told, time), topics, values) for told, topics, values in self._messages]
        self._messages.append((time, (TF_STATIC,), (self._frames.mounts,)))

    def _add_reading(self, time: float, topic: Topic[Any], value: Any) -> None:
        """Add a sensor's reading, and what other programs need of it: standard messages, and its place."""
        rows, placed = self._framed.get(topic) or self._frame(topic)
        for row in rows:
            self._messages.append((time, row, (value,)))
        if placed and self._frames.see(topic, value):
            # the reading is older, and the last message has to have all frames
            self._messages.append((self._runtime.now, (TF_STATIC,), (self._frames.mounts,)))

    def _frame(self, topic: Topic[Any]) -> tuple[list[tuple[Topic[Any]]], bool]:
        for polled in self._runtime.sensors.values():
            # in the order of the configuration, whichever reading comes first
            self._frames.link(polled.sensor.topic)
        rows = [(self._frames.framed(each, topic),) for each in (topic, *beside(topic))]
        self._framed[topic] = rows, self._frames.link(topic) != ""
        return self._framed[topic]

    def _encode(self) -> None:
        messages, self._messages = self._messages, []
        if self._failure is None:
            with self._failing():
                self._encoder.take(messages)

    def _hand_over(self, backlog: int) -> None:
        """Have the batch written, or lose it where more batches than `backlog` are waiting already."""
        while self._jobs and self._jobs[0].done():
            self._jobs.popleft()
        block = self._encoder.block()
        if len(self._jobs) > backlog:
            self._overflowed += block.count
        elif self._full_speed:
            self._write(block)
        else:
            self._jobs.append(self._writer.submit(self._write, block))

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """Keep the first failure, which the telemetry task raises."""
        try:
            yield
        except RecordingError as error:
            self._failure = error
        except Exception as error:
            self._failure = RecordingError(f"the recorder failed: {error!r}")
            self._failure.__cause__ = error

    # -- in the writer's thread, or at full speed in the loop ---------------------------------------------------

    def _write(self, block: Block) -> None:
        if self._failure is None:
            with self._failing():
                for sink in self._sinks:
                    self._not_written += sink.write(block)
