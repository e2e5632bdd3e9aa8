"""The roll-over guard: limits the speed in curves, by a quasi-static model of a car that leans.

A car whose wheels stand W apart and whose centre of gravity is h high lifts its inner wheels where the force on it
points outside of them (T. D. Gillespie, *Fundamentals of Vehicle Dynamics*, SAE 1992, chapter 9):

    tan(abs(lean)) = W / (2 h),   lean = roll + atan(v omega / g)

Roll is positive with the left side up, and a left turn leans the car likewise, to the right. The roll is that of the
body, so it is the ground's and, on soft springs, `roll_gradient` v omega. The guard has to know the gradient before the
curve: seen by the IMU, it comes too late.

While the IMU is silent, the slope of the ground is unknown. Then the lateral acceleration is limited to that of a car
that crawls through its narrowest curve, the least limit on any ground.
"""

from collections.abc import Callable
from math import atan, exp, sqrt, tan
from typing import Final

from txt1.guards.roll_guard.settings import RollGuard
from txt1.model.kinematics import yaw_rate_max
from txt1.units import GRAVITY

# m/s, the least speed that is always allowed
CRAWL: Final = 0.1


def lean(roll: float, v: float, omega: float) -> float:
    """Return the angle between the force on the car and the car's upright, rad."""
    return roll + atan(v * omega / GRAVITY)


def tipping(track_width: float, gravity_height: float) -> float:
    """Return the lean at which the inner wheels lift, rad."""
    return atan(0.5 * track_width / gravity_height)


def sideways_max(largest: float, roll: float, gradient: float = 0.0) -> float:
    """Return the lateral acceleration, m/s^2, that reaches a lean with a roll to the bad side; 0 if the roll
    alone reaches it.

    With springs it is a little less, as atan(x) is replaced by x.
    """
    left = max(largest - roll, 0.0)
    return left / (gradient + 1.0 / GRAVITY) if gradient else GRAVITY * tan(left)


class Guard:
    """A guard of the safety gate: lowers speed and yaw rate together, so that the curve stays the same.

    Args:
        parameters: the guard's parameters.
        track_width: m.
        radius_min: m.
        measured: returns the present roll (rad) and lateral acceleration (m/s^2); the roll is None while it is unknown.
        tell: called with a line for the event log, and the time in s.

    """

    def __init__(
        self,
        parameters: RollGuard,
        track_width: float,
        radius_min: float,
        measured: Callable[[float], tuple[float | None, float]],
        tell: Callable[[float, str], None] = lambda now, text: None,
    ) -> None:
        self.parameters = parameters
        self._largest = atan(parameters.share * tan(tipping(track_width, parameters.gravity_height)))
        self._radius_min = radius_min
        self._measured, self._tell = measured, tell
        self._blind = CRAWL * yaw_rate_max(CRAWL, radius_min)
        self._told = False
        # largest recent roll, rad
        self._roll = 0.0
        self._time = 0.0

    def __call__(self, v: float, omega: float, now: float) -> tuple[float, float]:
        """Return the set-point that the ground allows."""
        roll, sideways = self._measured(now)
        fading = exp(-(now - self._time) / self.parameters.memory)
        self._time = now
        self._roll *= fading
        if roll is None:
            allowed = self._blind
        else:
            gradient = self.parameters.roll_gradient
            # the ground's alone
            self._roll = max(self._roll, abs(roll - gradient * sideways))
            allowed = sideways_max(self._largest, self._roll, gradient)
            self._told = False
        # the present motion counts, too: turning the wheels takes a while
        wanted = max(abs(v * omega), min(abs(sideways), abs(v) * yaw_rate_max(v, self._radius_min)))
        if wanted <= allowed:
            return v, omega
        if roll is None and not self._told:
            self._told = True
            self._tell(now, "slowed in curves: the IMU is silent, so the slope of the ground is unknown")
        share = min(max(sqrt(allowed / wanted), CRAWL / abs(v)), 1.0)
        return v * share, omega * share
