"""Two event loops in a browser's worker, which nobody may block: one in real time, one in virtual time.

How it works. A worker has an event loop of its own, JavaScript's, and Python may not wait inside it. So the loop in
real time never waits: `turn` does what is due, and returns how long there is nothing to do. Whoever calls it
(static/worker.js) calls it again then, or when something has come. The loop in virtual time never waits anyhow.
"""

import asyncio
from collections import deque
from math import inf
from typing import Final

from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import RealTimeLoop, VirtualTimeLoop

# s of work after which the browser gets its turn, for messages of the page
TURN: Final = 0.03


class _Alone(asyncio.SelectorEventLoop):
    """asyncio's own loop, which nobody wakes: a browser has neither sockets nor threads nor signals for it."""

    # callbacks to call now, and the heap of timers
    _ready: deque[asyncio.Handle]
    _scheduled: list[asyncio.TimerHandle]

    def _make_self_pipe(self) -> None:
        pass

    def _write_to_self(self) -> None:
        pass

    def _close_self_pipe(self) -> None:
        pass


class BrowserRealTimeLoop(_Alone, RealTimeLoop):
    """In real time; simulated time waits for a busy computer, as on a desk."""

    def turn(self) -> float:
        """Do what is due, for `TURN` s at most.

        Return the s until the next timer; 0: more is due already; inf: there is no timer.
        """
        ends = stopwatch_ns() + int(TURN * NS_PER_S)
        while stopwatch_ns() < ends:
            self.call_soon(self.stop)
            self.run_forever()
            if not self._ready and (pause := self._scheduled[0].when() - self.time() if self._scheduled else inf) > 0.0:
                return pause
        return 0.0


class BrowserVirtualLoop(_Alone, VirtualTimeLoop):
    """In virtual time, as fast as it can."""
