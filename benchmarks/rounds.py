"""Interleaved rounds, their medians, and plain tables: what all the benchmarks share.

A single figure says little on a machine that does other things too. Contestants take turns, so that a slow minute
hits all of them alike, and what is quoted is the median over the rounds with the smallest and the largest beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import TypeVar

from rigs import page_parts

T = TypeVar("T")


def interleave(rounds: int, contestants: Mapping[str, Callable[[], T]]) -> dict[str, list[T]]:
    """Every contestant's results, round by round; all of them take their turn in each round."""
    results: dict[str, list[T]] = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, contestant in contestants.items():
            results[name].append(contestant())
    return results


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Median, smallest and largest, as text."""
    return f"{median(values):.{digits}f} ({min(values):.{digits}f} .. {max(values):.{digits}f})"


def verdict(met: bool) -> str:
    """A limit is met or missed."""
    return "met" if met else "MISSED"


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table: the first column flush left, the others flush right."""
    widths = [max(len(row[column]) for row in (header, *rows)) for column in range(len(header))]
    print(f"\n{title}\n")
    for row in (header, ["-" * width for width in widths], *rows):
        first, *others = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        print("  ".join(("", row[0].ljust(len(first)), *others)).rstrip(), flush=True)


def write(page: Path, name: str, header: Sequence[str], rows: Sequence[Sequence[str]], text: str) -> None:
    """Put a table and a text into a page, between the marks that it has for this benchmark."""
    lines = [header, ["---", *("--:" for _ in header[1:])], *rows]
    drawn = "\n".join(f"| {' | '.join(each)} |" for each in lines)
    page_parts.write(page, name, f"{drawn}\n\n{text}", f"benchmarks.{name}")
