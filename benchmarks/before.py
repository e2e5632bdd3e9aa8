"""``python -m benchmarks.before OLD [NEW]``: what has become slower, later, larger, or missed, in turns; five minutes.

OLD and NEW are each a source tree, or the Python of an environment that has txt1 installed, such as the compiled
wheel; NEW is this tree if it is left out. Simulations as fast as the processor goes come first, then the start of the
command and the memory of a recorded run, then a recorded robot in real time: how late its controller is, how many
cycles it misses, and its processor time. The exit code is 1 if a limit is missed. `make bench-before` compares this
tree with the last release.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple

from benchmarks.rounds import interleave, spread, table, verdict

SPEED: Final = 0.95
"""Old over new wall time of a simulation, at least."""
START: Final = 1.03
"""New over old processor time of a start, at most."""
MEMORY: Final = 1.05
"""New over old memory, at most."""
PROCESSOR: Final = 1.1
"""New over old processor time in real time, at most."""
MEDIAN: Final = 2.0
"""New over the latest old median of a lateness, at most: medians hardly vary."""

CIRCLE: Final = ("--drive", "0.5,0.5", "--set", "sim.room.length=.inf", "--set", "sim.room.width=.inf")
LOG: Final = ("--log", "recording")
CASES: Final[dict[str, tuple[str, ...]]] = {"idle": (), "driving": CIRCLE, "recorded": (*CIRCLE, *LOG)}
REAL: Final = "real time"


class Run(NamedTuple):
    """A run: what it tells in JSON; its processor time, s; its largest memory, MB."""

    told: dict[str, Any]
    processor: float
    memory: float

    @property
    def wall(self) -> float:
        """Wall time of the simulation, s."""
        return float(self.told["wall_time_s"])

    @property
    def misses(self) -> int:
        """Cycles that the controller missed."""
        return int(self.told["tasks"]["controller"]["misses"])

    def late(self, percentile: str) -> float:
        """Lateness of the controller's start, us."""
        return 1e6 * float(self.told["tasks"]["controller"]["lateness_s"][percentile])

    @property
    def waits(self) -> float:
        """Median lateness, us, of the task that is latest: it waits for all that have to run before."""
        return 1e6 * max(float(task["lateness_s"]["p50"]) for task in self.told["tasks"].values())


class Row(NamedTuple):
    """A quantity of both, in rounds, and whether its limit is met."""

    name: str
    old: Sequence[float]
    new: Sequence[float]
    limit: str
    met: bool

    @property
    def ratio(self) -> float:
        """New over old, the median over the rounds."""
        return median(new / old if old else 1.0 + new for old, new in zip(self.old, self.new, strict=True))


def main() -> int:
    """Run both in turns and print what became of it."""
    parser = argparse.ArgumentParser(prog="benchmarks.before", description=__doc__)
    parser.add_argument("old", type=Path, metavar="OLD")
    parser.add_argument("new", type=Path, metavar="NEW", nargs="?", default=Path(__file__).parents[1])
    parser.add_argument("--rounds", type=int, default=8, metavar="N")
    parser.add_argument("--duration", type=float, default=1000.0, metavar="S", help="simulated seconds in a run")
    parser.add_argument("--cases", default=",".join((*CASES, REAL)), metavar="NAMES", help="default: %(default)s")
    parser.add_argument("--real", type=float, default=9.0, metavar="S", help="seconds of a round in real time")
    given = parser.parse_args()
    print(f"{given.rounds} rounds of each in turns, load {os.getloadavg()[0]:.2f}")
    trees = {"old": given.old, "new": given.new}
    rows: list[Row] = []
    for case in given.cases.split(","):
        rows += in_real_time(trees, given) if case == REAL else simulated(trees, case, given)
    if missed := [row.name for row in rows if not row.met]:
        print(f"\nMISSED: {', '.join(missed)}")
    return 1 if missed else 0


def simulated(trees: Mapping[str, Path], case: str, given: argparse.Namespace) -> list[Row]:
    """Compare simulations of a case; the idle case with the start, the recorded case with the memory."""
    words = ("--speed", "max", "--duration", str(given.duration), *CASES[case])
    found = in_turns(trees, words, given.rounds)
    rows = [at_most(f"{case}: wall time, s", found, lambda run: run.wall, 1.0 / SPEED)]
    if case == "idle":
        starts = in_turns(trees, ("--speed", "max", "--duration", "1"), given.rounds)
        rows.append(at_most("start: processor time, s", starts, lambda run: run.processor, START))
    if case == "recorded":
        rows.append(at_most("recorded: memory, MB", found, lambda run: run.memory, MEMORY))
    return shown(f"As fast as the processor goes, {case}, {given.duration:.0f} s", rows)


def in_real_time(trees: Mapping[str, Path], given: argparse.Namespace) -> list[Row]:
    """Compare a recorded robot that drives in real time."""
    found = in_turns(trees, ("--duration", str(given.real), *CASES["recorded"]), given.rounds)
    old, new = found["old"], found["new"]
    of_old = "the latest of old"
    rows = []
    for name, of, share, limit in (
        ("controller late, median, us", lambda run: run.late("p50"), MEDIAN, f"{MEDIAN:g} times {of_old}"),
        ("controller late, p99, us", lambda run: run.late("p99"), 1.0, of_old),
        ("latest task late, median, us", lambda run: run.waits, MEDIAN, f"{MEDIAN:g} times {of_old}"),
    ):
        before, after = ([of(each) for each in runs] for runs in (old, new))
        rows.append(Row(name, before, after, limit, median(after) <= share * max(before)))
    missed = [[float(each.misses) for each in runs] for runs in (old, new)]
    rows.append(Row("cycles missed", missed[0], missed[1], "as many", sum(missed[1]) <= sum(missed[0])))
    rows.append(at_most("processor time, s", found, lambda run: run.processor, PROCESSOR))
    return shown(f"A recorded robot in real time, {given.rounds} x {given.real:g} s", rows)


def at_most(name: str, found: Mapping[str, Sequence[Run]], of: Callable[[Run], float], limit: float) -> Row:
    """Return the row of a quantity whose new value may be `limit` times the old one."""
    old, new = ([of(run) for run in found[tree]] for tree in ("old", "new"))
    row = Row(name, old, new, f"{limit:.3g} times", True)
    return row._replace(met=row.ratio <= limit)


def shown(title: str, rows: list[Row]) -> list[Row]:
    """Print the rows, and return them."""
    cells = [
        (row.name, spread(row.old), spread(row.new), f"{row.ratio:.3f}", row.limit, verdict(row.met)) for row in rows
    ]
    table(title, ("", "old", "new", "new / old", "at most", ""), cells)
    return rows


def in_turns(trees: Mapping[str, Path], words: Sequence[str], rounds: int) -> dict[str, list[Run]]:
    """Return the runs of both with these words."""
    return interleave(rounds, {name: partial(run, form, words) for name, form in trees.items()})


def run(form: Path, words: Sequence[str]) -> Run:
    """Run a source tree or an installed package, headless."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment.pop("PYTHONPATH", None)
    python = str(form.absolute())
    if form.is_dir():
        python, environment["PYTHONPATH"] = sys.executable, python
    command = [python, "-m", "txt1", "run", "--headless", "--seed", "1", "--json", *words]
    with tempfile.TemporaryDirectory() as scratch:
        child = subprocess.Popen(command, cwd=scratch, env=environment, stdout=subprocess.PIPE)
        assert child.stdout is not None
        told = child.stdout.read()
        # its own resources, which `wait` of the subprocess module does not tell
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise SystemExit(f"{form}: the run ended with {child.returncode}: {' '.join(command)}")
    # in bytes on macOS
    unit = 1e6 if sys.platform == "darwin" else 1e3
    return Run(json.loads(told), used.ru_utime + used.ru_stime, used.ru_maxrss / unit)


if __name__ == "__main__":
    sys.exit(main())
