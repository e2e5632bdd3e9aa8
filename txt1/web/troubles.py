"""What goes wrong with requests of others is counted, and told in few lines: a stranger fills no log."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

# asyncio logs what a callback or a task raises
LOGGERS: Final = ("aiohttp", "asyncio")
# characters of what is told
TOLD_CHARACTERS: Final = 120


class Troubles(logging.Handler):
    """Counts all that libraries log, and tells of the first, the 10th, the 100th and so on in one line."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        super().__init__(logging.WARNING)
        self.count = 0
        self._tell, self._due = tell, 1

    def emit(self, record: logging.LogRecord) -> None:
        """Count what a library logs."""
        error = record.exc_info[1] if record.exc_info else None
        self.note(record.getMessage() if error is None else f"{type(error).__name__}: {error}")

    def note(self, what: str) -> None:
        """Count a trouble."""
        self.count += 1
        if self.count >= self._due:
            self._due *= 10
            last = " ".join(what.split())[:TOLD_CHARACTERS]
            # whatever a stranger made of it
            last = "".join(letter if letter.isprintable() else "?" for letter in last)
            self._tell(f"requests that the page's server could not answer: {self.count}; the last: {last}")


@contextmanager
def counting(tell: Callable[[str], None]) -> Iterator[Troubles]:
    """Count instead of printing, until the block is left."""
    troubles = Troubles(tell)
    loggers = [logging.getLogger(name) for name in LOGGERS]
    kept = [each.propagate for each in loggers]
    for each in loggers:
        each.addHandler(troubles)
        each.propagate = False
    try:
        yield troubles
    finally:
        for each, propagate in zip(loggers, kept, strict=True):
            each.removeHandler(troubles)
            each.propagate = propagate
