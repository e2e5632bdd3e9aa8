"""Parts of the simulated sensors: the true pose, random values of their own, and times without readings."""

from collections.abc import Callable

from numpy.random import Generator, SeedSequence, default_rng

from txt1.errors import HalError
from txt1.sensors.base import Pose, Setup

STREAM = 7  # marks the random values of simulated sensors


def true_pose(setup: Setup) -> Callable[[], Pose | None]:
    """The function that returns the true pose (m, rad); HalError where the robot is not simulated."""
    if setup.pose is None:
        raise HalError(
            f"sensors.{setup.name}: a simulated sensor sees from the true pose, which the HAL '{setup.config.hal}' "
            "does not know; use the driver of the real device"
        )
    return setup.pose


def random_of(setup: Setup) -> Generator:
    """Random values that the run's seed and the sensor's name repeat."""
    return default_rng(SeedSequence([setup.config.own_seed, STREAM, *setup.name.encode()]))


class Absences:
    """When a sensor sees nothing: at given times, and now and then.

    Args:
        given: from and to, s of the run.
        every: mean time between two others, s; 0 is never.
        length: their mean length, s.
        rng: draws them.

    """

    def __init__(self, given: tuple[tuple[float, float], ...], every: float, length: float, rng: Generator) -> None:
        self._given, self._every, self._length, self._rng = given, every, length, rng
        self._begins = float(rng.exponential(every)) if every else float("inf")
        self._ends = self._begins + (float(rng.exponential(length)) if every else 0.0)

    def at(self, now: float) -> bool:
        """Whether there is one now; times only go forward."""
        while now >= self._ends and self._every:
            self._begins = self._ends + float(self._rng.exponential(self._every))
            self._ends = self._begins + float(self._rng.exponential(self._length))
        return self._begins <= now < self._ends or any(begin <= now < end for begin, end in self._given)
