"""A learner of another package, made to tell by its name what it does wrong."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from operator import index
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from txt1.errors import Txt1Error
from txt1.learning.agent import Agent, Decision, Rows, Sharer
from txt1.learning.learned import Learned
from txt1.learning.qtable import StoredTable
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry

T = TypeVar("T")
METHODS: Final = [name for name in vars(Agent) if not name.startswith("_")]


def checked(agent: Agent, who: str, actions: int) -> Agent:
    """Return the learner, its errors told with `who` made it, and what it returns looked at; Txt1Error: it is none."""
    there = dir(agent)
    if missing := [name for name in METHODS if name not in there]:
        raise Txt1Error(f"{who} is no txt1.learning.agent.Agent: {type(agent).__name__} has no {', '.join(missing)}")
    return (CheckedSharer if isinstance(agent, Sharer) else Checked)(agent, who, actions)


class Checked:
    """An `Agent` that asks another, which may fail."""

    def __init__(self, agent: Any, who: str, actions: int) -> None:
        self._agent, self._who, self._actions = agent, who, actions

    @contextmanager
    def _in(self, method: str) -> Iterator[None]:
        try:
            yield
        except Txt1Error:
            raise
        except Exception as error:
            told = " ".join(f"{type(error).__name__}: {error}".split())
            raise Txt1Error(f"{self._who} failed in {method}: {told}") from error

    def _of(self, kind: type[T], method: str, value: object) -> T:
        if not isinstance(value, kind):
            raise Txt1Error(f"{self._who}: {method} returned {value!r}; return a {kind.__name__}")
        return value

    @property
    def name(self) -> str:
        """The name it is asked for by."""
        with self._in("name"):
            return self._of(str, "name", self._agent.name)

    def begin(self) -> None:
        """An episode begins."""
        with self._in("begin"):
            self._agent.begin()

    def see(self, readings: Readings, odometry: Odometry) -> None:
        """One sample of the light."""
        with self._in("see"):
            self._agent.see(readings, odometry)

    @property
    def ready(self) -> bool:
        """Whether it has seen enough to act."""
        with self._in("ready"):
            return bool(self._agent.ready)

    def waits(self, now: float, odometry: Odometry) -> bool:
        """Whether the action in force goes on."""
        with self._in("waits"):
            return bool(self._agent.waits(now, odometry))

    def act(self, now: float, odometry: Odometry) -> int:
        """The index of the next action."""
        with self._in("act"):
            action = index(self._agent.act(now, odometry))
        if not 0 <= action < self._actions:
            raise Txt1Error(f"{self._who}: act returned {action}; return 0 to {self._actions - 1}")
        return action

    def end(self, success: bool, odometry: Odometry) -> None:
        """The episode is over."""
        with self._in("end"):
            self._agent.end(success, odometry)

    def decision(self, odometry: Odometry) -> Decision:
        """Return the grounds of the last decision."""
        with self._in("decision"):
            state, reward, values = self._agent.decision(odometry)
            return Decision(
                None if state is None else index(state), None if reward is None else float(reward),
                tuple(map(float, values)),
            )  # fmt: skip

    def void(self) -> None:
        """The episode does not count."""
        with self._in("void"):
            self._agent.void()

    def table(self) -> StoredTable:
        """Return the table learned so far."""
        with self._in("table"):
            return self._of(StoredTable, "table", self._agent.table())

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later."""
        with self._in("memory"):
            return self._of(dict, "memory", self._agent.memory())

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from what `memory` gave."""
        with self._in("recall"):
            self._agent.recall(memory)


class CheckedSharer(Checked):
    """One that can learn together with others."""

    def shared(self) -> Learned:
        """Return its rows."""
        with self._in("shared"):
            return self._of(Learned, "shared", self._agent.shared())

    def take(self, rows: Rows, taken: NDArray[np.bool_], episodes: int) -> int:
        """Take over rows of all."""
        with self._in("take"):
            return index(self._agent.take(rows, taken, episodes))
