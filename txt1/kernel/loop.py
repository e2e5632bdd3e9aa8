"""Two asyncio event loops: one punctual in real time, one in virtual time that jumps to the next timer.

`run` starts a coroutine on either of them. Any coroutine runs on both, the user's own included: ``asyncio.sleep`` and
time-outs follow the loop's clock.
"""

from __future__ import annotations

import asyncio
import ctypes
import select
import selectors
import sys
from collections import deque
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor, ThreadPoolExecutor
from contextvars import Context
from functools import partial
from math import inf
from typing import Any, Final, Literal, TypeVar, cast

from txt1.kernel.clock import NS_PER_S, Clock, RealClock, SimulationClock, VirtualClock, nanoseconds
from txt1.kernel.jumps import Jumps

T = TypeVar("T")
Speed = float | Literal["max"] | None
"""None: the real clock. A number: virtual time at that multiple of real time. "max": as fast as the processor."""

# s that a thread of Python computes before another thread may run. Python's default is 5 ms, and a tick may wait more
# than once: the loop loses its turn whenever it waits
INTERPRETER_TURN: Final = 5e-4
# Linux's prctl option: how far a thread may oversleep its time-outs, 50 us by default
_PR_SET_TIMERSLACK: Final = 29


class PunctualSelector(selectors.DefaultSelector):
    """A selector whose time-outs are met to the microsecond.

    epoll rounds a time-out up to whole milliseconds, which makes a 50 Hz task 0.7 ms late. Here ``select`` waits on
    the epoll descriptor itself.
    """

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return the ready file objects, at the latest after `timeout` seconds (None: as soon as there are any)."""
        if timeout is not None and timeout > 0.0:
            if not select.select([self.fileno()], [], [], timeout)[0]:
                # the time-out: a timer is due, and what comes now has its turn after it
                return []
            timeout = 0.0
        return super().select(timeout)


class RealTimeLoop(asyncio.SelectorEventLoop):
    """asyncio's event loop on the real clock, with punctual timers; while it is open, threads take short turns."""

    def __init__(self) -> None:
        # select() on an epoll descriptor is Linux's (and, for kqueue, BSD's) way; elsewhere plain asyncio is kept
        super().__init__(PunctualSelector() if hasattr(selectors.DefaultSelector, "fileno") else None)
        self.clock: Clock = SimulationClock()
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
        # virtual time has no use for it
        from txt1.kernel import timeslice

        timeslice.short()
        self._switch_interval = sys.getswitchinterval()
        sys.setswitchinterval(INTERPRETER_TURN)

    def close(self) -> None:
        """Close it, and give the threads the turns that they had."""
        if not self.is_closed():
            sys.setswitchinterval(self._switch_interval)
        super().close()


class _JumpingSelector(selectors.DefaultSelector):
    """Moves the clock of a virtual-time loop, instead of waiting."""

    loop: VirtualTimeLoop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        loop, jumps = self.loop, self.loop.jumps
        if timeout is not None and timeout <= 0.0:
            events = super().select(0) if jumps.must_poll() else []
            if events and loop.speed is not None and not jumps.threads_outstanding:
                # input comes at its real time, however busy the loop was
                loop.catch_up(loop.next_timer_ns())
            return events
        if timeout is None or jumps.threads_outstanding:
            # No timer to jump to, or a thread still computes for the present instant: wait for input in real time.
            events = super().select(None)
            if loop.speed is not None and not jumps.threads_outstanding:
                loop.catch_up(None)
            return events
        target = max(loop.clock.now_ns() + 1, loop.next_timer_ns())
        if loop.speed is not None:
            pause = loop.real_start_ns + int(target / loop.speed) - RealClock().now_ns()
            if pause > 0:
                events = super().select(pause / NS_PER_S)
                if events:
                    loop.catch_up(target)
                    return events
        loop.clock.advance_to(target)
        return super().select(0) if jumps.must_poll() else []


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """asyncio's event loop in virtual time: when nothing is ready it jumps to the next timer.

    A run is as fast as the processor (or `speed` times real time) and repeats exactly. Time stands still while a job in
    another thread (``run_in_executor``, ``asyncio.to_thread``) is outstanding. Peers outside the process do not follow
    virtual time, so it needs links in memory.
    """

    # asyncio's own, s
    _clock_resolution: float
    # asyncio's queue of callbacks to call now
    _ready: deque[asyncio.Handle]
    # asyncio's heap of timers
    _scheduled: list[asyncio.TimerHandle]

    def __init__(self, speed: float | None = None) -> None:
        self.clock = VirtualClock()
        self.speed = speed
        # real time at which virtual time began
        self.real_start_ns = RealClock().now_ns()
        self._threads = ThreadPoolExecutor(thread_name_prefix="txt1")
        selector = _JumpingSelector()
        selector.loop = self
        super().__init__(selector)
        self.jumps = Jumps(self, self.clock, speed is not None, self._ready, lambda: self._scheduled)
        # asyncio calls timers early by so much. Within a ns that would depend on who moves the clock, the loop or a
        # scheduler (`Jumps.to`), and so on how long threads take: a run would not repeat to the last ns.
        self._clock_resolution = 1e-10

    @property
    def timers(self) -> list[asyncio.TimerHandle]:
        """The timers that are not called yet, as a heap."""
        return self._scheduled

    def time(self) -> float:
        """The virtual time in seconds since the loop was made."""
        return self.clock.now_ns() / NS_PER_S

    def call_later(  # type: ignore[override]
        self, delay: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Like asyncio's own, but at least 1 ns from now.

        A coroutine may sleep for the rest of the time until some instant. This rest may be smaller than the clock's
        resolution; without the minimum the coroutine would never get there.
        """
        return super().call_later(max(delay, 1.0 / NS_PER_S), callback, *args, context=context)

    def next_timer_ns(self) -> int:
        """Return the instant of the next timer, to the nearest ns; the clock's own time if there is none."""
        return nanoseconds(self._scheduled[0].when()) if self._scheduled else self.clock.ns

    def catch_up(self, limit_ns: int | None) -> None:
        """Move virtual time to follow real time at the loop's speed, but not beyond `limit_ns`, if given."""
        assert self.speed is not None
        reached = int((RealClock().now_ns() - self.real_start_ns) * self.speed)
        if limit_ns is not None:
            reached = min(limit_ns, reached)
        self.clock.advance_to(max(self.clock.now_ns(), reached))

    def run_in_executor(  # type: ignore[override]
        self, executor: Executor | None, func: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        """Like asyncio's own; virtual time waits for the job, even if its result is no longer awaited."""
        if executor is None:
            executor = self._threads
        job = executor.submit(func, *args)
        self.jumps.threads_outstanding += 1
        future = asyncio.wrap_future(job, loop=self)
        # Added after wrap_future's own callback, so the result is delivered before time moves on.
        job.add_done_callback(self._report_thread)
        return future

    def _report_thread(self, _: object) -> None:
        # a job in the caller's own executor may outlive the loop
        if not self.is_closed():
            self.call_soon_threadsafe(self._thread_done)

    def _thread_done(self) -> None:
        self.jumps.threads_outstanding -= 1

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """Wait for the threads and end them."""
        self._threads.shutdown(wait=True)
        await super().shutdown_default_executor()


def run(main: Coroutine[Any, Any, T], *, speed: Speed = None) -> T:
    """Run a coroutine to its end, like ``asyncio.run``, and return its result.

    `speed` None runs in real time. A number runs in virtual time, at this multiple of real time; "max" is as fast as
    the processor. Virtual time is for simulations only.

    Raises ValueError: the speed is neither None, "max" nor a positive number.
    """
    if not (speed is None or speed == "max" or (isinstance(speed, int | float) and 0.0 < speed < inf)):
        # or Python warns that it was never awaited
        main.close()
        raise ValueError(f"speed must be 'max', a positive number, or None for real time, not {speed!r}")
    virtual = partial(VirtualTimeLoop, None if speed == "max" else speed)
    with asyncio.Runner(loop_factory=RealTimeLoop if speed is None else virtual) as runner:
        return runner.run(main)


def clock_of(loop: asyncio.AbstractEventLoop) -> Clock:
    """The clock an event loop runs on; one that is not ours (plain ``asyncio.run``) keeps the one made for it here."""
    return (
        loop.clock
        if isinstance(loop, RealTimeLoop | VirtualTimeLoop)
        else cast("Clock", vars(loop).setdefault("txt1_clock", SimulationClock()))
    )
