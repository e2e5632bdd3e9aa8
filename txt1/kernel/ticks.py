"""A task's ticks, over which its coroutine loops."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Final

# a task yields this to the scheduler when it waits for its next tick
NEXT_TICK: Final = object()


class Ticks:
    """The cycles of one task: ``async for now in ticks``, with `now` in seconds since the run started.

    They never end, so ``anext(ticks)`` takes no default.

    Attributes:
        period: seconds between two ticks; None for a task that runs on arrival.
        missed: cycles missed immediately before the present one.
        begins: the scheduler calls it with the time when a cycle begins; set where the task makes its coroutine.
        ends: likewise, when a cycle has ended.

    """

    def __init__(self, period: float | None) -> None:
        self.period = period
        self.missed = 0
        self.begins: Callable[[float], None] | None = None
        self.ends: Callable[[], None] | None = None

    def __aiter__(self) -> Ticks:
        return self

    def __anext__(self) -> Ticks:
        return self

    def __await__(self) -> Generator[object, float, float]:
        return (yield NEXT_TICK)
