"""``python -m benchmarks.before OLD [NEW]``: how much faster or slower a run has become, in turns.

OLD and NEW are each a source tree, or the Python of an environment that has txt1 installed, such as the compiled
wheel; NEW is this tree if it is left out. A ratio above 1 means that NEW is faster. Simulations as fast as the
processor goes come first, then a robot in real time: how late its controller is, and how many cycles it misses.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple

from benchmarks.rounds import interleave, spread, table, verdict

LIMIT: Final = 0.9
"""Old over new, at least."""

CIRCLE: Final = ("--drive", "0.5,0.5", "--set", "sim.room.length=.inf", "--set", "sim.room.width=.inf")
CASES: Final[dict[str, tuple[str, ...]]] = {"idle": (), "driving": CIRCLE, "recorded": CIRCLE}


class Cost(NamedTuple):
    """Wall time of the simulation as the run tells it, and processor time of the whole process, s."""

    wall: float
    processor: float


class Late(NamedTuple):
    """The 99th percentile of a controller's lateness, s, and its missed cycles."""

    p99: float
    missed: int


def main() -> None:
    """Run both in turns and print the ratios."""
    parser = argparse.ArgumentParser(prog="benchmarks.before", description=__doc__)
    parser.add_argument("old", type=Path, metavar="OLD")
    parser.add_argument("new", type=Path, metavar="NEW", nargs="?", default=Path(__file__).parents[1])
    parser.add_argument("--rounds", type=int, default=15, metavar="N")
    parser.add_argument("--duration", type=float, default=1000.0, metavar="S", help="simulated seconds in a run")
    parser.add_argument("--cases", default=",".join(CASES), metavar="NAMES", help="default %(default)s")
    parser.add_argument("--real", type=float, default=20.0, metavar="S", help="seconds of a round in real time, or 0")
    given = parser.parse_args()
    print(f"{given.rounds} interleaved rounds of {given.duration:.0f} simulated s, load {os.getloadavg()[0]:.2f}")
    compare_speed(given)
    if given.real > 0.0:
        compare_lateness(given)


def compare_speed(given: argparse.Namespace) -> None:
    """Simulations in turns, a table row a case."""
    rows = []
    for case in filter(None, given.cases.split(",")):
        contestants: dict[str, Callable[[], Cost]] = {
            name: partial(drive, form, case, given.duration) for name, form in (("old", given.old), ("new", given.new))
        }
        costs = interleave(given.rounds, contestants)
        pairs = list(zip(costs["old"], costs["new"], strict=True))
        ratio = median(old.wall / new.wall for old, new in pairs)
        rows.append(
            (
                case,
                *(spread([cost.wall for cost in costs[name]]) for name in contestants),
                f"{ratio:.3f}",
                f"{min(cost.wall for cost in costs['old']) / min(cost.wall for cost in costs['new']):.3f}",
                f"{median(old.processor / new.processor for old, new in pairs):.3f}",
                verdict(ratio >= LIMIT),
            )
        )
    table(
        f"Wall time of the simulation, s, and old / new (at least {LIMIT})",
        ("", "old", "new", "median ratio", "of the fastest", "processor, with start", ""),
        rows,
    )


def compare_lateness(given: argparse.Namespace) -> None:
    """A driving robot in real time, in turns."""
    contestants: dict[str, Callable[[], Late]] = {
        name: partial(keep_time, form, given.real) for name, form in (("old", given.old), ("new", given.new))
    }
    found = interleave(given.rounds, contestants)
    late = {name: [1e6 * each.p99 for each in rounds] for name, rounds in found.items()}
    missed = {name: sum(each.missed for each in rounds) for name, rounds in found.items()}
    within = median(late["new"]) <= max(late["old"])
    table(
        f"The controller's lateness in real time, p99 in us, and cycles missed, {given.rounds} x {given.real:g} s",
        ("", "old", "new", ""),
        (
            ("p99, median within the spread of old", *(spread(late[name], 0) for name in contestants), verdict(within)),
            ("missed", *(str(missed[name]) for name in contestants), verdict(missed["new"] <= missed["old"])),
        ),
    )


def keep_time(form: Path, seconds: float) -> Late:
    """How late the controller of a driving robot is in real time."""
    told, _ = told_by(form, ("--duration", str(seconds), *CIRCLE))
    controller = told["tasks"]["controller"]
    return Late(controller["lateness_s"]["p99"], controller["misses"])


def drive(form: Path, case: str, simulated: float) -> Cost:
    """What a run of a source tree or an installed package costs."""
    recorded = ("--log", "recording") if case == "recorded" else ()
    told, processor = told_by(form, ("--speed", "max", "--duration", str(simulated), *CASES[case], *recorded))
    return Cost(float(told["wall_time_s"]), processor)


def told_by(form: Path, words: tuple[str, ...]) -> tuple[dict[str, Any], float]:
    """What a run tells in JSON, and its processor time, s."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment.pop("PYTHONPATH", None)
    python = str(form.absolute())
    if form.is_dir():
        python, environment["PYTHONPATH"] = sys.executable, python
    with tempfile.TemporaryDirectory() as scratch:
        command = [python, "-m", "txt1", "run", "--headless", "--seed", "1", "--json", *words]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, cwd=scratch, env=environment, check=True, stdout=subprocess.PIPE)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    told: dict[str, Any] = json.loads(done.stdout)
    return told, processor


if __name__ == "__main__":
    main()
