"""Learning trials on processes and on a Dask cluster whose worker is killed in the middle: equal tables, and the cost.

``python -m benchmarks.machines [--trials 1000] [--episodes 1] [--workers 4]``. It starts scheduler and workers itself
and kills one worker, for good, when half of the trials are done. The engine's own cost is that of trials that do
nothing. Ended early, the same command goes on; the wall time is then of the rest.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import sleep
from typing import Final

from benchmarks.rounds import table
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.processors import processors
from txt1.trials.workers import Cluster, Workers

PLACE: Final = "tcp://127.0.0.1:18787"
EMPTY: Final = 1000  # trials that do nothing


def nothing(text: str) -> str:
    """A trial that does nothing."""
    return text


@contextmanager
def cluster(workers: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """A scheduler and so many workers on this computer, one thread each, without anybody who starts them again."""
    log = subprocess.DEVNULL
    dask = [sys.executable, "-m", "distributed.cli.dask_"]
    *start, module = dask
    at = ["--host", "127.0.0.1", "--port", PLACE.rpartition(":")[2], "--no-dashboard"]
    scheduler = subprocess.Popen([*start, f"{module}scheduler", *at], stdout=log, stderr=log)
    sleep(4.0)
    one = [*start, f"{module}worker", PLACE, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    others = [subprocess.Popen(one, stdout=log, stderr=log) for _ in range(workers)]
    try:
        sleep(6.0)
        yield others
    finally:
        for each in (*others, scheduler):
            each.kill()
            each.wait()


def learned(out: Path, arguments: argparse.Namespace, where: list[str], half: list[subprocess.Popen[bytes]]) -> float:
    """Seconds that the trials took; the first of `half` is killed when half of them are done."""
    words = [
        "learn",
        "--trials",
        str(arguments.trials),
        "--episodes",
        str(arguments.episodes),
        "--seed",
        "1",
        "--no-pictures",
        "--out",
        str(out),
        *where,
    ]
    again = ["--resume"] if (out / "experiment.json").exists() else []
    began = stopwatch_ns()
    with subprocess.Popen([sys.executable, "-m", "txt1", *words, *again], stdout=subprocess.DEVNULL) as learner:
        while learner.poll() is None:
            sleep(0.5)
            if half and len(list((out / "trials").glob("*.json"))) >= arguments.trials // 2:
                half.pop(0).kill()
                half.clear()
    if learner.returncode:
        raise SystemExit(f"learn ended with {learner.returncode}")
    return (stopwatch_ns() - began) / NS_PER_S


def empty(machines: Workers) -> float:
    """Milliseconds that a trial costs that does nothing; what comes before the first is not counted."""
    texts = dict.fromkeys(range(EMPTY), "1")
    began = 0
    for _ in machines.each(nothing, texts, lambda: False):
        began = began or stopwatch_ns()
    return (stopwatch_ns() - began) / 1e6 / (EMPTY - 1)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--episodes", type=int, default=1, help="of each trial")
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--out", type=Path, default=Path("out/machines"))
    arguments = parser.parse_args()
    here, there = arguments.out / "processes", arguments.out / "cluster"
    jobs = processors()
    rows = [_row(f"{jobs} processes", learned(here, arguments, ["--jobs", str(jobs)], []), arguments.trials)]
    costs = [empty(Workers(jobs))]
    with cluster(arguments.workers) as workers:
        costs.append(empty(Workers(1, Cluster(PLACE))))
        killed = list(workers)
        took = learned(there, arguments, ["--dask", PLACE], killed)
        rows.append(_row(f"Dask, {arguments.workers} workers, one killed", took, arguments.trials))
        alive = sum(each.poll() is None for each in workers)
    names = [*sorted(file.relative_to(here) for file in (here / "trials").glob("*.json")), Path("learning.csv")]
    same = sum((here / name).read_bytes() == (there / name).read_bytes() for name in names)
    table(
        f"{arguments.trials} trials of {arguments.episodes} episodes: {same} of {len(names)} files equal byte by byte, "
        f"{alive} of {arguments.workers} workers left, load {os.getloadavg()[0]:.1f}",
        ("", "wall time", "a trial", "engine alone, a trial"),
        [(*row, f"{cost:.2f} ms") for row, cost in zip(rows, costs, strict=True)],
    )


def _row(name: str, took: float, trials: int) -> tuple[str, str, str]:
    return name, f"{took:.0f} s", f"{1e3 * took / trials:.0f} ms"


if __name__ == "__main__":
    main()
