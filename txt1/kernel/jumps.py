"""How virtual time moves on within one turn of the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Sized
from typing import Final

from txt1.kernel.clock import NS_PER_S, VirtualClock

POLL_EVERY: Final = 64
"""At full speed the operating system is asked for signals and input once in so many jumps."""


class Jumps:
    """Moves a virtual clock for a callback that knows it is the next to be called, which saves a turn of the loop.

    Args:
        clock: the loop's.
        ready: what the loop is to call now.
        paced: whether virtual time is bound to real time, so that only the loop moves it.

    """

    def __init__(self, clock: VirtualClock, ready: Sized, paced: bool) -> None:
        self.threads_outstanding = 0
        """Jobs in other threads that still compute what happens now."""
        self.made = 0
        self._clock = clock
        self._ready = ready
        self._paced = paced

    def must_poll(self) -> bool:
        """Whether the loop asks the operating system for input this time: once in POLL_EVERY, always when paced."""
        self.made += 1
        return self._paced or self.made % POLL_EVERY == 0

    def to(self, target_ns: int, timers: list[asyncio.TimerHandle]) -> bool:
        """True after moving the clock to `target_ns`, if the loop itself would do just that next.

        False, and nothing done, when anything else is ready or due first, or when it is time to poll.

        Args:
            target_ns: where to, ns.
            timers: the loop's heap of timers.

        """
        if self._paced or self.threads_outstanding or len(self._ready):
            return False
        if timers and timers[0].when() * NS_PER_S <= target_ns:
            return False
        if (self.made + 1) % POLL_EVERY == 0:  # the loop's own jump comes next, and it polls
            return False
        self.made += 1
        self._clock.advance_to(target_ns)
        return True
