"""Parts of the simulated sensors: readings from the true pose, random values, and times without readings."""

from collections.abc import Callable, Sequence
from math import inf
from random import Random
from typing import Generic, TypeVar

from txt1.errors import HalError
from txt1.sensors.base import Pose, Reading, Setup
from txt1.sim.parameters import Box
from txt1.sim.random_streams import random_stream
from txt1.telemetry.topics import Topic

T = TypeVar("T")
Others = Callable[[], Sequence[Pose | Box]]


class SimulatedSensor(Generic[T]):
    """A simulated sensor on a vehicle with the true pose `pose`; `see` makes at most a reading for each instant."""

    simulated = True

    def __init__(self, topic: Topic[T], period: float, pose: Callable[[], Pose | None]) -> None:
        self.topic, self.period, self._pose = topic, period, pose
        self._last = -inf

    async def open(self) -> None:
        """Prepare for a new run."""
        self._last = -inf

    async def close(self) -> None:
        """Do nothing; the sensor holds no resources."""

    def read(self, now: float) -> Reading[T] | None:
        """Return the reading at `now`; None if there is none."""
        pose = self._pose()
        if pose is None or now <= self._last:
            return None
        before, self._last = self._last, now
        return self.see(pose, now, before)

    def see(self, pose: Pose, now: float, before: float) -> Reading[T] | None:
        """Return the reading at `now` and at this pose; `before` is the time of the last call, -inf at the
        start of a run.
        """
        raise NotImplementedError


def others_of(setup: Setup) -> Others:
    """Return a function that returns the poses of the other vehicles in the world, and the boxes that move there."""
    others, movers = setup.hal.others, setup.hal.movers
    return (lambda: (*others(), *movers())) if setup.config.sim.movers else others


def true_pose(setup: Setup) -> Callable[[], Pose | None]:
    """Return a function that returns the true pose (m, rad); raises HalError unless the robot is simulated."""
    if setup.pose is None:
        raise HalError(
            f"sensors.{setup.name}: a simulated sensor sees from the true pose, which the HAL '{setup.config.hal}' "
            "does not know; use the driver of the real device"
        )
    return setup.pose


def random_of(setup: Setup) -> Random:
    """Return random values that the run's seed and the sensor's name repeat."""
    return random_stream(setup.config.own_seed, "sensor", setup.name)


class Absences:
    """The times at which a sensor sees nothing, given or random.

    Args:
        given: beginnings and ends, s of the run.
        every: mean time between two random absences, s; 0 is never.
        length: mean length of a random absence, s.
        rng: draws the random absences.

    """

    def __init__(self, given: tuple[tuple[float, float], ...], every: float, length: float, rng: Random) -> None:
        self._given, self._every, self._length, self._rng = given, every, length, rng
        self._begins = self._ends = inf
        if every:
            self._begins = rng.expovariate(1.0 / every)
            self._ends = self._begins + rng.expovariate(1.0 / length)

    def at(self, now: float) -> bool:
        """Return whether the sensor sees nothing now; `now` must not decrease."""
        while now >= self._ends:
            self._begins = self._ends + self._rng.expovariate(1.0 / self._every)
            self._ends = self._begins + self._rng.expovariate(1.0 / self._length)
        return self._begins <= now < self._ends or any(begin <= now < end for begin, end in self._given)
