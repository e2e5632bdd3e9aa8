"""The interface of every learner: it sees light and odometry, and decides which action to take."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, sin
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

from txt1.learning.qtable import StoredTable
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["Agent", "Decision", "Doubter", "Learned", "Looker", "PeriodicAgent", "Readings", "Rows", "StoredTable"]

# learned numbers; all rows have one length
Rows = Sequence[Sequence[float]]


class Decision(NamedTuple):
    """The grounds of a learner's last decision, or its state when the episode ended."""

    # row of its table; None if the sensors tell no direction
    state: int | None
    # for the result of the last action; None if nothing was learned from it
    reward: float | None
    # of the actions in this state, after learning
    values: tuple[float, ...]


class Learned(NamedTuple):
    """The rows that a learner has learned, for the others of its fleet."""

    # its name; rows of a learner with another name are not taken over
    learner: str
    # number of episodes in which it has learned
    episodes: int
    # for each row, how often it was updated; 0: unknown
    visits: tuple[int, ...]
    # of equal length
    rows: tuple[tuple[float, ...], ...]


class Agent(Protocol):
    """A learner. It knows no clock, no vehicle and no asyncio: a trial (`txt1.learning.trial`) calls it.

    An episode begins with `begin`; `see` then brings every sample of the light. Once the learner is `ready`, `waits` is
    called 20 times a second, and `act` follows when it is false. The episode ends with `end`, or with `void` if it does
    not count.
    """

    @property
    def name(self) -> str:
        """The name by which a user chooses it."""

    def begin(self) -> None:
        """An episode begins: the robot rests on its start pose, and earlier samples count no more."""

    def see(self, readings: Readings, odometry: Odometry) -> None:
        """Take one sample of the four light sensors, lux, every 16 ms; LightFault: a sensor cannot be believed."""

    @property
    def ready(self) -> bool:
        """Whether it has seen enough to act."""

    def waits(self, now: float, odometry: Odometry) -> bool:
        """Whether the action in force goes on, at `now` s."""

    def act(self, now: float, odometry: Odometry) -> int:
        """Learn from the result of the last action, and return the index of the next."""

    def end(self, success: bool, odometry: Odometry) -> None:
        """The episode is over: the robot has reached the light, or left the boundary."""

    def decision(self, odometry: Odometry) -> Decision:
        """Return the grounds of the last `act` or `end`, for recordings and screens."""

    def void(self) -> None:
        """The episode does not count: forget what was learned in it."""

    def table(self) -> StoredTable:
        """Return the table learned so far, as it goes into a file."""

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later, JSON values only; `recall` takes it."""

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from the result of `memory`."""


@runtime_checkable
class Doubter(Protocol):
    """A learner that reports when its observations contradict its model, and drives on."""

    @property
    def unfit(self) -> str:
        """The part that its model does not fit, once reported in this episode; "" before."""


@runtime_checkable
class Looker(Protocol):
    """A learner that drives round what a laser scanner sees."""

    def look(self, points: NDArray[np.float64], odometry: Odometry) -> None:
        """Take the places where a sweep's beams ended, in the robot's frame of that moment, shape (n, 2), m."""


class PeriodicAgent:
    """Base of a learner that decides once in a `period`, s, by all samples since the last decision.

    A learner that calls its `begin` has `memory` and `recall`: a void episode leaves nothing behind.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._rest()

    def begin(self) -> None:
        """An episode begins."""
        self._before: Any = self.memory()  # type: ignore[attr-defined]
        self._rest()

    def void(self) -> None:
        """Forget what was learned since `begin`."""
        self.recall(self._before)  # type: ignore[attr-defined]

    def see(self, readings: Readings, odometry: Odometry) -> None:
        """One sample of the light, lux."""
        self._samples.append(readings)

    @property
    def ready(self) -> bool:
        """Whether it has seen a sample."""
        return len(self._samples) > 5

    def waits(self, now: float, odometry: Odometry) -> bool:
        """Whether the action in force goes on."""
        return now < self._due - 1e-9

    def _rest(self) -> None:
        """Reset: no action is in force, and no sample has been seen."""
        self._samples: list[Readings] = []
        self._due = -inf
        # at the last decision
        self._at: Odometry | None = None

    def _decides(self, now: float) -> None:
        """Note a decision at `now` s; its action is in force for a period."""
        self._due = now + self._period

    def _moved(self, odometry: Odometry) -> tuple[float, float]:
        """Return the way, m, and the turn, rad, since the last call in this episode; 0, 0 in the first."""
        at, self._at = self._at or odometry, odometry
        turn = wrap_angle(odometry.theta - at.theta)
        middle = at.theta + 0.5 * turn
        return cos(middle) * (odometry.x - at.x) + sin(middle) * (odometry.y - at.y), turn

    def _seen(self) -> NDArray[np.float64]:
        """Return the samples since the last decision, lux, shape (samples, 4), and forget them."""
        import numpy as np

        samples, self._samples = self._samples, []
        return np.array(samples).reshape(-1, 4)
