"""The roll-over guard: how fast a curve may be taken, by a quasi-static model of a car that leans.

A car whose wheels stand W apart and whose centre of gravity is h high lifts its inner wheels where the force on it
points outside of them (T. D. Gillespie, *Fundamentals of Vehicle Dynamics*, SAE 1992, chapter 9):

    tan(abs(lean)) = W / (2 h),   lean = roll + atan(v omega / g)

Roll is positive with the left side up, and a left turn leans the car likewise, to the right.
"""

from collections.abc import Callable
from math import atan, exp, sqrt, tan
from typing import Final

from txt1.guards.roll_guard.settings import RollGuard
from txt1.model.kinematics import yaw_rate_max

GRAVITY: Final = 9.80665  # m/s^2
CRAWL: Final = 0.1  # m/s, the least speed that is left


def lean(roll: float, v: float, omega: float) -> float:
    """How far the force on the car leans from its upright, rad."""
    return roll + atan(v * omega / GRAVITY)


def tipping(track_width: float, gravity_height: float) -> float:
    """The lean at which the inner wheels lift, rad."""
    return atan(0.5 * track_width / gravity_height)


def sideways_max(largest: float, roll: float) -> float:
    """The lateral acceleration, m/s^2, that with a roll to the bad side comes to a lean; 0 where the roll is enough."""
    return GRAVITY * tan(max(largest - roll, 0.0))


class Guard:
    """A guard of the safety gate: lowers speed and yaw rate together, so that the curve stays the same.

    Args:
        parameters: of the guard.
        track_width: m.
        radius_min: m.
        measured: returns roll (rad) and lateral acceleration (m/s^2) now; None while nobody measures them.

    """

    def __init__(
        self,
        parameters: RollGuard,
        track_width: float,
        radius_min: float,
        measured: Callable[[float], tuple[float, float] | None],
    ) -> None:
        self.parameters = parameters
        self._largest = atan(parameters.share * tan(tipping(track_width, parameters.gravity_height)))
        self._radius_min = radius_min
        self._measured = measured
        self._roll = 0.0  # the largest of late, rad
        self._time = 0.0

    def __call__(self, v: float, omega: float, now: float) -> tuple[float, float]:
        """The set-point that the ground allows."""
        measured = self._measured(now)
        fading = exp(-(now - self._time) / self.parameters.memory)
        self._time = now
        self._roll *= fading
        if measured is None:
            return v, omega
        roll, sideways = measured
        self._roll = max(self._roll, abs(roll))
        allowed = sideways_max(self._largest, self._roll)
        # what it does now counts, too: the wheels take a while to turn
        wanted = max(abs(v * omega), min(abs(sideways), abs(v) * yaw_rate_max(v, self._radius_min)))
        if wanted <= allowed:
            return v, omega
        share = min(max(sqrt(allowed / wanted), CRAWL / abs(v)), 1.0)
        return v * share, omega * share
