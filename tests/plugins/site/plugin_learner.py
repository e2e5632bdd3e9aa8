"""A learner that learns nothing: it guesses twice a second."""

from __future__ import annotations

from typing import Any

import numpy as np

from txt1 import Odometry
from txt1.config import Config
from txt1.learning.agent import Decision, Readings, StoredTable


class Guesser:
    name = "guesser"

    def __init__(self, config: Config, rng: np.random.Generator, stored: StoredTable | None) -> None:
        self._rng = rng
        self._values = np.zeros((1, 3)) if stored is None else stored.values
        self._seen = 0
        self._due = 0.0

    def begin(self) -> None:
        self._seen, self._due = 0, 0.0

    def see(self, readings: Readings, odometry: Odometry) -> None:
        self._seen += 1

    @property
    def ready(self) -> bool:
        return self._seen > 10

    def waits(self, now: float, odometry: Odometry) -> bool:
        return now < self._due

    def act(self, now: float, odometry: Odometry) -> int:
        self._due = now + 0.5
        return int(self._rng.integers(3))

    def end(self, success: bool, odometry: Odometry) -> None: ...

    def decision(self, odometry: Odometry) -> Decision:
        return Decision(0, None, (0.0, 0.0, 0.0))

    def void(self) -> None: ...

    def table(self) -> StoredTable:
        return StoredTable(self._values, {"agent": self.name})

    def memory(self) -> dict[str, Any]:
        return {}

    def recall(self, memory: dict[str, Any]) -> None: ...


create = Guesser
