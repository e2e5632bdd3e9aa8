"""Which page drives, and the age of a page's command. No clock and no socket in this module.

Times are s: `now` and `sent` on the server's clock, `page` on a page's own.
"""

from collections import deque
from math import inf, isfinite
from typing import Final

# s after which a command is late: the safety gate would not obey it, either
AGE_MAX: Final = 0.25
# number of round trips that determine the offset of a page's clock
SAMPLES: Final = 20
# s by which answers may contradict each other: large times are rounded
ROUNDING: Final = 1e-6
# s without a command after which another page may take the wheel
IDLE: Final = 10.0


class PageClock:
    """The age of a page's messages, from messages that make a round trip.

    A page answers a message sent at `sent` with its own time `page`; the answer arrives at `now`. So its clock is
    behind by between sent - page and now - page. The smaller offset is used, so that no message seems younger than it
    is.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float]] = deque(maxlen=SAMPLES)

    @property
    def _low(self) -> float:
        return max(low for low, _ in self._samples)

    def answered(self, sent: float, page: float, now: float) -> None:
        """Take an answer. An answer that contradicts the earlier answers, as after a sleep, makes them invalid."""
        if not isfinite(page) or not sent <= now:
            return
        low, high = sent - page, now - page
        if self._samples and (low > min(h for _, h in self._samples) + ROUNDING or high < self._low - ROUNDING):
            self._samples.clear()
        self._samples.append((low, high))

    def age(self, page: float, now: float) -> float:
        """Return the age of a message that was sent at `page` by the page's clock; negative for one from the future."""
        return now - (page + self._low) if self._samples and isfinite(page) else inf


class Sequence:
    """Lets messages with rising numbers through; a repeated or overtaken message is late."""

    def __init__(self) -> None:
        self._last = -1

    def accepts(self, number: object) -> bool:
        """Return whether this number is larger than all before."""
        if isinstance(number, bool) or not isinstance(number, int) or not self._last < number < 1 << 53:
            return False
        self._last = number
        return True


class Budget:
    """Allows an average number of messages a second, and `burst` at once; the rest is refused."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._at = burst, -inf

    def has(self, now: float) -> bool:
        """Return whether there is budget for another message."""
        if self._at > -inf:
            self._left = min(self._burst, self._left + self._rate * (now - self._at))
        self._at = now
        return self._left >= 1.0

    def spend(self, now: float) -> bool:
        """Spend budget on a message; return whether there was enough."""
        enough = self.has(now)
        if enough:
            self._left -= 1.0
        return enough


class PageWheel:
    """The number of the page that has the wheel; 0 for none."""

    def __init__(self) -> None:
        self.holder = 0
        self._drove = -inf

    def take(self, page: int, now: float) -> bool:
        """Give a page the wheel if it is free, or its holder has been idle; return whether the page has it now."""
        if self.holder not in (0, page) and now - self._drove < IDLE:
            return False
        if self.holder != page:
            self.holder, self._drove = page, now
        return True

    def drive(self, page: int, now: float) -> bool:
        """Return whether a page may drive: it has the wheel, or takes a free wheel."""
        if self.holder not in (0, page):
            return False
        self.holder, self._drove = page, now
        return True

    def give(self, page: int) -> None:
        """Release the wheel."""
        if self.holder == page:
            self.holder = 0
