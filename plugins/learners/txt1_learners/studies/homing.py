"""A plain homing rule, which learns nothing: steer towards the sum of the readings.

It is told where its sensors sit and what its actions do. Ten times a second it filters the four readings (5.10), makes
the thesis's weighted sum of them, and takes the action that turns to the side of this direction, or the straightest
action when the direction is within `AHEAD` of straight ahead.
"""

from math import pi
from typing import Any, Final

import numpy as np

from txt1 import Odometry
from txt1.config import Config
from txt1.errors import NoDirection
from txt1.learning.agent import Decision, PeriodicAgent, Readings, StoredTable
from txt1.learning.light_direction import LightFilter, direction, spread_limit
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import Commands

DECISION_PERIOD: Final = 0.1  # s between two decisions
AHEAD: Final = pi / 18.0  # rad: a direction within this is straight ahead; not tuned


def create(config: Config, rng: np.random.Generator) -> "Homing":
    """Return the rule for the configured actions and light; it needs no random values."""
    del rng
    return Homing(config.section(LearningConfig).actions, float(config.sim.light.exponent))


class Homing(PeriodicAgent):
    """The rule; see the module."""

    name = "homing"

    def __init__(self, commands: Commands, exponent: float = 2.0) -> None:
        super().__init__(DECISION_PERIOD)
        rates = [omega for _, omega in commands]
        self._right, self._left = rates.index(min(rates)), rates.index(max(rates))
        self._straight = min(range(len(rates)), key=lambda a: abs(rates[a]))
        self._filter = LightFilter(spread_limit(exponent))
        self._a = self._straight

    def begin(self) -> None:
        """An episode begins."""
        self._rest()
        self._filter.clear()
        self._a = self._straight

    def see(self, readings: Readings, odometry: Odometry) -> None:
        """One sample of the light, lux."""
        del odometry
        self._filter.step(readings)

    @property
    def ready(self) -> bool:
        """Whether the filter has settled."""
        return self._filter.settled

    def act(self, now: float, odometry: Odometry) -> int:
        """Return the action that turns towards the light; the one in force where no direction is known."""
        del odometry
        self._decides(now)
        readings = self._filter.readings
        assert readings is not None
        try:
            towards = direction(readings)
        except NoDirection:
            return self._a
        self._a = self._straight if abs(towards) <= AHEAD else self._left if towards > 0.0 else self._right
        return self._a

    def end(self, success: bool, odometry: Odometry) -> None:
        """Nothing is learned."""

    def void(self) -> None:
        """Nothing is learned."""

    def decision(self, odometry: Odometry) -> Decision:
        """No state of a table, no reward, no values."""
        del odometry
        return Decision(None, None, ())

    def table(self) -> StoredTable:
        """A table of nothing."""
        return StoredTable(np.zeros((1, 1)), {"agent": self.name})

    def memory(self) -> dict[str, Any]:
        """Nothing is kept."""
        return {}

    def recall(self, memory: dict[str, Any]) -> None:
        """Nothing is kept."""
