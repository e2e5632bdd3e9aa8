"""The age of a stamped command, from its stamp alone: the clocks of the two ends need not agree."""

from collections import Counter, deque
from typing import Final

# s over which the offset between the clocks is judged
WINDOW: Final = 10.0
# s by which a stamp may be earlier than the offset allows
AHEAD: Final = 0.1
# number of stamps ahead by the same time after which the other end's clock counts as reset
AGREEING: Final = 5
# s by which the clocks may differ when the first command comes
FIRST: Final = 60.0


class Stamps:
    """The stamps of a publisher's commands; `stale` is the age in s at which a command is refused.

    The offset between the clocks is the least of receive minus stamp: the message that was the fastest had no delay.
    """

    def __init__(self, stale: float) -> None:
        self.refused: Counter[str] = Counter()
        """Commands refused, by reason: "past" or "future"."""
        self._stale = stale
        # time of arrival, and arrival minus stamp
        self._seen: deque[tuple[float, float]] = deque()
        self._ahead: deque[float] = deque(maxlen=AGREEING)

    def age(self, stamp: float, received: float) -> float | None:
        """Return the age (s) of a command, for its stamp and its arrival, in s; None if it is from the past or
        the future.

        A stamp of 0 means no stamp: the age is then counted from its arrival.
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
                # the other end's clock was reset
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
