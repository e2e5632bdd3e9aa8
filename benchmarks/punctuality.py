"""How late the controller task starts, in real time, beside a bare loop in C.

Ours is the whole robot: every task, the simulated hardware, and the terminal drawn in a pseudo-terminal. The peer
does nothing but `clock_nanosleep` to the same 50 Hz deadlines with the same timer slack.
"""

from __future__ import annotations

import json
import os
import pty
import resource
import shutil
import subprocess
import sys
import tempfile
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

from benchmarks.rounds import interleave, spread, table, verdict
from txt1.tasks.controller import PERIOD

LIMIT: Final = 1.5
"""Largest ratio of our lateness to the C loop's."""

SOURCE: Final = Path(__file__).with_name("nanosleep.c")
ROOT: Final = Path(__file__).parent.parent


class Round(NamedTuple):
    """One round of one contestant: start lateness in us, cycles, and processor time as a share of one core."""

    p50: float
    p99: float
    max: float
    cycles: int
    misses: int
    cpu: float
    drawing_cpu: float = 0.0


def main(*, quick: bool) -> None:
    """Print lateness, missed cycles and processor time of both."""
    rounds, duration, long_run = (2, 3.0, None) if quick else (6, 10.0, 60.0)
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        print("\npunctuality: there is no C compiler (cc or gcc) to make the peer with; install one, e.g. gcc")
        return
    with tempfile.TemporaryDirectory() as directory:
        peer = Path(directory, "nanosleep")
        subprocess.run([compiler, "-O2", "-o", str(peer), str(SOURCE)], check=True)
        report = Path(directory, "report.json")
        contestants: dict[str, Callable[[], Round]] = {
            "C loop": partial(c_loop, peer, duration),
            "txt1": partial(robot, report, duration),
        }
        results = interleave(rounds, contestants)
        show(results, duration)
        if long_run is not None:
            result = robot(report, long_run)
            print(
                f"\n{long_run:.0f} s with the terminal drawing: {result.misses} of {result.cycles + result.misses} "
                f"controller cycles missed (limit 0: {verdict(result.misses == 0)}); "
                f"latest start {result.max:.0f} us; processor time {100.0 * result.cpu:.1f} % of a core, "
                f"and {100.0 * result.drawing_cpu:.1f} % for the drawing process with its start"
            )


def show(results: dict[str, list[Round]], duration: float) -> None:
    """Print the rounds of both and compare them."""
    c, ours = results["C loop"], results["txt1"]
    table(
        f"Start lateness of a {1.0 / PERIOD:.0f} Hz task, us, {len(c)} interleaved rounds of {duration:.0f} s",
        ("round", "C p50", "txt1 p50", "C p99", "txt1 p99", "C max", "txt1 max", "C missed", "txt1 missed"),
        [
            (
                str(number), f"{a.p50:.1f}", f"{b.p50:.1f}", f"{a.p99:.1f}", f"{b.p99:.1f}",
                f"{a.max:.0f}", f"{b.max:.0f}", str(a.misses), str(b.misses),
            )
            for number, (a, b) in enumerate(zip(c, ours, strict=True), start=1)
        ],
    )  # fmt: skip
    rows = []
    for name, theirs, mine in (
        ("p50", [r.p50 for r in c], [r.p50 for r in ours]),
        ("p99", [r.p99 for r in c], [r.p99 for r in ours]),
    ):
        ratio = median(mine) / median(theirs)
        rows.append((name, spread(theirs, 1), spread(mine, 1), f"{ratio:.2f}", f"{LIMIT}", verdict(ratio <= LIMIT)))
    table(
        "Median over the rounds (smallest .. largest), us",
        ("lateness", "C loop", "txt1, terminal drawing", "ratio", "limit", ""),
        rows,
    )
    missed, cycles = sum(r.misses for r in ours), sum(r.cycles + r.misses for r in ours)
    print(
        f"\n  missed: C loop {sum(r.misses for r in c)}, txt1 {missed} of {cycles}"
        f"\n  processor time, % of a core: C loop {spread([100.0 * r.cpu for r in c])}, "
        f"the robot {spread([100.0 * r.cpu for r in ours])}, "
        f"its drawing process with its start {spread([100.0 * r.drawing_cpu for r in ours])}"
    )


def c_loop(program: Path, duration: float) -> Round:
    """One round of the peer."""
    cycles = round(duration / PERIOD)
    before = _children_cpu_s()
    output = subprocess.run(
        [str(program), str(round(PERIOD * 1e9)), str(cycles)], check=True, capture_output=True, text=True
    ).stdout
    cpu = (_children_cpu_s() - before) / duration
    *lines, last = output.splitlines()
    late = sorted(int(line) / 1e3 for line in lines)
    return Round(
        late[len(late) // 2], late[int(0.99 * len(late))], late[-1], len(late), int(last.removeprefix("missed ")), cpu
    )


def robot(report: Path, duration: float) -> Round:
    """One round of the whole robot in a pseudo-terminal."""
    report.unlink(missing_ok=True)
    command = [sys.executable, "-m", "benchmarks.drawn_robot", "--duration", str(duration), "--report", str(report)]
    with tempfile.TemporaryFile() as errors, terminal() as tty:
        # its errors go past the screens
        code = subprocess.run(command, stdin=tty, stdout=tty, stderr=errors, cwd=ROOT).returncode
        if code != 0:
            errors.seek(0)
            raise SystemExit(f"punctuality: the robot ended with code {code}\n{errors.read().decode()}")
    result = json.loads(report.read_text(encoding="utf-8"))
    return Round(
        result["p50_s"] * 1e6,
        result["p99_s"] * 1e6,
        result["max_s"] * 1e6,
        result["cycles"],
        result["misses"],
        result["robot_cpu_share"],
        result["drawing_cpu_s"] / result["duration_s"],
    )


@contextmanager
def terminal() -> Iterator[int]:
    """A pseudo-terminal of 80 x 24 cells whose output is read and thrown away."""
    master, slave = pty.openpty()
    termios.tcsetwinsize(slave, (24, 80))

    def drain() -> None:
        try:
            while os.read(master, 1 << 16):
                pass
        except OSError:  # Linux's way to say that nobody has the other end open any more
            return

    reader = threading.Thread(target=drain)
    reader.start()
    try:
        yield slave
    finally:
        os.close(slave)
        reader.join()
        os.close(master)


def _children_cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
