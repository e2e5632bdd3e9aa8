"""Runs many trials: of a learner, a sweep, an experiment, calibrated cars, a campaign of faults.

A command lists the missing trials, by its own keys. `run` does them here or elsewhere, passes each result to `keep` as
it comes, and draws a bar. A signal ends it. Results that were kept stay, and the same command resumes. `Rows` keeps
results in a file of JSON lines.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from os import SEEK_END
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from txt1.commands import OK, say, signals_to
from txt1.errors import ConfigError
from txt1.trials.workers import Work, Workers

# rich takes time to load
if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

K = TypeVar("K")


def run(
    work: Work,
    trials: Mapping[K, Any],
    workers: Workers | None,
    keep: Callable[[K, Any], object],
    *,
    bar: str = "",
    until: Callable[[], bool] = lambda: False,
) -> int:
    """Do trials, and pass the result of each to `keep` with its key; return the exit code: 0, or 128 + the signal.

    Args:
        work: a trial, a function of a module, from JSON values to JSON values.
        trials: the argument of each trial, by its key.
        workers: the processes or cluster; None: one after the other in this process, with values of any kind.
        keep: called with each key and result as it comes.
        bar: names a bar on a terminal; none when empty.
        until: asked again and again; once it returns True, no more trials are begun.

    Raises an error of a trial, and as `Workers.each`.
    """
    came: list[int] = []

    def ended() -> bool:
        return bool(came) or until()

    results = _in_turn(work, trials, ended) if workers is None else workers.each(work, trials, ended)
    with signals_to(lambda number, _: came.append(number)), progress(bar, len(trials)) as shown:
        for key, result in results:
            keep(key, result)
            shown.advance(shown.task_ids[0])
    return 128 + came[0] if came else OK


def _in_turn(work: Work, trials: Mapping[K, Any], ended: Callable[[], bool]) -> Iterator[tuple[K, Any]]:
    for key, told in trials.items():
        if ended():
            return
        yield key, work(told)


class Rows:
    """Results in a file, a line of JSON for each, added as they come."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def read(self) -> list[Any]:
        """Return the rows. A line that was cut off at the end of a run is left out, and reported.

        Raises ConfigError: the file is no text.
        """
        found = []
        try:
            lines = self.file.read_text(encoding="utf-8").splitlines() if self.file.exists() else []
        except UnicodeDecodeError:
            raise ConfigError(f"{self.file}: is no text; give another file") from None
        for number, line in enumerate(lines, 1):
            try:
                found.append(json.loads(line))
            except ValueError:
                say(f"{self.file}: line {number} is cut off or damaged; its trial is done again")
        return found

    def headed(self, *keys: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        """Return the first row, empty without one, and the others; ConfigError: one of them lacks one of the keys."""
        first, *others = self.read() or [{}]
        if not isinstance(first, dict) or not all(isinstance(one, dict) and one.keys() >= {*keys} for one in others):
            raise ConfigError(f"{self.file}: holds rows of something else; give another file")
        return first, others

    def add(self, row: Any) -> None:
        """Add a row, on a line of its own."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        with self.file.open("ab+") as file:
            if file.tell():
                file.seek(-1, SEEK_END)
            cut_off = file.read() not in (b"", b"\n")
            file.write(b"\n" * cut_off + json.dumps(row, separators=(",", ":")).encode() + b"\n")


@contextmanager
def progress(name: str, total: float, *columns: ProgressColumn) -> Iterator[Progress]:
    """Show a bar on standard error for the block, with a single task; no bar without a name or a terminal.

    A thread of its own draws it, so no robot waits for a terminal. `columns` follow the bar, by default counts and
    times.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    shown = bool(name) and sys.stderr.isatty()
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *(columns or (MofNCompleteColumn(), TimeRemainingColumn())),
        console=Console(stderr=True),
        transient=True,
        disable=not shown,
        refresh_per_second=4,
    ) as drawn:
        drawn.add_task(name, total=total)
        yield drawn
