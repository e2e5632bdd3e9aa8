"""Runs of many seeds that may be ended and gone on with: every result is kept in a file as soon as it is there."""

import json
from argparse import ArgumentParser
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any, TypeVar

from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.trials.run import progress

Case = TypeVar("Case")
Result = TypeVar("Result")


def arguments(parser: ArgumentParser, kept: str, seeds: int) -> None:
    """Add the arguments that all of them have; `kept` is the usual file."""
    parser.add_argument("--seeds", type=int, default=seeds, help="how many; default: %(default)s")
    parser.add_argument("--kept", type=Path, default=Path(kept), help="results so far; default: %(default)s")
    parser.add_argument("--first", type=int, default=1, help="the first; default: %(default)s")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="time after which no new run is begun")


def results(kept: Path, cases: Iterable[str], run: Callable[[str], Any], minutes: float) -> dict[str, Any]:
    """The results of all cases by name, those in the file taken from there; without those that time was too short for.

    A result is of JSON's types. The file is of the code that made it: delete it when that has changed.
    """
    began = stopwatch_ns()
    kept.parent.mkdir(parents=True, exist_ok=True)
    lines = kept.read_text().splitlines() if kept.exists() else []
    done: dict[str, Any] = dict(json.loads(line) for line in lines)
    wanted = list(cases)
    with kept.open("a") as file:
        for case in wanted:
            if case in done:
                continue
            if stopwatch_ns() - began > minutes * 60 * NS_PER_S:
                break
            done[case] = run(case)
            print(json.dumps((case, done[case])), file=file, flush=True)
    return {case: done[case] for case in wanted if case in done}


def each(
    cases: Collection[Case], text: str, run: Callable[[Case], Result], show: Callable[[list[Result]], None]
) -> None:
    """Run all cases with a bar, and show their results; after Ctrl-C the results so far."""
    found: list[Result] = []
    try:
        with progress(text, len(cases)) as bar:
            for case in cases:
                found.append(run(case))
                bar.advance(bar.task_ids[0])
    finally:
        if found:
            show(found)
