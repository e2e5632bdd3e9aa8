"""Two event loops in a browser's worker, which nobody may block: one in real time, one in virtual time.

How it works. A worker has an event loop of its own, JavaScript's, and Python may not wait inside it. So these loops
never wait: `turn` does what is due, and returns how long there is nothing to do. Whoever calls it (static/worker.js)
calls it again then, or when something has come. There are no threads: a job for one is done at once.
"""

import asyncio
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor
from math import inf
from typing import Any, Final, TypeVar, TypeVarTuple

from txt1.kernel.clock import NS_PER_S, SimulationClock, stopwatch_ns
from txt1.kernel.loop import RealTimeLoop, VirtualTimeLoop

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

# s of work after which the browser gets its turn, for messages of the page
TURN: Final = 0.03


class _NoFiles:
    """A selector without files or sockets."""

    def select(self, timeout: float | None = None) -> list[Any]:
        return []

    def close(self) -> None:
        pass


class _Jumping(_NoFiles):
    """Moves the clock of a loop in virtual time, instead of waiting."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[Any]:
        if timeout is None:
            # nothing else in this process could wake it up
            raise RuntimeError("all coroutines wait, and there is no timer")
        if timeout > 0.0:
            clock = self._loop.clock
            clock.advance_to(max(clock.now_ns() + 1, self._loop.next_timer_ns()))
        return []


class BrowserLoop(asyncio.BaseEventLoop):
    """What both loops have in common."""

    # asyncio's own: callbacks to call now, and the heap of timers
    _ready: Any
    _scheduled: list[asyncio.TimerHandle]

    def _process_events(self, event_list: list[Any]) -> None:
        pass

    def _write_to_self(self) -> None:
        pass

    def _make_self_pipe(self) -> None:
        pass

    def close(self) -> None:
        """Close it."""
        asyncio.BaseEventLoop.close(self)

    def run_in_executor(self, executor: Executor | None, func: Callable[[*Ts], T], *args: *Ts) -> asyncio.Future[T]:
        """Do a job for a thread at once, as there are no threads."""
        done: asyncio.Future[T] = self.create_future()
        try:
            done.set_result(func(*args))
        except Exception as error:
            done.set_exception(error)
        return done

    def turn(self) -> float:
        """Do what is due, for `TURN` s at most.

        Return the s until the next timer; 0: more is due already; inf: there is no timer.
        """
        ends = stopwatch_ns() + int(TURN * NS_PER_S)
        # of asyncio: what `run_forever` does around its turns
        own: Any = self
        before, hooks = asyncio._get_running_loop(), sys.get_asyncgen_hooks()
        own._thread_id = threading.get_ident()
        sys.set_asyncgen_hooks(own._asyncgen_firstiter_hook, own._asyncgen_finalizer_hook)
        asyncio._set_running_loop(self)
        try:
            while True:
                own._run_once()
                if not self._ready and (pause := self.pause()) > 0.0:
                    return pause
                if stopwatch_ns() >= ends:
                    return 0.0
        finally:
            own._thread_id = None
            sys.set_asyncgen_hooks(*hooks)
            asyncio._set_running_loop(before)

    def pause(self) -> float:
        """Return the s until the next timer; inf: there is none."""
        return self._scheduled[0].when() - self.time() if self._scheduled else inf


class BrowserRealTimeLoop(BrowserLoop, RealTimeLoop):
    """In real time; simulated time waits for a busy computer, as on a desk."""

    def __init__(self) -> None:
        asyncio.BaseEventLoop.__init__(self)
        self._selector = _NoFiles()
        self.clock = SimulationClock()


class BrowserVirtualLoop(BrowserLoop, VirtualTimeLoop):
    """In virtual time, as fast as it can."""

    def __init__(self, speed: float | None = None) -> None:
        # nothing waits here, so there is one speed
        VirtualTimeLoop.__init__(self)
        self._selector = _Jumping(self)

    def pause(self) -> float:
        """Return 0: it never waits for a timer; inf: there is none."""
        return 0.0 if self._scheduled else inf

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """Do nothing: there are no threads."""
