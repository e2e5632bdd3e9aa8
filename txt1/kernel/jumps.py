"""Moves virtual time on within one turn of the event loop, and from one scheduler to the next.

How it works
------------

In virtual time the clock stands still while anything runs. When nothing is left to run, the event loop would wait for
its next timer. Instead it moves the clock there (`txt1.kernel.loop`). That is a jump. It takes a turn of the event
loop: look at the selector, take the timers that are due, call each of them.

For a robot that is simulated at full speed the next timer is nearly always a scheduler's. Then the turn does nothing
but come back to the place that it came from. So the scheduler makes the jump itself: it asks `Jumps.to` to move the
clock, and runs on. This must not change what happens, or in which order. Hence `to` says no, and does nothing, whenever
the event loop would do something else first:

- something is ready to be called now;
- a timer of the event loop is due at that instant or before it;
- another scheduler is due at that instant or before it;
- a thread is still computing what belongs to the present instant;
- it is time to ask the operating system for signals and input, once in POLL_EVERY jumps;
- the run is paced: it is to take real time, so the event loop has to wait.

After a no, the scheduler returns to the event loop with a timer, and all goes the ordinary way. Both ways bring about
the same run to the last bit.

*Several schedulers* share one loop: a team of robots, or a robot and its virtual board. A timer for each would take the
event loop's turn for each. So they have one timer together. Their next instants wait in a heap, `_due`, by time and
then by number. `_dispatch` calls the first, and as long as the loop would do nothing else it moves the clock to the
next one and calls that. A scheduler that is called puts itself into the heap again with `call_at`.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from typing import Final

from txt1.kernel.clock import NS_PER_S, VirtualClock

# at full speed the operating system is asked for signals and input once in this many jumps
POLL_EVERY: Final = 64

Dispatch = Callable[[], None]


class Jumps:
    """Moves a loop's virtual clock for callbacks that are certain to be called next, which saves turns of the loop.

    Several schedulers on one loop take turns here, in the order of their due times; at the same instant in the order of
    their making. A turn of the loop for each would cost ten robots a quarter of their speed.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        clock: VirtualClock,
        paced: bool,
        ready: deque[asyncio.Handle],
        timers: Callable[[], list[asyncio.TimerHandle]],
    ) -> None:
        self.threads_outstanding = 0
        """Jobs in other threads that still compute for the present instant."""
        self.made = 0
        self._loop = loop
        self.clock = clock
        self._ready = ready
        self._paced = paced
        self._timers = timers
        self._schedulers = 0
        # heap: time in ns, number of the scheduler, its dispatch
        self._due: list[tuple[int, int, Dispatch]] = []
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = 0
        self._dispatching = False

    def must_poll(self) -> bool:
        """Return whether the loop asks the system for input this time: once in POLL_EVERY, always when paced."""
        self.made += 1
        return self._paced or self.made % POLL_EVERY == 0

    @property
    def timers(self) -> list[asyncio.TimerHandle]:
        """The loop's heap of timers; the loop may replace it, but not within a turn."""
        return self._timers()

    def reach(self, target_ns: int) -> bool:
        """Return whether it is `target_ns`, now or after moving there (see `to`)."""
        return self.clock.ns == target_ns or self.to(target_ns, self._timers())

    def to(self, target_ns: int, timers: list[asyncio.TimerHandle]) -> bool:
        """Move the clock to `target_ns` if nothing else is due before; return whether it moved.

        It does not move either when a callback is ready, or when the loop has to poll its sockets.
        """
        if (
            self._paced
            or self.threads_outstanding
            or self._ready
            or (self._due and self._due[0][0] <= target_ns)
            or (timers and timers[0].when() * NS_PER_S <= target_ns)
            # the loop's own jump comes next, and it polls
            or (self.made + 1) % POLL_EVERY == 0
        ):
            return False
        self.made += 1
        self.clock.advance_to(target_ns)
        return True

    # -- schedulers --------------------------------------------------------------------------------------------

    def enter(self) -> int:
        """Return a number for a new scheduler."""
        self._schedulers += 1
        return self._schedulers

    def call_at(self, due_ns: int, number: int, dispatch: Dispatch) -> None:
        """Let a scheduler's dispatch be called at an instant, ns."""
        heappush(self._due, (due_ns, number, dispatch))
        if not self._dispatching:
            self._set_timer()

    def forget(self, number: int) -> None:
        """Cancel the call of a scheduler."""
        self._due = [each for each in self._due if each[1] != number]
        heapify(self._due)
        if not self._dispatching:
            self._set_timer()

    def _set_timer(self) -> None:
        """Make sure that the first dispatch is called in time."""
        due_ns = self._due[0][0] if self._due else -1
        if self._timer is not None:
            if self._timer_ns == due_ns:
                return
            self._timer.cancel()
            self._timer = None
        if self._due:
            self._timer, self._timer_ns = self._loop.call_at(due_ns / NS_PER_S, self._dispatch), due_ns

    def _dispatch(self) -> None:
        """Call the schedulers in turn, as long as the loop has nothing else to do."""
        self._timer = None
        self._dispatching = True
        try:
            while self._due and (self._due[0][0] <= self.clock.ns or self._to_first()):
                heappop(self._due)[2]()
        finally:
            self._dispatching = False
            self._set_timer()

    def _to_first(self) -> bool:
        """Move on to the first of the dispatches; return whether that was possible."""
        first = heappop(self._due)
        moved = self.to(first[0], self._timers())
        heappush(self._due, first)
        return moved
