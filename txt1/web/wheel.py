"""Which page drives, and the age of a page's command. No clock and no socket in this module.

Times are s: `now` and `sent` on the server's clock, `page` on a page's own.
"""

from collections import deque
from math import inf, isfinite
from typing import Final

# s after which a command is late: the safety gate would not obey it, either
COMMAND_AGE_MAX: Final = 0.25
# number of round trips that determine the offset of a page's clock
ROUND_TRIPS: Final = 20
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
        self._samples: deque[tuple[float, float]] = deque(maxlen=ROUND_TRIPS)

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


class PageWheel:
    """The page that has the wheel: its number, 0 for none, and whether it is an operator's."""

    def __init__(self) -> None:
        self.holder = 0
        self._operated = False
        self._drove = -inf

    def take(self, page: int, operator: bool, now: float) -> bool:
        """Give a page the wheel if it may have it; return whether it has the wheel now.

        A page may have it if it is free. An operator takes it from a visitor at once; between equals it changes hands
        when its holder has been idle; a visitor never takes it from an operator.
        """
        if self.holder == page:
            return True
        if self.holder:
            equal = operator == self._operated
            if (equal and now - self._drove < IDLE) or (self._operated and not operator):
                return False
        self.holder, self._operated, self._drove = page, operator, now
        return True

    def drove(self, now: float) -> None:
        """Note that the holder drives, so it is not idle."""
        self._drove = now

    def give(self, page: int) -> None:
        """Release the wheel."""
        if self.holder == page:
            self.holder = 0

    def why(self, operator: bool) -> str:
        """Return why a page does not get the wheel, and when it will."""
        if self._operated and not operator:
            return f"page {self.holder} is an operator's, and has the wheel until it gives it up"
        return f"page {self.holder} drives; it may give up the wheel, or be idle for {IDLE:g} s"
