"""Ten robots on a network on one computer, a process each, its own controller in real time, and what befalls them.

``python -m benchmarks.fleet_processes [--robots 10] [--duration 30]``. Of one the process is killed and started again,
one is stopped for 3 s, one is cut off from the network for 3 s (the process of its bridge is stopped), and to one
another of its name comes. Those to which nothing happens are counted by the controller's missed cycles.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from benchmarks.rounds import table
from txt1.fleet.network import Hooks, Peer
from txt1.kernel.clock import NS_PER_S, RealClock

PAUSE: Final = 3.0  # s that one is stopped or cut off
PATIENCE: Final = 60.0  # s for a process to come up on a busy machine
HEARD: Final = {True: "still heard", False: "silent"}
STRUCK: Final = 4  # robots to which something happens


class Observer:
    """A peer that collects how late what each robot tells arrives, s, by its name."""

    def __init__(self) -> None:
        self.late: dict[str, list[float]] = {}
        self._clock = RealClock()
        self.peer = Peer("observer", hooks=Hooks(state=self._heard))

    def _heard(self, message: Any) -> None:
        late = self._clock.now_ns() / NS_PER_S - message["sent"] / NS_PER_S
        self.late.setdefault(message["from"], []).append(late)

    def fresh(self, name: str) -> bool:
        """Whether a robot was heard a moment ago."""
        return any(one.name == name and one.alive and (one.age or 0.0) < 0.3 for one in self.peer.members())

    def alive(self, name: str) -> bool:
        """Whether a robot counts as there."""
        return any(one.name == name and one.alive for one in self.peer.members())

    def until(self, true: Callable[[], bool]) -> float:
        """Seconds until something comes true, or infinite."""
        began = self.peer.now
        while self.peer.now < began + PATIENCE:
            if true():
                return self.peer.now - began
            self.peer.listen(0.01)
        return float("inf")


def started(name: str) -> subprocess.Popen[str]:
    """A robot's process."""
    words = ["run", "--name", name, "--fleet", "--headless", "--json"]
    drive = ["--drive", "0.3,0.3", "--set", "safety.missed_ticks_max=1000"]  # a busy machine is to be measured
    return subprocess.Popen(
        [sys.executable, "-m", "txt1", *words, *drive],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def bridge_of(robot: int) -> int:
    """The process of a robot's bridge to its fleet."""
    threads = Path(f"/proc/{robot}/task").iterdir()  # any of them may have begun it
    children = [int(each) for one in threads for each in (one / "children").read_text(encoding="ascii").split()]
    return next(each for each in children if b"fleet.bridge" in Path(f"/proc/{each}/cmdline").read_bytes())


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--duration", type=float, default=30.0, help="of the measurement, s")
    arguments = parser.parse_args()
    names = [f"net{number:02d}" for number in range(1, arguments.robots + 1)]
    observer = Observer()
    robots = {name: started(name) for name in names}
    try:
        _measure(observer, robots, arguments.duration)
    finally:
        for robot in robots.values():
            robot.kill()
        observer.peer.close()


def _measure(observer: Observer, robots: dict[str, subprocess.Popen[str]], duration: float) -> None:
    names = list(robots)
    observer.until(lambda: all(map(observer.fresh, names)))
    observer.late.clear()
    observer.peer.listen(duration)
    late = sorted(each for one in observer.late.values() for each in one)
    rates = sorted(len(observer.late.get(name, [])) / duration for name in names)
    load = os.getloadavg()[0]
    killed, stopped, cut, twice = names[:STRUCK]
    rows = [(f"{killed} is killed: gone after", f"{_struck(observer, robots[killed], signal.SIGKILL, killed):.2f} s")]
    robots[killed].communicate()
    robots[killed] = started(killed)
    rows.append(("... started again: heard after", f"{observer.until(lambda: observer.fresh(killed)):.2f} s"))
    os.kill(robots[stopped].pid, signal.SIGSTOP)
    observer.peer.listen(PAUSE)
    known = observer.fresh(stopped)
    os.kill(robots[stopped].pid, signal.SIGCONT)
    again = observer.until(lambda: observer.fresh(stopped))
    rows.append(
        (f"{stopped} is stopped for 3 s: {'still heard' if known else 'silent'}, heard again after", f"{again:.2f} s")
    )
    bridge = bridge_of(robots[cut].pid)
    os.kill(bridge, signal.SIGSTOP)
    observer.peer.listen(PAUSE)
    known = observer.fresh(cut)
    os.kill(bridge, signal.SIGCONT)
    again = observer.until(lambda: observer.fresh(cut))
    rows.append(
        (f"{cut} is cut off for 3 s: {'still heard' if known else 'silent'}, heard again after", f"{again:.2f} s")
    )
    second = started(twice)
    told = second.communicate()[1].strip().splitlines()[-1:]
    rows.append(
        (
            f"another {twice} comes: exit code {second.returncode}",
            f"first {'there' if observer.fresh(twice) else 'GONE'}",
        )
    )
    for robot in robots.values():
        robot.send_signal(signal.SIGINT)
    reports = {name: _report(robot) for name, robot in robots.items()}
    missed = {name: report["tasks"]["controller"]["misses"] for name, report in reports.items() if report}
    whole = [missed[name] for name in names[STRUCK:] if name in missed] + [
        missed[n] for n in (cut, twice) if n in missed
    ]
    cycles = reports[names[-1]]["tasks"]["controller"]["cycles"] if reports[names[-1]] else 0
    figures = [f"{1e3 * late[int(share * (len(late) - 1))]:.1f} ms" for share in (0.5, 0.99, 1.0)]
    heads = ("telemetry a robot, least", "median", "p50", "p99", "longest")
    rate = f"{rates[0]:.1f} Hz", f"{rates[len(rates) // 2]:.1f} Hz"
    table(f"{len(names)} robots, load {load:.1f} on {os.cpu_count()} processors", heads, [(*rate, *figures)])
    done = f"{sum(not each for each in whole)} of {len(whole)}"
    row = (done, str(sum(whole)), str(cycles), ", ".join(map(str, sorted(whole))))
    table(
        "Controllers to whose process nothing happened",
        ("without a missed cycle", "missed", "of each", "by robot"),
        [row],
    )
    table("What befell the others", ("", ""), rows)
    print("\n" + " ".join(told))


def _struck(observer: Observer, robot: subprocess.Popen[str], number: signal.Signals, name: str) -> float:
    robot.send_signal(number)
    return observer.until(lambda: not observer.alive(name))


def _report(robot: subprocess.Popen[str]) -> dict[str, Any]:
    said, _ = robot.communicate()
    try:
        return dict(json.loads(said))
    except ValueError:
        return {}


if __name__ == "__main__":
    main()
