"""``python -m docs.figures``: which figures of README and the benchmarks' page are older than what they measure.

A row of their tables ends with the command that measured it, and the commit and the day of that version. The parts of
the program that a command measures are listed here. A row is older if one of them has changed since.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
PAGES: Final = ("README.md", "docs/results/benchmarks.md")
MEASURED: Final = re.compile(r"`((?:python -m|make) [^`]+)`, ([0-9a-f]{7,40}), (\d{4}-\d\d-\d\d)$")
"""The last cell of a row."""
SPINE: Final = ("txt1/kernel", "txt1/tasks", "txt1/control", "txt1/telemetry", "txt1/hal/sim.py", "txt1/runtime.py")
SIMULATION: Final = (*SPINE, "txt1/sim", "txt1/model")
# many robots in step, whose clock, tasks and hardware layer are not the robot's
LOCKSTEP: Final = ("txt1/sim/batch.py", "txt1/sim/dynamics.py", "txt1/sim/machine_code.py", "txt1/learning/batch.py")
REAL_TIME: Final = (*SPINE, "txt1/record", "txt1/sidecar.py", "txt1/ui")
PARTS: Final[Mapping[str, tuple[str, ...]]] = {
    "make bench": SIMULATION,
    "python -m benchmarks simulation_speed": SIMULATION,
    "python -m benchmarks robots": SIMULATION,
    "python -m benchmarks recording": (*SIMULATION, "txt1/record"),
    "python -m benchmarks.punctuality": REAL_TIME,
    "python -m benchmarks.learning_steps": (*LOCKSTEP, "txt1/learning/env.py", "txt1/learning/drive_tasks.py"),
    "python -m benchmarks learning_time": (*SIMULATION, "txt1/learning"),
    "python -m docs.thesis_readings": (*LOCKSTEP, "txt1/learning/thesis.py", "txt1/learning/light_direction.py"),
    "python -m txt1_learners.studies": ("plugins/learners/txt1_learners/pilot.py",),
}
"""What each command measures; a row's command may go on with options."""


class Figure(NamedTuple):
    """A row of a table."""

    page: str
    name: str
    """Its first cell."""
    command: str
    commit: str
    day: str


def tables(text: str) -> Iterator[list[list[str]]]:
    """Yield each table of a page that has a last column 'measured': its rows, as cells."""
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        head, _, *rows = ([cell.strip() for cell in line.strip().strip("|").split(" |")] for line in block.splitlines())
        if head[-1] == "measured":
            yield list(rows)


def figures(page: str) -> list[Figure]:
    """Return the figures of a page; raises ValueError: a row does not say how it was measured."""
    found = []
    for name, *_, measured in (row for rows in tables((ROOT / page).read_text(encoding="utf-8")) for row in rows):
        told = MEASURED.fullmatch(measured)
        if told is None or parts_of(told[1]) is None:
            raise ValueError(
                f"{page}: {name}: {measured!r} is no `command`, commit, day; the commands are in {__file__}"
            )
        found.append(Figure(page, name, *told.groups()))
    return found


def parts_of(command: str) -> tuple[str, ...] | None:
    """Return what a command measures, None if it is not known."""
    known = [each for each in PARTS if command == each or command.startswith(f"{each} ")]
    return PARTS[max(known, key=len)] if known else None


def changed(figure: Figure) -> str:
    """Return the last change of what a figure measures since it was measured, "" for none."""
    parts = parts_of(figure.command) or ()
    words = ["git", "log", "-1", "--format=%h of %as: %s", f"{figure.commit}..HEAD", "--", *parts]
    done = subprocess.run(words, cwd=ROOT, check=True, capture_output=True, text=True)  # noqa: S603 - our own words
    return done.stdout.strip()


def main() -> int:
    """Print the figures that are older, each with the change; the exit code is 1 if there are any."""
    older = [(each, change) for page in PAGES for each in figures(page) if (change := changed(each))]
    for figure, change in older:
        print(f"{figure.page}: {figure.name}\n  {figure.command}, {figure.commit} of {figure.day}; since then {change}")
    print(f"{len(older)} figures are older than what they measure" if older else "no figure is older than its program")
    return 1 if older else 0


if __name__ == "__main__":
    sys.exit(main())
