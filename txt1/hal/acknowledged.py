"""Gains on their way to a board, which says yes or no to them. They are sent until it does."""

from collections.abc import Callable
from math import inf
from typing import Final

from txt1.protocol.messages import PID_SET_PERIOD

# Answers "rejected" that are believed. A line may damage a PID set, and then the board rejects what nobody meant.
REJECTIONS_MAX: Final = 3
# s after which acknowledged gains are sent again while the vehicle stands: a board may have restarted unnoticed
HEAL_PERIOD: Final = 10.0


class AcknowledgedGains:
    """A board's gains; times are of two clocks, `now` of the run, `time` of the loop.

    `missing`: they were sent to a board that was found again, and that has not acknowledged them yet.
    """

    def __init__(self) -> None:
        self.missing = False
        self._frame: bytes | None = None
        self._answered: Callable[[bool], None]
        # of the run, once there is a line
        self._due: float
        # of the loop
        self._heal_due = inf
        # sent, and not answered yet
        self._asked = False
        self._rejections: int

    def load(self, frame: bytes, answered: Callable[[bool], None]) -> None:
        """Send this PID set from now on."""
        self._answered = answered
        if frame == self._frame and self._due < inf:
            # under way
            return
        # The answer to other gains that are under way must not pass for the answer to these: they wait for their turn.
        self._due = -inf if self._due == inf else self._due
        self._frame, self._asked, self._rejections = frame, False, 0

    def send_anew(self) -> None:
        """The line is a fresh one."""
        self._due = -inf

    def lost(self) -> None:
        """The board is gone: what it has is not known."""
        self.missing = self._frame is not None

    def found(self) -> None:
        """The board answers, and may have forgotten everything."""
        self._due, self._heal_due, self._rejections = -inf, inf, 0

    def take(self, accepted: bool, time: float) -> None:
        """The board has answered."""
        if not self._asked:
            # somebody else's, or a late one
            return
        self._rejections += not accepted
        self.missing &= not accepted
        # else it is sent again
        if accepted or self._rejections >= REJECTIONS_MAX:
            self._asked, self._rejections, self._due = False, 0, inf
            self._heal_due = time + HEAL_PERIOD if accepted else inf
            self._answered(accepted)

    def to_send(self, now: float, time: float, moves: bool) -> bytes | None:
        """The PID set if it is to be sent now; None if not."""
        heals = time >= self._heal_due and not moves
        if self._frame is None or not (now >= self._due or heals):
            return None
        if heals:
            self._heal_due = time + HEAL_PERIOD
        else:
            self._due = now + PID_SET_PERIOD
        self._asked = True
        return self._frame
