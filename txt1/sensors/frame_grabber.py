"""A sensor whose frames come from a blocking source. A thread reads the source and keeps the newest frame.

A source that fails is opened again, by the ladder of `txt1.link.silence`. A frame that cannot be read is skipped.
"""

import asyncio
import threading
from collections.abc import Callable, Iterator
from math import inf
from typing import Final, Generic, NamedTuple, TypeVar

from txt1.errors import HalError, Txt1Error
from txt1.link.silence import Ladder
from txt1.sensors.base import Reading
from txt1.telemetry.topics import Topic

T = TypeVar("T")

# waits for this number of s, or until the sensor is closed; returns whether it is
Wait = Callable[[float], object]

# s that the thread has to end
THREAD_END_PATIENCE: Final = 3.0


class Exposed(NamedTuple, Generic[T]):
    """A frame whose time is known."""

    value: T
    age: float
    """Time since its exposure, s."""


class Frames(Generic[T]):
    """A sensor whose frames come from a blocking iterator.

    Args:
        topic: topic of the frames.
        period: time between two calls of `read`, s.
        begin: opens the source and returns its frames, in the thread that reads them. Its argument is a function to
            wait with. None is a frame that cannot be read. A frame with an age is `Exposed`. It raises HalError with
            the remedy, and is then called again; a source at its end is not. A generator's ``finally`` closes the
            source.
        latency: time from exposure to arrival of frames whose age is not known, s.

    """

    simulated = False

    def __init__(
        self,
        topic: Topic[T],
        period: float,
        begin: Callable[[Wait], Iterator[Exposed[T] | T | None]],
        latency: float = 0.0,
    ) -> None:
        self.topic, self.period = topic, period
        self._begin, self._latency = begin, latency
        self._loop: asyncio.AbstractEventLoop | None = None
        self._newest: tuple[float, T] | None = None
        self._failure = ""
        self.faults = 0
        """Number of frames that could not be read since the sensor was opened."""
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self._origin = inf
        self._last = -inf

    async def open(self) -> None:
        """Open the source in its thread, and wait for the first frame."""
        self._loop = asyncio.get_running_loop()
        self._origin, self._last, self._failure, self._newest, self.faults = inf, -inf, "", None, 0
        self._over = threading.Event()
        ready: asyncio.Future[None] = self._loop.create_future()
        self._thread = threading.Thread(target=self._run, args=(ready, self._over), daemon=True, name="frames")
        self._thread.start()
        await ready

    async def close(self) -> None:
        """Let the thread close the source."""
        self._over.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            await asyncio.to_thread(thread.join, THREAD_END_PATIENCE)

    def read(self, now: float) -> Reading[T] | None:
        """Return the newest frame; raises HalError if the source has failed or is at its end."""
        self._origin = min(self._origin, asyncio.get_running_loop().time() - now)
        newest, self._newest = self._newest, None
        if newest is None:
            if self._failure:
                raise HalError(self._failure)
            return None
        time = max(self._last, min(newest[0] - self._origin, now))
        if time < 0.0 or time == self._last:
            return None
        self._last = time
        return Reading(time, newest[1])

    def _run(self, ready: asyncio.Future[None], over: threading.Event) -> None:
        """In the thread: pass every frame to the loop, which notes its arrival."""
        loop = self._loop
        assert loop is not None

        def tell(function: Callable[..., object], *arguments: object) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(function, *arguments)

        ladder = Ladder(0.0, greets=False)
        while not over.is_set():
            frames: Iterator[Exposed[T] | T | None] | None = None
            try:
                frames = self._begin(over.wait)
                for frame in frames:
                    if over.is_set():
                        return
                    if frame is None:
                        tell(self._skip)
                        continue
                    ladder.heard(loop.time())
                    if isinstance(frame, Exposed):
                        tell(self._take, frame.value, loop.time() - frame.age, ready)
                    else:
                        tell(self._take, frame, None, ready)
                tell(self._fail, HalError("there are no more pictures"), ready)
                return
            except Exception as error:
                told = error if isinstance(error, Txt1Error) else HalError(f"{type(error).__name__}: {error}")
                tell(self._fail, told, ready)
            finally:
                close = getattr(frames, "close", None)
                if close is not None:
                    close()
            ladder.lost(loop.time())
            over.wait(ladder.due - loop.time())

    def _take(self, frame: T, time: float | None, ready: asyncio.Future[None]) -> None:
        """Keep a frame, with the loop's time of its exposure; None: it is `latency` older than its arrival."""
        if time is None:
            time = asyncio.get_running_loop().time() - self._latency
        self._newest, self._failure = (time, frame), ""
        if not ready.done():
            ready.set_result(None)

    def _skip(self) -> None:
        self.faults += 1

    def _fail(self, error: Txt1Error, ready: asyncio.Future[None]) -> None:
        self._failure = str(error)
        if not ready.done():
            # nothing is opened again that did not open at first
            self._over.set()
            ready.set_exception(error)
