"""Drives ESCs backwards that take the first reverse pulse as a brake.

How it works
------------

Most hobby ESCs go forward, brake and reverse. After a drive forward, a pulse on the reverse side brakes. The motor
turns backwards only when the car stands, the pulse was at neutral, and comes to the reverse side a second time. So a
command that drives backwards after a drive forward passes four stages:

1. The car comes to rest. A set-point that drives backwards brakes meanwhile. Without one the pulse is neutral, so a
   stop is never more than neutral.
2. CLICK s on the reverse side: the ESC takes this as its brake.
3. CLICK s of neutral.
4. The reverse side turns the motor backwards, until a pulse drives forward.

After ESC_FORGOTTEN s of neutral all this begins again, as the ESC may have been switched off meanwhile. An ESC that
would have reversed at once then turns the motor backwards for CLICK s, and stops for CLICK s, before it goes on.

Motors of two sides wait for each other. While they wait, the car does not follow its outputs.
"""

from collections.abc import Sequence
from math import inf
from typing import Final

# s of a pulse that the ESC has to notice: five pulses at 50 Hz
CLICK: Final = 0.1
# s of neutral after which the state of an ESC is not known any more
ESC_FORGOTTEN: Final = 1.0
# s by which a cycle may be early
CYCLE_EARLY: Final = 1e-6


class BrakeFirst:
    """The way of a car's motors into reverse, for ESCs that brake first.

    Fewer counts than `dead_band` turn no motor, so an ESC may not notice them: they count as neutral.
    """

    def __init__(self, motors: int, dead_band: float) -> None:
        self._dead_band = dead_band
        self.waits = False
        """Whether the motors do not follow the outputs at present."""
        # which motors the reverse side turns backwards
        self._reverse = [False] * motors
        # when the pulse was last not neutral, and when the click began, s of the run
        self._driven, self._clicked = -inf, inf

    def passes(self, motors: Sequence[float], now: float, *, stands: bool, brakes: bool) -> tuple[bool, ...]:
        """Return for each motor whether its pulse may be put out now; if not, it gets neutral.

        `motors` are the counts, forward positive. `stands`: the car stands. `brakes`: the set-point drives backwards.
        """
        band = self._dead_band
        if any(abs(counts) >= band for counts in motors):
            self._driven = now
        self._reverse = [
            known and counts < band and now - self._driven < ESC_FORGOTTEN
            for known, counts in zip(self._reverse, motors, strict=True)
        ]
        shut = tuple(counts <= -band and not known for counts, known in zip(motors, self._reverse, strict=True))
        self.waits = any(shut)
        if not self.waits:
            self._clicked = inf
            return tuple(counts >= 0.0 or known for counts, known in zip(motors, self._reverse, strict=True))
        if self._clicked == inf and stands:
            self._clicked = now
        clicks = now - self._clicked
        if clicks < CLICK - CYCLE_EARLY:
            return shut if brakes or self._clicked < inf else (False,) * len(shut)
        if clicks < 2.0 * CLICK - CYCLE_EARLY:
            return (False,) * len(shut)
        self._reverse = [known or now_known for known, now_known in zip(self._reverse, shut, strict=True)]
        self.waits, self._clicked = False, inf
        return (True,) * len(shut)
