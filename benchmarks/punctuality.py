"""How late the controller task starts, in real time, beside bare loops in C and a timer of rclpy.

Ours is the whole robot: every task, the simulated hardware, a recording, and the terminal drawn in a pseudo-terminal.
The peers do nothing at the same 50 Hz deadlines. A loop in C sleeps by `clock_nanosleep` with the same timer slack;
another one also wakes early and spins, by our scheduler's rule. The third peer is a node of rclpy with one timer, where
ROS 2 is installed ("txt1 ros2 install"). All run as any program does; the loops and the robot run once more under
SCHED_FIFO (`txt1 run --realtime`) where that is granted.

    python -m benchmarks.punctuality --rounds 12 --duration 20 --busy 2    beside two busy loops
    python -m benchmarks.punctuality --alone 3600                          an hour: are cycles missed?
"""

from __future__ import annotations

import argparse
import json
import os
import pty
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
from txt1.errors import ConfigError
from txt1.kernel.realtime import FIFO, grantable
from txt1.ros.python import RosPython, ros2
from txt1.tasks.controller import CONTROL_PERIOD

LIMIT: Final = 1.5
"""Largest ratio of our lateness to the C loop's."""
LIMIT_FIFO: Final = 1.6
"""The same with both under SCHED_FIFO."""

SOURCE: Final = Path(__file__).with_name("nanosleep.c")
NODE: Final = Path(__file__).with_name("ros_peers.py")
ROOT: Final = Path(__file__).parent.parent


class Round(NamedTuple):
    """One round of one contestant: start lateness in us, cycles, and processor time as a share of one core."""

    p50: float
    p99: float
    max: float
    cycles: int
    misses: int
    cpu: float = 0.0
    drawing_cpu: float = 0.0
    missed_at: tuple[float, ...] = ()  # s


def main(*, quick: bool) -> None:
    """Print lateness, missed cycles and processor time of both, on this machine as it is and beside two busy loops."""
    rounds, duration, long_run = (2, 3.0, None) if quick else (6, 10.0, 60.0)
    for busy in (0, 2):
        compare(rounds, duration, busy)
    if long_run is not None:
        alone(long_run)


def compare(rounds: int, duration: float, busy: int) -> None:
    """Print what came of interleaved rounds beside so many busy loops."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        print("\npunctuality: there is no C compiler (cc or gcc) to make the peer with; install one, e.g. gcc")
        return
    with tempfile.TemporaryDirectory() as directory, loops(busy):
        peer = Path(directory, "nanosleep")
        subprocess.run([compiler, "-O2", "-o", str(peer), str(SOURCE)], check=True)
        contestants: dict[str, Callable[[], Round]] = {
            "C loop": partial(c_loop, peer, duration, "0"),
            "C loop, spins": partial(c_loop, peer, duration, "1"),
            "txt1": partial(robot, duration),
        }
        try:
            ros = ros2()
            ros_timer(ros, 0.2)
            contestants["rclpy timer"] = partial(ros_timer, ros, duration)
        except (ConfigError, OSError, subprocess.CalledProcessError) as error:
            print(f"\npunctuality: rclpy's timer did not run: {_reason(error)}")
        fifo = grantable().fifo
        if fifo is not None:
            contestants["C loop, SCHED_FIFO"] = partial(c_loop, peer, duration, "0", str(fifo))
            contestants["C loop, spins, SCHED_FIFO"] = partial(c_loop, peer, duration, "1", str(fifo))
            contestants["txt1 --realtime"] = partial(robot, duration, realtime=True)
        else:
            print(f"\npunctuality: SCHED_FIFO {FIFO} is not granted, so nothing is compared under it")
        show(interleave(rounds, contestants), duration, busy)


def show(results: dict[str, list[Round]], duration: float, busy: int) -> None:
    """Print the rounds and compare them."""
    beside = f"beside {busy} busy loops" if busy else "on the machine as it is"
    table(
        f"p99 of the start lateness of a {1.0 / CONTROL_PERIOD:.0f} Hz task, us, in rounds of {duration:.0f} s, "
        f"{beside}",
        ("round", *results),
        [
            (str(number), *(f"{each.p99:.1f}" for each in each_round))
            for number, each_round in enumerate(zip(*results.values(), strict=True), start=1)
        ],
    )
    rows = [
        (
            name,
            *(spread([getattr(each, field) for each in rounds], 1) for field in ("p50", "p99", "max")),
            str(sum(each.misses for each in rounds)),
            spread([100.0 * each.cpu for each in rounds], 1),
            spread([100.0 * each.drawing_cpu for each in rounds], 1),
        )
        for name, rounds in results.items()
    ]
    table(
        f"Median over {len(results['C loop'])} rounds (smallest .. largest) {beside}, us",
        ("", "p50", "p99", "latest", "missed", "processor, %", "its screens, %"),
        rows,
    )
    for ours, peers, limit in (
        ("txt1", ("C loop", "C loop, spins", "rclpy timer"), LIMIT),
        ("txt1 --realtime", ("C loop, SCHED_FIFO", "C loop, spins, SCHED_FIFO"), LIMIT_FIFO),
    ):
        for theirs in (each for each in peers if ours in results and each in results):
            ratio = median([r.p99 for r in results[ours]]) / median([r.p99 for r in results[theirs]])
            told = f" (limit {limit}: {verdict(ratio <= limit)})" if theirs == peers[0] else ""
            print(f"\n  p99 of {ours}: {ratio:.2f} times that of the {theirs}{told}")


def alone(duration: float, *, realtime: bool = False) -> None:
    """Print what came of one long run."""
    result = robot(duration, realtime=realtime)
    print(
        f"\n{duration:.0f} s with screens and recording: {result.misses} of {result.cycles + result.misses} controller "
        f"cycles missed (limit 0: {verdict(result.misses == 0)}); latest start {result.max:.0f} us; processor time "
        f"{100.0 * result.cpu:.1f} % of a core, and {100.0 * result.drawing_cpu:.1f} % for the screens"
    )
    if result.missed_at:
        print("missed before", ", ".join(f"{at:g} s" for at in result.missed_at))


@contextmanager
def loops(busy: int) -> Iterator[None]:
    """So many processes that use all the processor time they get."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def c_loop(program: Path, duration: float, spins: str, *priority: str) -> Round:
    """One round of a loop in C."""
    cycles = round(duration / CONTROL_PERIOD)
    words = [str(program), str(round(CONTROL_PERIOD * 1e9)), str(cycles), spins, *priority]
    *lines, last = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    return _round([int(line) / 1e3 for line in lines], int(last.removeprefix("missed ")))


def ros_timer(ros: RosPython, duration: float) -> Round:
    """One round of a node of rclpy with one timer."""
    words = [*ros.program, str(NODE), "timer", str(duration)]
    told = subprocess.run(words, env=ros.environment, check=True, capture_output=True, text=True).stdout
    result = json.loads(told.splitlines()[-1])
    return _round([1e6 * each for each in result["late"]], result["missed"])


def robot(duration: float, *, realtime: bool = False) -> Round:
    """One round of the whole robot in a pseudo-terminal."""
    with tempfile.TemporaryDirectory() as directory, tempfile.TemporaryFile() as errors, terminal() as tty:
        report = Path(directory, "report.json")
        words = ["--duration", str(duration), "--report", str(report), "--log", str(Path(directory, "run.mcap"))]
        words += ["--realtime"] if realtime else []
        # its errors go past the screens
        command = [sys.executable, "-m", "benchmarks.drawn_robot", *words]
        code = subprocess.run(command, stdin=tty, stdout=tty, stderr=errors, cwd=ROOT).returncode
        if code != 0:
            errors.seek(0)
            raise SystemExit(f"punctuality: the robot ended with code {code}\n{errors.read().decode()}")
        result = json.loads(report.read_text(encoding="utf-8"))
    late = _round([1e6 * each for each in result["late_s"]], result["misses"])
    shares = {"cpu": result["robot_cpu_share"], "drawing_cpu": result["drawing_cpu_share"]}
    return late._replace(**shares, missed_at=tuple(result["missed_at_s"]))


def _reason(error: Exception) -> str:
    """Return why a peer does not run, in a line."""
    said = error.stderr if isinstance(error, subprocess.CalledProcessError) else str(error)
    return said.strip().splitlines()[-1] if said.strip() else str(error)


def _round(late: list[float], misses: int) -> Round:
    late.sort()
    return Round(late[len(late) // 2], late[int(0.99 * len(late))], late[-1], len(late), misses)


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


def _main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.punctuality", description=__doc__)
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--duration", type=float, default=20.0, metavar="S", help="of a round")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="busy loops beside it")
    parser.add_argument("--alone", type=float, metavar="S", help="one run of so long instead, without peers")
    parser.add_argument("--realtime", action="store_true", help="with --alone: as txt1 run --realtime")
    arguments = parser.parse_args()
    if arguments.alone is not None:
        with loops(arguments.busy):
            alone(arguments.alone, realtime=arguments.realtime)
    else:
        compare(arguments.rounds, arguments.duration, arguments.busy)


if __name__ == "__main__":
    _main()
