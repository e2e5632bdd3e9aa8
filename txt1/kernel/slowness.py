"""Tells by how much simulated time is slower than real time, because the computer is busy."""

from collections.abc import Callable
from typing import Final

from txt1.kernel.clock import NS_PER_S, stopwatch_ns

# s of real time over which it is measured
MEASURED_OVER: Final = 2.0
# share of real time from which on nothing is said
REAL_TIME_ENOUGH: Final = 0.95


class Slowness:
    """A warning, "" while there is none; `held` returns the seconds for which simulated time has waited so far."""

    def __init__(self, held: Callable[[], float], clock: Callable[[], int] = stopwatch_ns) -> None:
        self._held, self._clock = held, clock
        self._since, self._before = clock(), held()
        self._text = ""

    def __call__(self) -> str:
        """Return the warning, with the remedy first."""
        elapsed = (self._clock() - self._since) / NS_PER_S
        if elapsed >= MEASURED_OVER:
            share = max(0.0, 1.0 - (self._held() - self._before) / elapsed)
            self._since, self._before = self._clock(), self._held()
            slow = f"end other programs: busy, time runs at {100.0 * share:.0f} % of real time"
            self._text = slow if share < REAL_TIME_ENOUGH else ""
        return self._text
