"""The age of a stamped command, from its stamp alone: the clocks of the two ends need not agree.

How it works
------------

The delay of a command is its arrival minus its stamp. It has the difference between the clocks in it, which nobody
knows. So a command's age is its delay minus the smallest delay seen: it is at least as old as that. The smallest delay
may grow slowly, as clocks drift.

A network that stalls delivers old commands late, and in order. Their delays are longer by no more than the stall, and
their stamps still rise. So nothing but a clock that was set, or another publisher, makes a stamp fall, or a command
arrive earlier than the smallest delay allows. Commands are then refused until a few in a row agree on a new delay.

The arrival's clock has to be one that nobody sets.
"""

from collections import Counter
from math import inf
from typing import Final

# largest share by which one clock may be faster than the other
SENDER_CLOCK_DRIFT: Final = 2e-4
# s by which delays of commands in a row may differ after a clock was set, and by which a command may be early
DELAY_SPREAD: Final = 0.1
# number of commands in a row, and s between the first and the last of them, that have to agree on a new delay
AGREEING: Final = 3
AGREE_FOR: Final = 0.3


class Stamps:
    """The stamps of a publisher's commands; `stale` is the age in s at which a command is refused."""

    def __init__(self, stale: float) -> None:
        self.refused: Counter[str] = Counter()
        """Commands refused, by reason: "past" or "future"."""
        self._stale = stale
        # smallest delay; None before the first command
        self._least: float | None = None
        self._arrived = 0.0
        # the last stamp that was accepted
        self._stamp = -inf
        # arrivals and delays since a clock was set
        self._anew: list[tuple[float, float]] = []

    def age(self, stamp: float, received: float, moves: bool = True) -> float | None:
        """Return the age (s) of a command, for its stamp and its arrival, in s; None if it is refused.

        A stamp of 0 means no stamp: the age is then counted from its arrival. A command that does not move the robot
        is never refused, and always fresh: a stop is not late.
        """
        if stamp == 0.0:
            return 0.0
        delay, fell = received - stamp, stamp < self._stamp
        if self._least is None:
            self._least = delay
        else:
            self._least += SENDER_CLOCK_DRIFT * max(0.0, received - self._arrived)
        self._arrived = received
        early = delay < self._least - DELAY_SPREAD
        if not (fell or early) and delay <= self._least + self._stale:
            self._anew.clear()
            self._stamp, self._least = stamp, min(self._least, delay)
            return delay - self._least
        if self._agrees(received, delay, set_now=fell or early):
            self._stamp, self._least = stamp, min(each for _, each in self._anew)
            self._anew.clear()
            return delay - self._least
        if not moves:
            return 0.0
        self.refused["future" if early else "past"] += 1
        return None

    def _agrees(self, received: float, delay: float, set_now: bool) -> bool:
        """Return whether the commands since a clock was set agree on a delay; `set_now`: this one shows that it was."""
        first = self._anew[0][1] if self._anew else None
        if first is not None and abs(delay - first) <= DELAY_SPREAD:
            self._anew.append((received, delay))
        elif set_now:
            self._anew = [(received, delay)]
        else:
            self._anew.clear()
        return len(self._anew) >= AGREEING and received - self._anew[0][0] >= AGREE_FOR


class Publishers:
    """Detects whether several publishers command, from the numbers that each gives its messages."""

    def __init__(self) -> None:
        self._last = 0
        self.lost = 0
        """Messages of a single publisher that were lost."""
        self.mixed = 0
        """Numbers out of order: several publishers command at the same time."""

    def take(self, number: int | None) -> None:
        """Take the number of the next message; None if the middleware has no numbers."""
        if not number:
            return
        if number <= self._last:
            self.mixed += 1
        elif self._last:
            self.lost += number - self._last - 1
        self._last = number
