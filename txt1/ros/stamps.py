"""The age of a stamped command, by its stamp alone: the clocks of the two ends need not agree."""

from collections import Counter, deque
from typing import Final

# s over which the offset between the clocks is judged
WINDOW: Final = 10.0
# s by which a stamp may be earlier than the offset allows
AHEAD: Final = 0.1
# stamps ahead by the same time after which the other end's clock was set
AGREEING: Final = 5
# s by which the clocks may differ when the first command comes
FIRST: Final = 60.0


class Stamps:
    """The stamps of one publisher's commands; `stale` is the age in s at which one is refused.

    The offset between the clocks is the least of receive minus stamp: the message that was the fastest had no delay.
    """

    def __init__(self, stale: float) -> None:
        self.refused: Counter[str] = Counter()
        """Commands refused, by why: "past" or "future"."""
        self._stale = stale
        # when received, and receive minus stamp
        self._seen: deque[tuple[float, float]] = deque()
        self._ahead: deque[float] = deque(maxlen=AGREEING)

    def age(self, stamp: float, received: float) -> float | None:
        """The age (s) of a command with a stamp, both times in s; None when it is from the past or the future.

        A stamp of 0 means that it has none: it is as old as its arrival.
        """
        if stamp == 0.0:
            return 0.0
        delay = received - stamp
        while self._seen and received - self._seen[0][0] > WINDOW:
            self._seen.popleft()
        if not self._seen:
            if abs(delay) > FIRST:
                return self._refuse("past" if delay > 0.0 else "future")
            self._seen.append((received, delay))
            return 0.0
        offset = min(each for _, each in self._seen)
        if delay < offset - AHEAD:
            self._ahead.append(delay)
            if len(self._ahead) == AGREEING and max(self._ahead) - min(self._ahead) < AHEAD:
                # the other end's clock was set
                self._seen.clear()
                self._ahead.clear()
                self._seen.append((received, delay))
                return 0.0
            return self._refuse("future")
        self._ahead.clear()
        age = max(0.0, delay - offset)
        self._seen.append((received, delay))
        return age if age <= self._stale else self._refuse("past")

    def _refuse(self, why: str) -> float | None:
        self.refused[why] += 1
        return None


class Publishers:
    """Whether one publisher or several command, by the numbers that each gives its own messages."""

    def __init__(self) -> None:
        self._last = 0
        self.lost = 0
        """Messages of a single publisher that did not arrive."""
        self.mixed = 0
        """Numbers out of turn: several publish at the same time."""

    def take(self, number: int | None) -> None:
        """Take the number of the next message; None where the middleware has none."""
        if not number:
            return
        if number <= self._last:
            self.mixed += 1
        elif self._last:
            self.lost += number - self._last - 1
        self._last = number
