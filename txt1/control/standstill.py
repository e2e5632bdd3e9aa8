"""Verify every stop: the robot is watched until it stands, and if it does not slow down, stronger measures follow.

How it works
------------

A stop that was sent may have no effect. The line may lose it, a board may be in a mode that does not obey it, or a loop
may be wound up. So the speed is watched from the moment at which nothing should move the robot any more. Some twenty
times a second three questions are asked:

1. *Does it slow down?* The stop is on its way if the speed falls at least as fast as that of a coasting vehicle.
2. *Does it stand?* It does when the speed was STILL_SPEED or less for STANDS_AFTER. Only this is called standing. An
   unknown speed is never taken for 0.
3. *Does it move without a command?* Then an outside force moves it, and that is reported.

A robot that is faster than any command, and again RACES later, is neither pushed by a hand nor slowing down. Its loops
drive it, and the ESC is switched off at once: a PWM test of zeros interrupts loops, but they wind up further.

If the answer to the first question is no, the stop escalates: zeros, which are sent all the time; then a PWM test of
zeros, which bypasses the loops; then the ESC off. Within a stop it never goes back to a weaker measure. Each measure
gets MEASURE_TIME to show an effect, and is judged from the speed at which it began. While the line is dead, this time
stops.

A robot that stood and is no longer seen is `UNSEEN`, not standing. So is a robot whose speed fell faster than any
vehicle can brake: its encoders have lost their power, or it stands at a wall, and the two cannot be told apart.

The envelope
------------

From the instant t = 0 at which nothing moves it any more, a vehicle with speed v0 that coasts after a delay t0 obeys

    dv/dt = -(v + f) / tau        so that        v(t) = (v0 + f) exp(-(t - t0) / tau) - f,        not below 0

with the friction f and the time constant tau of a vehicle without brakes; loops that brake are faster. That is the
envelope. From 0.5 s on the stop escalates if the speed is 0.1 m/s above the envelope, if it stays above STILL_SPEED
when the envelope has come to 0, or if it is unknown. Each measure gets the same 0.5 s and an envelope of its own. An
envelope never begins above the speed at which a vehicle counts as a runaway: a counter that jumped would allow it
seconds.
"""

from enum import StrEnum
from math import exp, inf, log, nan
from typing import Final

# s that each measure gets
MEASURE_TIME: Final = 0.5
# m/s above the envelope at which a stop has failed
ENVELOPE_MARGIN: Final = 0.1
# s from a stop to its effect on the odometry: a period of line, of board and of odometry
DELAY: Final = 0.15
# s, of coasting
TAU: Final = 0.6
# m/s, of coasting
FRICTION: Final = 0.1
# m/s: original boards read 0 or 0.045 m/s a wheel when it hardly moves
STILL_SPEED: Final = 0.05
# s at this speed at most, after which it counts as standing
STANDS_AFTER: Final = 0.3
# s after the envelope has come to 0; by then even a slow vehicle has to stand
LINGERS: Final = 0.5
# m/s; a vehicle without a command that is faster moves
MOVES: Final = 0.1
# s of such motion after which it is reported
MOVED: Final = 0.5
# s between two readings above any command, which show that loops drive it: a counter that jumped makes only one
RACES: Final = 0.15
# s after which the first of the two is forgotten
RACED: Final = 1.0
# m/s, assumed for a vehicle whose speed at the stop is unknown
SPEED_MAX: Final = 1.5


class Stop(StrEnum):
    """How the last stop is going."""

    # the vehicle is commanded, or nothing is known of it yet
    NONE = "none"
    # a stop was asked for, and the speed falls as that of a coasting vehicle, or is judged soon
    SLOWING = "slowing down"
    # seen to stand
    STANDING = "standing"
    PWM_ZEROS = "does not stop: PWM test of zeros"
    ESC_OFF = "does not stop: ESC off"
    UNASKED = "moves without a command"
    # it stood, or its encoders fell silent, and it was not seen since
    UNSEEN = "not seen"


UNOBEYED: Final = (Stop.PWM_ZEROS, Stop.ESC_OFF)


def envelope(v0: float, t: float) -> float:
    """Speed in m/s of a coasting vehicle, t s after it was stopped at v0 m/s."""
    return max(0.0, (v0 + FRICTION) * exp(-max(0.0, t - DELAY) / TAU) - FRICTION)


def coasting_time(v0: float) -> float:
    """Time in s after which the envelope of v0 m/s has come to 0."""
    return DELAY + TAU * log(1.0 + v0 / FRICTION)


class Standstill:
    """Watches stops; `step` it some twenty times a second.

    No command is faster than `fastest`, m/s, and no envelope begins above it.

    Attributes:
        stop: how the last stop is going.
        failed: the strongest measure that a stop of this run needed so far; NONE if zeros were enough.
        blind: that stop was without odometry, so it is unknown whether the robot stood.
        drove: the vehicle was commanded at least once.

    """

    def __init__(self, fastest: float = inf) -> None:
        self._fastest = fastest
        self.stop = Stop.NONE
        self.failed = Stop.NONE
        self.blind = False
        self.drove = False
        # start of the present measure, s of the run, once there is one
        self._since: float
        # speed at that time, m/s
        self._v0: float
        # state of a vehicle that does not move
        self._rest: Stop
        # since when it has been still, or has moved, s of the run; inf while it has not
        self._still_since = self._moving_since = inf
        # when it first was faster than any command, s of the run
        self._raced = -inf

    def step(
        self, now: float, v: float | None, *, commanded: bool, armed: bool, connected: bool, fell: bool = False
    ) -> Stop:
        """Return how the stop is going at `now`, s of the run.

        Args:
            now: s of the run.
            v: measured speed, m/s; None if there was no recent measurement.
            commanded: outputs that move it are being sent.
            armed: the safety gate is open.
            connected: commands can be sent; while they cannot, the time of the measures stops.
            fell: v fell faster than a vehicle can brake, so a speed of 0 does not show that it stands.

        """
        self._look(now, v)
        self._rest = Stop.UNSEEN if fell else Stop.STANDING
        moves = now - self._moving_since >= MOVED - 1e-9
        if commanded:
            self.stop, self.drove = Stop.NONE, True
        elif self.stop is Stop.NONE:
            if self.drove:
                self._begin(Stop.SLOWING, now, v)
            elif self._is_still(now):
                self.stop = self._rest
        if self.stop in (Stop.SLOWING, *UNOBEYED):
            self._verify(now, v, connected)
        elif self.stop in (Stop.UNASKED, Stop.UNSEEN) and self._is_still(now):
            self.stop = self._rest
        elif self.stop is Stop.STANDING and (v is None or fell):
            self.stop = Stop.UNSEEN
        elif self.stop in (Stop.STANDING, Stop.NONE, Stop.UNSEEN) and not (armed or commanded) and moves:
            self.stop = Stop.UNASKED
        if self.stop not in (Stop.NONE, Stop.ESC_OFF) and self._races:
            self._escalate(Stop.ESC_OFF, now, v)
        return self.stop

    def stands(self, now: float) -> bool:
        """Whether it was seen to stand after its last motion, and still stands."""
        return self.stop is Stop.STANDING and self._is_still(now)

    def _look(self, now: float, v: float | None) -> None:
        speed = nan if v is None else abs(v)
        self._still_since = min(self._still_since, now) if speed <= STILL_SPEED else inf
        self._moving_since = min(self._moving_since, now) if speed > MOVES else inf
        racing = speed > self._fastest
        if racing and now - self._raced > RACED:
            self._raced = now
        self._races = racing and now - self._raced >= RACES - 1e-9

    def _is_still(self, now: float) -> bool:
        return now - self._still_since >= STANDS_AFTER - 1e-9

    def _begin(self, stop: Stop, now: float, v: float | None) -> None:
        self.stop, self._since = stop, now
        self._v0 = SPEED_MAX if v is None else min(abs(v), self._fastest)

    def _verify(self, now: float, v: float | None, connected: bool) -> None:
        t = now - self._since
        if self._is_still(now) and now >= self._since + STANDS_AFTER:
            self.stop = self._rest
            return
        if not connected and v is None:
            self._since = now
            return
        if v is not None and t <= DELAY:
            # it was still getting faster
            self._v0 = max(self._v0, min(abs(v), self._fastest))
        if t < MEASURE_TIME - 1e-9:
            return
        over = v is None or abs(v) > envelope(self._v0, t) + ENVELOPE_MARGIN
        lingers = v is not None and abs(v) > STILL_SPEED and t >= coasting_time(self._v0) + LINGERS
        if over or lingers:
            self._escalate(Stop.ESC_OFF if self.stop in UNOBEYED else Stop.PWM_ZEROS, now, v)

    def _escalate(self, measure: Stop, now: float, v: float | None) -> None:
        self.failed, self.blind = measure, v is None
        self._begin(measure, now, v)
