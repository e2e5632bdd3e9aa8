"""Sight of a car that is commanded to drive: encoders that lose their power read 0, and loops then drive without limit.

How it works
------------

A car that rolls, and is commanded to go on, does not vanish: its motor does not brake. A wheel that spins or locks
changes its speed within milliseconds, far quicker than the car can, but it does not stay at exactly 0: without the
motor's force the ground turns it again. So a reading of exactly 0 of all wheels, under such a command, is judged by
what may have happened unseen:

* **Doubt.** The car rolled faster than FALL, so this reading fell faster than brakes can slow a car. (Wheels may spin
  faster than it rolls: its speed is that of the wheels, but rises by no more than the tyres' PULL.) The outputs are
  neutral until the next reading. A wheel that was locked turns again in it, and the car drives on.
* **Lost.** The reading after a doubt is 0, too. Or the car may have gone UNSEEN_WAY without being seen: loops that see
  0 add the commanded speed to their output about every GAIN, so a car that rolled at v0 is, after t s, at

      v = v0 + v_asked t / GAIN            so that its way is        v0 t + v_asked t^2 / (2 GAIN)

  where v rises by no more than PULL.

Lost is what encoders without power, a wall, an obstacle and a blocked car have in common. They cannot be told apart,
and all of them want the same: a stop, and a look at the robot.
"""

from math import copysign, sqrt
from typing import Final

# m/s of a fall from one reading to the next that no brakes explain: 10 m/s^2 for the 0.05 s between two messages
FALL: Final = 0.5
# m that a car may go on without being seen
UNSEEN_WAY: Final = 0.1
# s in which loops that see 0 add the commanded speed to that of their outputs
GAIN: Final = 0.1
# m/s^2 that tyres pull
PULL: Final = 10.0
# m/s that has to be commanded: slower wheels may read 0
SLOWEST: Final = 0.1
# share of the commanded speed below which a car was slowing down already, and may have come to rest
SLOWED_SHARE: Final = 0.7
# s that a reading may cover; what happened in a longer pause of the line is not known
READING_TIME_MAX: Final = 0.05
# encoder counts that have to be missing
COUNTS: Final = 5.0


def time_unseen(way: float, asked: float) -> float:
    """Return s in which a car that stood, commanded at `asked` m/s, may go `way` m while its loops see 0."""
    return sqrt(2.0 * GAIN * way / abs(asked))


def outer_wheel(v: float, turning: float) -> float:
    """Return the speed of the faster wheel, m/s, signed as the speed v; `turning` is its part of the turn, m/s."""
    part = abs(turning)
    return v - part if v < 0.0 else v + part


class WheelSight:
    """Notices from readings of the wheels that a car is not seen any more; `count` is m per encoder count, or 0."""

    def __init__(self, count: float) -> None:
        self._way_max = max(UNSEEN_WAY, COUNTS * count)
        self._fall = max(FALL, COUNTS * count / READING_TIME_MAX)
        self.clear()

    def clear(self) -> None:
        """Begin anew: the car stands."""
        self.doubted = False
        """Whether the outputs have to be neutral until the next reading."""
        # the car's speed at the last two readings above 0, m/s: no more than tyres can have given it
        self._speed = self._before = 0.0
        # since the wheels were seen to turn: m/s that it may have gained, and m that it may have gone
        self._gained = self._way = 0.0

    @property
    def unseen(self) -> bool:
        """Whether it may be going on unseen, and is not lost yet."""
        return self._way > 0.0

    def turns(self, wheel: float, dt: float) -> None:
        """Take a reading of wheels that turn, which came `dt` s after the last: the outer wheel's speed, m/s."""
        before = self._before = self._speed
        speed = PULL * (dt if dt < READING_TIME_MAX else READING_TIME_MAX)
        if before * wheel > 0.0:
            speed += before if before > 0.0 else -before
        self._speed = wheel if -speed <= wheel <= speed else copysign(speed, wheel)
        self.doubted, self._gained, self._way = False, 0.0, 0.0

    def lost(self, asked: float, dt: float, brakes: bool = False) -> bool:
        """Return whether the car is not seen any more, by a reading of wheels that do not turn.

        The reading came `dt` s after the last. `asked` is the outer wheel's speed by the set-point of that time, m/s.
        `brakes`: the motor's output was against it at this reading or the one before, as it acts up to a period later:
        so the wheels may have come to rest.
        """
        if self.doubted:
            return True
        if abs(asked) < SLOWEST - 1e-9:
            self.clear()
            return False
        rolled = self._rolled(asked)
        if brakes or rolled < SLOWED_SHARE * abs(asked):
            return False
        if self._way == 0.0 and rolled > self._fall:
            self.doubted = True
        dt = min(dt, READING_TIME_MAX)
        self._gained += dt * min(abs(asked) / GAIN, PULL)
        self._way += dt * (rolled + self._gained)
        return self._way > self._way_max

    def _rolled(self, asked: float) -> float:
        """Return the speed, m/s, at which it rolled and has no reason to brake: 0 if it rolled the other way last."""
        last, before = (self._speed, self._before) if asked > 0.0 else (-self._speed, -self._before)
        return min(max(last, before), abs(asked)) if last > 0.0 else 0.0
