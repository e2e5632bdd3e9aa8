"""Gains for a board that accepts or rejects them; they are sent until the board answers."""

from collections.abc import Callable
from math import inf
from typing import Final

from txt1.protocol.messages import PID_SET_PERIOD

# number of answers "rejected" that are believed: if a line damages a PID set, the board rejects intact gains
REJECTIONS_MAX: Final = 3
# s after which acknowledged gains are sent again while the vehicle stands: a board may have restarted unnoticed
HEAL_PERIOD: Final = 10.0


class AcknowledgedGains:
    """The gains of a board. Times are of two clocks: `now` is s of the run, `time` is s of the event loop.

    `missing`: a board was found again and has not yet acknowledged the gains.
    """

    def __init__(self) -> None:
        self.missing = False
        self._frame: bytes | None = None
        self._answered: Callable[[bool], None]
        # s of the run at which the gains were last sent, once there is a line
        self._due: float
        # s of the loop at which they were last sent
        self._heal_due = inf
        # number of PID sets sent and not answered
        self._asked = False
        self._rejections: int

    def load(self, frame: bytes, answered: Callable[[bool], None]) -> None:
        """Send this PID set from now on."""
        self._answered = answered
        if frame == self._frame and self._due < inf:
            # under way
            return
        # the answer to earlier gains must not count as the answer to these, so these wait until the earlier are
        # answered
        self._due = -inf if self._due == inf else self._due
        self._frame, self._asked, self._rejections = frame, False, 0

    def send_anew(self) -> None:
        """Send the gains again: the line is new."""
        self._due = -inf

    def lost(self) -> None:
        """Note that the board is gone; its gains are unknown."""
        self.missing = self._frame is not None

    def found(self) -> None:
        """Note that the board answers, and may have lost its gains."""
        self._due, self._heal_due, self._rejections = -inf, inf, 0

    def take(self, accepted: bool, time: float) -> None:
        """Take the board's answer."""
        if not self._asked:
            # the answer to another host, or a late answer
            return
        self._rejections += not accepted
        self.missing &= not accepted
        # otherwise the gains are sent again
        if accepted or self._rejections >= REJECTIONS_MAX:
            self._asked, self._rejections, self._due = False, 0, inf
            self._heal_due = time + HEAL_PERIOD if accepted else inf
            self._answered(accepted)

    def to_send(self, now: float, time: float, moves: bool) -> bytes | None:
        """Return the PID set if it is due now, else None."""
        heals = time >= self._heal_due and not moves
        if self._frame is None or not (now >= self._due or heals):
            return None
        if heals:
            self._heal_due = time + HEAL_PERIOD
        else:
            self._due = now + PID_SET_PERIOD
        self._asked = True
        return self._frame
