"""One page drives and the others watch; and how old a page's command is. No clock and no socket in here.

Times are s: `now` and `sent` on the server's clock, `page` on a page's own.
"""

from collections import deque
from math import inf, isfinite
from typing import Final

# s after which a command is late: the safety gate would not obey it either
AGE_MAX: Final = 0.25
# messages there and back that the offset of a page's clock is taken from
SAMPLES: Final = 20
# s by which answers may contradict one another: large times are rounded
ROUNDING: Final = 1e-6
# s without a command after which another page may take the wheel
IDLE: Final = 10.0


class PageClock:
    """The age of a page's messages, from messages that went there and back.

    A page that answered with its own time `page` to a message of `sent`, heard at `now`, has a clock that is between
    sent - page and now - page behind. The smaller offset is used, so that no message seems younger than it is.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float]] = deque(maxlen=SAMPLES)

    @property
    def _low(self) -> float:
        return max(low for low, _ in self._samples)

    def answered(self, sent: float, page: float, now: float) -> None:
        """Take an answer; one that contradicts those before, as after a sleep, makes them worth nothing."""
        if not isfinite(page) or not sent <= now:
            return
        low, high = sent - page, now - page
        if self._samples and (low > min(h for _, h in self._samples) + ROUNDING or high < self._low - ROUNDING):
            self._samples.clear()
        self._samples.append((low, high))

    def age(self, page: float, now: float) -> float:
        """How old a message is that the page sent at `page` by its own clock; negative when it is from the future."""
        return now - (page + self._low) if self._samples and isfinite(page) else inf


class Sequence:
    """Lets through messages whose numbers rise: what was sent again, or comes behind a newer one, is late."""

    def __init__(self) -> None:
        self._last = -1

    def accepts(self, number: object) -> bool:
        """Whether this is the number of a message newer than all before."""
        if isinstance(number, bool) or not isinstance(number, int) or not self._last < number < 1 << 53:
            return False
        self._last = number
        return True


class Budget:
    """So many messages a second on average, and `burst` at once; the rest is refused."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._at = burst, -inf

    def has(self, now: float) -> bool:
        """Whether there is something left for one more."""
        if self._at > -inf:
            self._left = min(self._burst, self._left + self._rate * (now - self._at))
        self._at = now
        return self._left >= 1.0

    def spend(self, now: float) -> bool:
        """Take one, if there is something left; whether there was."""
        enough = self.has(now)
        if enough:
            self._left -= 1.0
        return enough


class PageWheel:
    """Which page has the wheel, by its number; 0 for none."""

    def __init__(self) -> None:
        self.holder = 0
        self._drove = -inf

    def take(self, page: int, now: float) -> bool:
        """Give the wheel to a page if it is free, or its holder has not driven for a while; whether it has it now."""
        if self.holder not in (0, page) and now - self._drove < IDLE:
            return False
        if self.holder != page:
            self.holder, self._drove = page, now
        return True

    def drive(self, page: int, now: float) -> bool:
        """Whether a page may drive: it has the wheel, or takes one that is free."""
        if self.holder not in (0, page):
            return False
        self.holder, self._drove = page, now
        return True

    def give(self, page: int) -> None:
        """Let go of the wheel."""
        if self.holder == page:
            self.holder = 0
