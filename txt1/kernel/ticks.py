"""A task's ticks: what its coroutine loops over.

Not compiled: `Ticks.__anext__` is a generator that serves as an awaitable, which only Python itself understands.
"""

from __future__ import annotations

import types
from collections.abc import Generator
from typing import Final

NEXT_TICK: Final = object()
"""What a task yields to whoever drives it when it waits for its next tick."""


class Ticks:
    """The cycles of one task: ``async for now in ticks``, with `now` in seconds since the run started.

    Attributes:
        period: seconds between two ticks; None for a task that runs on arrival.
        missed: cycles missed immediately before the present one.

    """

    def __init__(self, period: float | None) -> None:
        self.period = period
        self.missed = 0

    def __aiter__(self) -> Ticks:
        return self

    @types.coroutine
    def __anext__(self) -> Generator[object, float, float]:
        now = yield NEXT_TICK
        return now
