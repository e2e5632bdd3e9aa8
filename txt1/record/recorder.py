"""The recorder: whatever a robot's bus carries, in batches, to where it is kept or shown.

In the loop it only keeps references, unless a bridge wants the messages at once (`Recorder.tap`). Every batch goes to
another thread, which makes bytes of it and writes them. On the real clock a writer that falls behind loses batches,
which are counted; in virtual time the simulation waits. At full speed the loop makes the bytes itself, as taking turns
with a thread for the interpreter costs a tenth of the run; the thread compresses and writes them meanwhile, which needs
no interpreter.
"""

import asyncio
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Final, NamedTuple, Protocol

from txt1.errors import RecordingError
from txt1.kernel.loop import VirtualTimeLoop
from txt1.record.encoder import Block, Encoder, Event, Sample, TopicChannel
from txt1.runtime import Runtime
from txt1.tasks.controller import CONTROL_PERIOD
from txt1.telemetry.topics import Take, Topic, Unsubscribe

BATCH: Final = 0.5  # s between two batches on the real clock: what a crash may lose, with what the disk needs

BATCH_MAX: Final = 5.0  # s of the robot's time in a batch at full speed

BACKLOG: Final = 20  # batches that may wait for the writer: more are lost on the real clock, waited for at full speed


class Sink(Protocol):
    """Where encoded batches go; called in the writer's thread."""

    def write(self, block: Block) -> int:
        """Take a block; how many messages were lost with it. Raises RecordingError when nothing more can be taken."""

    def close(self, dropped: int) -> None:
        """No block comes any more, and so many messages were lost. Raises RecordingError."""


class _Batch(NamedTuple):
    samples: list[Sample]
    events: list[Event]
    lost: Counter[Topic[Any]]  # messages lost before it


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
        self._overflowed = 0  # messages lost because the writer was behind; counted in the loop
        self._not_written = 0  # ... and because the disk did not take them; counted in the writer's thread
        self._runtime = runtime
        self._sinks = sinks
        self._loop = asyncio.get_running_loop()
        self._virtual = isinstance(self._loop, VirtualTimeLoop)
        speed = self._loop.speed if isinstance(self._loop, VirtualTimeLoop) else 1.0
        self._full_speed = speed is None
        if batch is None:
            batch = BATCH_MAX if speed is None else min(BATCH * speed, BATCH_MAX)
        self._batch_samples = max(1, round(batch / CONTROL_PERIOD))
        self._samples: list[Sample] = []
        self._events: list[Event] = []
        self._ready: list[Event] = []  # messages that are made already, before those
        self._cycles = 0  # in the batch
        self._lost: Counter[Topic[Any]] = Counter()
        self._taps: list[Take] = []
        self._told = False
        self._failure: RecordingError | None = None
        self._encoder = Encoder(epoch, runtime.bus.full_name, channels)
        self._making = Encoder(epoch)  # in the loop
        self._shared = writer is not None
        self._writer = writer or ThreadPoolExecutor(1, "txt1 recorder")
        self._jobs: set[asyncio.Future[None]] = set()
        self._writing: deque[Future[None]] = deque()  # at full speed: blocks that are not known to be written
        self._leave = runtime.bus.subscribe(self._take, cycle=self._take_cycle)
        if runtime.bus.maker is None:
            runtime.bus.maker = self

    @property
    def dropped(self) -> int:
        """Messages lost so far, because the writer or the disk did not take them."""
        return self._overflowed + self._not_written

    async def close(self) -> None:
        """Write what is left and close the sinks; RecordingError: they have failed, on the way or now."""
        await self._finish()
        await self._loop.run_in_executor(self._writer, self._close_sinks)
        if not self._shared:
            self._writer.shutdown(wait=False)
        if self._failure is not None:
            raise self._failure

    async def finish(self) -> None:
        """Write what is left; the sinks stay open for others. RecordingError: they have failed."""
        await self._finish()
        if self._failure is not None:
            raise self._failure

    async def _finish(self) -> None:
        self._leave()
        self.make()
        if self._runtime.bus.maker is self:
            self._runtime.bus.maker = None
        await self._loop.run_in_executor(self._writer, self._write, self._take_batch())  # behind all before it

    async def written(self) -> None:
        """Wait until the sinks have what was handed over."""
        if self._jobs:
            await asyncio.wait(self._jobs)

    # -- for bridges: in the loop ------------------------------------------------------------------------------

    def tap(self, take: Take) -> Unsubscribe:
        """Have `take` told every message from now on, as it is made, until the function returned is called.

        As long as somebody is told, messages are made in the loop and not in the writer's thread.
        """
        self._make()
        self._taps.append(take)
        return lambda: self._taps.remove(take)

    def make(self) -> None:
        """Make messages of all telemetry up to now, if anybody wants them."""
        if self._taps:
            self._make()

    def _make(self) -> None:
        samples, events, self._samples, self._events = self._samples, self._events, [], []
        try:
            for time, topic, value in _in_order(samples, events):
                message = self._making.ready(topic, value, time)
                self._ready.append((0, time, topic, message))
                for take in self._taps:
                    take(topic, message, time)
        except Exception as error:
            self._fail(error)

    # -- in the loop -------------------------------------------------------------------------------------------

    def _take(self, topic: Topic[Any], value: Any, time: float) -> None:
        self._events.append((len(self._samples), time, topic, value))

    def _take_cycle(self, topics: tuple[Topic[Any], ...], values: list[Any], now: float) -> None:
        if self._cycles >= self._batch_samples:
            self._hand_over()
            if self._failure is not None:
                raise self._failure
            if self.dropped and not self._told:
                self._told = True
                self._runtime.state.tell(now, "the recording loses messages: the disk is full or too slow")
        self._cycles += 1
        self._samples.append((now, topics, values))

    def _take_batch(self) -> _Batch:
        self.make()
        batch = _Batch(self._samples, self._ready + self._events, self._lost)
        self._samples, self._events, self._ready, self._cycles, self._lost = [], [], [], 0, Counter()
        return batch

    def _hand_over(self) -> None:
        """Give the batch to the writer, or drop it where it is too far behind."""
        if self._full_speed:
            self._encode_here()
        elif self._virtual or len(self._jobs) <= BACKLOG:
            job = self._loop.run_in_executor(self._writer, self._write, self._take_batch())
            self._jobs.add(job)
            job.add_done_callback(self._jobs.discard)
        else:
            batch = self._take_batch()
            lost = Counter(topic for _, topic, _ in _in_order(batch.samples, batch.events))
            self._overflowed += lost.total()
            self._lost = batch.lost + lost

    def _encode_here(self) -> None:
        """Make the batch's bytes in the loop, and have the thread write them."""
        while len(self._writing) > BACKLOG or (self._writing and self._writing[0].done()):
            self._writing.popleft().result()
        if self._failure is None:
            block = self._encode(self._take_batch())
            if block is not None:
                self._writing.append(self._writer.submit(self._write_block, block))

    # -- in the writer's thread --------------------------------------------------------------------------------

    def _write(self, batch: _Batch) -> None:
        block = self._encode(batch) if self._failure is None else None
        if block is not None:
            self._write_block(block)

    def _encode(self, batch: _Batch) -> Block | None:
        """The batch's bytes; None when they cannot be made, and `_failure` says why."""
        try:
            self._encoder.skip(batch.lost)
            return self._encoder.block(batch.samples, batch.events)
        except Exception as error:
            self._fail(error)
            return None

    def _write_block(self, block: Block) -> None:
        try:
            for sink in self._sinks:
                self._not_written += sink.write(block)
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        if isinstance(error, RecordingError):
            self._failure = error
        else:
            self._failure = RecordingError(f"the recorder failed: {error!r}")
            self._failure.__cause__ = error

    def _close_sinks(self) -> None:
        for sink in self._sinks:
            try:
                sink.close(self.dropped)
            except RecordingError as error:
                self._failure = self._failure or error


def _in_order(samples: Sequence[Sample], events: Sequence[Event]) -> Iterator[tuple[float, Topic[Any], Any]]:
    """Time, topic and value of everything, as it came."""
    done = 0

    def until(end: int) -> Iterator[tuple[float, Topic[Any], Any]]:
        for now, topics, values in samples[done:end]:
            yield from ((now, topic, value) for topic, value in zip(topics, values, strict=True) if value is not None)

    for position, time, topic, value in events:
        yield from until(position)
        done = position
        yield time, topic, value
    yield from until(len(samples))
