"""The runner of many trials: of a learner, a sweep, an experiment, calibrated cars, a campaign of faults.

A command says which trials are missing, by keys of its own; `run` does them here or elsewhere, hands each result to
`keep` as it comes, and draws a bar. A signal ends it: what was kept stays, and the same command carries on.
`Rows` keeps results in a file of JSON lines.
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
from txt1.trials.workers import Work, Workers

# rich takes its time
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
    """Do trials, and hand the result of each to `keep` with its key; the exit code: 0, or 128 + the signal that came.

    Args:
        work: a trial, a function of a module, from JSON values to JSON values.
        trials: what each is told, by its key.
        workers: where they are done; None: one after the other in this very process, with values of any kind.
        keep: told each result as it comes.
        bar: names a bar on a terminal; none when empty.
        until: asked all the time; once it says yes no more trials are begun.

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
    """Results in a file, a line of JSON each, added as they come."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def read(self) -> list[Any]:
        """The rows; a line that was being written when all ended is left out, and told."""
        found = []
        lines = self.file.read_text(encoding="utf-8").splitlines() if self.file.exists() else []
        for number, line in enumerate(lines, 1):
            try:
                found.append(json.loads(line))
            except ValueError:
                say(f"{self.file}: line {number} is cut off or damaged; its trial is done again")
        return found

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
    """Within the block there is a bar on standard error, its task the only one; none without a name or a terminal.

    A thread of its own draws it: no robot waits for a terminal. `columns` are after the bar, else counts and times.
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
