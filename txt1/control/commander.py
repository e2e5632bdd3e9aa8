"""Who drives: sources of commands with priorities and time-outs; one source at a time has the wheel.

The commander stands between the sources (keys, gamepad, web, ROS, programs) and the safety gate, which decides last.

* A command that is not zero, or `Commander.request`, takes a free wheel, and takes it at once from a source of lower
  priority. Between equal priorities the driving source goes on; the other is refused and counted.
* Commands that are not zero, and requests, hold the wheel as long as the newest is fresh. Freshness is the age of the
  message at its own origin. Zeros stop the robot; they hold nothing.
* A source that lost the wheel to another, or was refused because of another, is *overruled*. It may drive again once
  the other has let go and it has sent one zero or a new request. So letting go of a gamepad never starts the program
  that drove before.
* A change of hands passes through zero: after a source that moved the robot, the commands of the next source count as
  zero for `HANDOVER` s.
* A hand has to prove its hold (`txt1.control.holding`). Its commands come by `Commander.hold`, and its zeros hold the
  wheel, too. Its hold is over when it is overruled, when the robot is armed, and after `PAUSE` s without a command.
  Then it may drive again only after `Commander.release`: the hand lets go, and presses again.
* A source that drove, and was stopped for more than PAUSE without having asked for it, is overruled by A_STOP. A board
  did not obey for a moment, the robot was disarmed, a guard's sensor was silent, or a line held the commands back. The
  source may drive again once it has sent one zero or a new request, so the hold that was stopped does not drive on by
  itself. Arming the robot asks again for programs; hands have to let go.

Nothing here knows a clock: `now` is the present and `time` a message's origin, both s of the run.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Final, NamedTuple

from txt1.control.holding import HANDOVER, PAUSE
from txt1.errors import A_STOP
from txt1.units import new

PRIORITIES: Final[Mapping[str, int]] = {"keys": 50, "program": 10}
"""The spine's own sources. Any other source has a program's priority, unless an addition gives it another.

Hands at the robot come before hands at a distance, and these before programs: a radio control has 60, a gamepad 40;
a page, the live view and a fleet's console have 30; ROS has 20. The emergency stop is the gate's, above all.
"""

# s by which a message may seem to come from the future, as clocks are rounded
SKEW: Final = 0.001


class SetPoint(NamedTuple):
    """The velocity to send on: v in m/s, omega in rad/s, and the origin of the command behind it, s of the run."""

    v: float = 0.0
    omega: float = 0.0
    time: float = -inf


class Driver(NamedTuple):
    """The driving source ("" for none), since when (s of the run), and how often each source was refused, if ever."""

    name: str = ""
    since: float = 0.0
    refused: Mapping[str, int] = {}


@dataclass(eq=False)
class _Source:
    """A source's rank and its last actions; times are -inf before the first."""

    name: str
    priority: int
    timeout: float
    # origin of its newest message
    spoke: float = -inf
    # origin of the newest message that holds the wheel
    held: float = -inf
    # by which source
    overruled: str = ""
    # whether a hand holds since its last release, and whether this hold is over
    holds: bool = False
    over: bool = False


class Commander:
    """Decides whose command goes on to the safety gate; no source may have a longer time-out than `timeout`, s."""

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._sources: dict[str, _Source] = {}
        self._driver: _Source | None = None
        self._since = 0.0
        self._refused: Counter[str] = Counter()
        # the source that last moved the robot, and the time until which all others command zero
        self._moved: _Source | None = None
        self._rests = -inf
        # as commanded, however old; `setpoint` is what is in force
        self.newest = SetPoint()
        # kept until it changes
        self._told: Driver | None = None

    def add(self, name: str, priority: int | None = None, timeout: float | None = None) -> None:
        """Add a source, with its priority from `PRIORITIES` if None; its commands are stale after `timeout` s.

        Raises ValueError: the name is taken, or the time-out is not positive or longer than the gate's.
        """
        if name in self._sources or not name:
            raise ValueError(f"source {name!r}: this name is taken; choose another")
        limit = self._timeout if timeout is None else timeout
        if not 0.0 < limit <= self._timeout:
            allowed = f"more than 0 and at most the safety gate's {self._timeout:g} s (safety.command_timeout)"
            raise ValueError(f"source {name!r}: a time-out of {limit!r} s; it must be {allowed}")
        rank = PRIORITIES.get(name, PRIORITIES["program"]) if priority is None else priority
        self._sources[name] = _Source(name, rank, limit)

    def hold(self, name: str, v: float, omega: float, time: float, now: float) -> bool:
        """Take a command of a hand that holds, as `command` does; zeros hold the wheel, too."""
        source = self._sources[name]
        source.over |= source.holds and time - source.spoke > PAUSE
        source.holds = True
        return self.command(name, v, omega, time, now)

    def command(self, name: str, v: float, omega: float, time: float, now: float) -> bool:
        """Take a command (m/s, rad/s). True if it is now the set-point; a zero only counts while nobody else drives.

        Directly after another source that moved the robot, the set-point is zero. Raises ValueError: a number is not
        finite, or `time` lies in the future.
        """
        source = self._sources[name]
        moves = v != 0.0 or omega != 0.0 or source.holds
        if not (isfinite(v) and isfinite(omega) and isfinite(time) and time <= now + SKEW):
            raise ValueError(f"v={v!r}, omega={omega!r}, given at {time!r} s: give finite numbers, no later than now")
        driver = self._driver_at(now)
        # late, or overtaken by a newer command
        if time < source.spoke or now - time > source.timeout + 1e-9:
            # it drove, and its commands were held back on the way while the robot stood
            if moves and -inf < source.spoke <= source.held < now - source.timeout - PAUSE:
                source.overruled, source.over = source.overruled or A_STOP, source.holds
            self._refuse(name)
            return False
        source.spoke = time = min(time, now)
        if not moves:
            if not _rules(driver, source) and time >= self._since:
                source.overruled = ""
            if driver is not None and driver is not source:
                return False
        elif not self._take(source, driver, time):
            return False
        if time < self._rests and source is not self._moved:
            v = omega = 0.0
        self.newest = new(SetPoint, (v, omega, time))
        return True

    def request(self, name: str, now: float) -> bool:
        """Ask for the wheel, or hold it; return whether the source has it. The set-point is 0 until a command comes."""
        source, driver = self._sources[name], self._driver_at(now)
        if not _rules(driver, source):
            source.overruled = ""
        if not self._take(source, driver, now):
            return False
        if driver is not None and driver is not source:
            self.newest = SetPoint(time=now)
        return True

    def release(self, name: str, now: float) -> bool:
        """Command zero once and let go of the wheel; return whether the zero is the set-point, as `command` does."""
        source = self._sources[name]
        if source.holds:
            source.holds, source.over, source.overruled = False, False, ""
        if self._driver is source:
            self._free(now)
        return self.command(name, 0.0, 0.0, now, now)

    def interrupt(self, now: float) -> None:
        """Take the wheel from the driving source, which has to send a zero or a request before it drives again."""
        driver = self._driver_at(now)
        if driver is not None:
            driver.overruled, driver.over = A_STOP, driver.holds
            self._free(now)

    def clear(self, now: float) -> None:
        """Forget every command and every hold up to `now`: the robot has just been armed."""
        for source in self._sources.values():
            source.over = source.holds
            if source.overruled == A_STOP:
                source.overruled = ""
        if self._driver is not None:
            self._free(now)
        self.newest = SetPoint()

    def setpoint(self, now: float) -> SetPoint:
        """The set-point in force at `now`; 0 when the command behind it is stale."""
        driver, setpoint = self._driver_at(now), self.newest
        timeout = self._timeout if driver is None else driver.timeout
        return setpoint if now - setpoint.time <= timeout + 1e-9 else SetPoint(time=setpoint.time)

    def driver(self, now: float) -> Driver:
        """Return the driver at `now`."""
        driver = self._driver_at(now)
        if self._told is None:
            self._told = Driver("" if driver is None else driver.name, self._since, dict(self._refused))
        return self._told

    def overruled(self, name: str) -> str:
        """Name of the source that has overruled this source; "" if it may drive unless a higher source drives."""
        return self._sources[name].overruled

    def _driver_at(self, now: float) -> _Source | None:
        driver = self._driver
        if driver is not None and now - driver.held > driver.timeout + 1e-9:
            self._free(driver.held + driver.timeout)
        return self._driver

    def _take(self, source: _Source, driver: _Source | None, time: float) -> bool:
        if source.over or source.overruled or (driver is not source and _rules(driver, source)):
            if driver is not None and driver is not source:
                source.overruled, source.over = driver.name, source.holds
            self._refuse(source.name)
            return False
        if driver is not source:
            if driver is not None:
                driver.overruled, driver.over = source.name, driver.holds
                self._rest(driver, time)
            self._driver, self._since, self._told = source, time, None
        if time > source.held:
            source.held = time
        return True

    def _refuse(self, name: str) -> None:
        self._refused[name] += 1
        self._told = None

    def _rest(self, driver: _Source, time: float) -> None:
        """Let the robot rest before another source moves it, if this driver did."""
        if self.newest.v or self.newest.omega:
            self._moved, self._rests = driver, time + HANDOVER

    def _free(self, time: float) -> None:
        if self._driver is not None:
            self._rest(self._driver, time)
        self._driver, self._since, self._told = None, time, None
        self.newest = SetPoint(time=self.newest.time)


def _rules(driver: _Source | None, source: _Source) -> bool:
    """Whether another driver keeps this source from the wheel."""
    return driver is not None and driver is not source and driver.priority >= source.priority
