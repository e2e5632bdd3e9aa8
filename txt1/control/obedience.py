"""Notices a board that stops obeying for a moment: the car slows down under a command that does not.

A board whose line from the host is disturbed stops the car by its own rule, and says nothing of it: its odometry goes
on, and counts no fault. When it hears the host again, its loops may take the whole gap as one step, and the car
lurches. So the host has to notice it earlier, by the speed.

The car *reached* its command at REACHED of it. It *fails* it below FAILS of it, for FAILS_FOR, unless within SETTLES
the command was lowered, or the car was as much faster as 1 / REACHED: loops that brake overshoot. A command that rises,
or turns round, has to be reached anew. So has a command after a fall from one share to the other within QUICK: no car
coasts so fast, and a wall is another matter.
"""

from math import inf
from typing import Final

# shares of the commanded speed
REACHED: Final = 0.8
FAILS: Final = 0.5
# s
FAILS_FOR: Final = 0.12
SETTLES: Final = 0.5
QUICK: Final = 0.1
# m/s that has to be commanded
SLOWEST: Final = 0.1
# share by which a command may vary and count as the same
SAME_SHARE: Final = 0.1


class Obedience:
    """Judges whether the car follows its command; `step` it some twenty times a second."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin anew: nothing is commanded."""
        # the command that was reached last, or has to be, m/s
        self._asked = 0.0
        self._reached = False
        # since when the car fails it, and when it was to slow down last, s of the run
        self._fails_since, self._slowing = inf, -inf
        # when it kept its command last, s of the run
        self._kept = -inf

    def fails(self, now: float, v: float, asked: float) -> bool:
        """Return whether a car at v m/s does not obey any more, `now` s of the run; `asked` is the set-point, m/s."""
        if abs(asked) < SLOWEST - 1e-9:
            self.clear()
            return False
        along = v if asked > 0.0 else -v
        turned, change = asked * self._asked <= 0.0, abs(asked) - abs(self._asked)
        lowered = not turned and change < -SAME_SHARE * abs(self._asked)
        if turned or abs(change) > SAME_SHARE * abs(self._asked):
            self._reached, self._asked = self._reached and lowered, asked
        self._slowing = now if lowered or REACHED * along > abs(asked) else self._slowing
        if along >= REACHED * abs(asked):
            self._reached, self._kept = True, now
        elif along < FAILS * abs(asked) and self._fails_since == inf and now - self._kept < QUICK - 1e-9:
            self._reached = False
        if not self._reached or along >= FAILS * abs(asked) or now < self._slowing + SETTLES:
            self._fails_since = inf
            return False
        self._fails_since = min(self._fails_since, now)
        return now - self._fails_since >= FAILS_FOR - 1e-9
