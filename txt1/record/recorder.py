"""The recorder writes every message of a robot's bus, in batches, to a file or to a live view.

In the loop it only keeps references. Every batch goes to a thread, which encodes and writes it. In real time a writer
that falls behind loses batches; they are counted. At full speed the loop itself encodes and writes, as no deadline
has to be met and a second thread would only contend for the GIL.
"""

import asyncio
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final, Protocol

from txt1.errors import RecordingError
from txt1.kernel.loop import VirtualTimeLoop
from txt1.record.encoder import Block, Encoder, Message, TopicChannel
from txt1.runtime import Runtime
from txt1.tasks.controller import CONTROL_PERIOD
from txt1.telemetry.topics import Rule, Topic

BATCH: Final = 0.5
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


class Recorder:
    """Listens to a robot that is not started yet.

    `epoch` is added to the run's time in every time stamp, s; `batch` s are between batches, None: as the clock asks
    for. Recorders of several robots that share their sinks share `writer`, a single thread, and `channels`.
    """

    def __init__(
        self,
        runtime: Runtime,
        sinks: Sequence[Sink],
        epoch: float,
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
            batch = BATCH_MAX if speed is None else min(BATCH * speed, BATCH_MAX)
        # half a cycle less, as times are rounded
        self._batch_time = batch - CONTROL_PERIOD / 2
        self._until = self._batch_time
        self._messages: list[Message] = []
        self._lost: Counter[Topic[Any]] = Counter()
        self._told = False
        self._failure: RecordingError | None = None
        self._encoder = Encoder(epoch, runtime.bus.full_name, channels)
        self._writer = writer or ThreadPoolExecutor(1, "txt1 recorder")
        self._jobs: deque[Future[None]] = deque()
        self._leave = runtime.bus.subscribe(self._take)

    @property
    def dropped(self) -> int:
        """Messages lost so far, because the writer or the disk did not take them."""
        return self._overflowed + self._not_written

    async def finish(self) -> None:
        """Write the rest; the sinks stay open. RecordingError: they have failed."""
        self._leave()
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
        # only between two cycles, so that a failure is raised in the telemetry task and in no other
        if time >= self._until and topic.rule is Rule.CYCLE:
            self._until = time + self._batch_time
            self._hand_over(backlog=len(self._jobs) if self._virtual else BACKLOG)
            if self._failure is not None:
                raise self._failure
            if self.dropped and not self._told:
                self._told = True
                self._runtime.state.tell(time, "the recording loses messages: the disk is full or too slow")
        self._messages.append((time, topic, value))

    def _hand_over(self, backlog: int) -> None:
        """Have the batch written, or lose it where more batches than `backlog` are waiting already."""
        while self._jobs and self._jobs[0].done():
            self._jobs.popleft()
        if len(self._jobs) > backlog:
            lost = Counter(topic for _, topic, _ in self._messages)
            self._overflowed += lost.total()
            self._lost += lost
        elif self._full_speed:
            self._write(self._messages, self._lost)
            self._lost = Counter()
        else:
            self._jobs.append(self._writer.submit(self._write, self._messages, self._lost))
            self._lost = Counter()
        self._messages = []

    # -- in the writer's thread, or at full speed in the loop ---------------------------------------------------

    def _write(self, messages: Sequence[Message], lost_before: Counter[Topic[Any]]) -> None:
        if self._failure is not None:
            return
        try:
            self._encoder.skip(lost_before)
            block = self._encoder.block(messages)
            for sink in self._sinks:
                self._not_written += sink.write(block)
        except RecordingError as error:
            self._failure = error
        except Exception as error:
            self._failure = RecordingError(f"the recorder failed: {error!r}")
            self._failure.__cause__ = error
