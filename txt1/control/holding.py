"""The rule of a hold: whoever holds must prove it.

A hold begins with a fresh press: a key or a dead-man button was up and goes down. It lasts as long as signs of a hand
come: another fresh press, or a report of the device that tells something new. A key's repeats and a button that is
still down are no signs: the computer makes them without a hand, when a release is lost or a pad's radio is out of
reach. So a hold ends

* when any dead-man is released, also one that does not drive;
* `HOLD_LASTS` s after the last sign.

A hold that has ended comes back by a fresh press alone. A fresh press of another hand takes over: the first hold ends,
the robot is commanded zero, and `HANDOVER` s later the new hand drives. The page has the same rule
(`txt1/web/static/hold.js`). Nothing here knows a clock: all times are s of the same clock.
"""

from math import inf
from typing import Final

# s without a sign of a hand after which its hold ends
HOLD_LASTS: Final = 3.0
# s of zero between two hands; the board gets two Velocity messages in this time
HANDOVER: Final = 0.1
# s without a command of a hand after which its hold is over, and does not go on by itself
PAUSE: Final = 0.5


class Hold:
    """The hold of several hands, such as pads, by their numbers: at most one of them holds."""

    def __init__(self, lasts: float = HOLD_LASTS) -> None:
        self.by: int | None = None
        """The hand that holds."""
        self.expired = False
        """Whether the last hold ended without a sign of a hand, and no fresh press has come since."""
        self._lasts = lasts
        self._sign = -inf
        self._last: int | None = None
        self._ended = -inf

    def press(self, by: int, now: float) -> None:
        """Take a fresh press."""
        if self.by != by:
            self.end(now)
        self.by, self._sign, self.expired = by, now, False

    def sign(self, by: int, time: float) -> None:
        """Take a sign of a hand: it renews the hold of this hand, and begins none."""
        if by == self.by:
            self._sign = max(self._sign, time)

    def end(self, now: float) -> None:
        """End the hold: a dead-man was released, or a pad has gone."""
        if self.by is not None:
            self.by, self._last, self._ended = None, self.by, now

    def drives(self, now: float) -> int | None:
        """Return the hand that drives now; None for none."""
        if self.by is not None and now - self._sign > self._lasts:
            self.end(now)
            self.expired = True
        return None if self.by != self._last and now - self._ended < HANDOVER else self.by
