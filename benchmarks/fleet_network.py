"""A fleet over Zenoh on one computer, ten processes: telemetry's rate and latency, and 1000 stops of all with losses.

``python -m benchmarks.fleet_network [--stops 1000] [--loss 0.3] [--peers 10]``. A lost message is one that a peer
throws away, sending or receiving, each with the given probability; the wire beneath is TCP on loopback.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import threading
from collections.abc import Mapping
from typing import Any

from benchmarks.rounds import table
from txt1.fleet.messages import StopAnswer
from txt1.fleet.network import Hooks, Peer
from txt1.kernel.clock import NS_PER_S, RealClock

STATE = {"x": 1.0, "y": 2.0, "theta": 0.5, "v": 0.3, "omega": 0.1, "armed": True, "reason": "", "driver": "team"}


def peer(name: str, loss: float) -> None:
    """Tell the state 20 times a second, and every stop with its time, until standard input ends."""
    ended = threading.Event()
    obeyed: set[str] = set()

    def stop(who: str, identity: str) -> StopAnswer:
        if identity not in obeyed:
            obeyed.add(identity)
            print(one.now, flush=True)
        return StopAnswer(closed=True, stands=True)

    one = Peer(name, loss=loss, fleet="benchmark", hooks=Hooks(stop=stop))
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    print("ready", flush=True)
    while not ended.wait(0.05):
        one.tell(STATE)
    one.close()


class Observer:
    """The peer that stops the others; collects how late what they tell arrives."""

    def __init__(self, loss: float) -> None:
        self.late: list[float] = []
        self._clock = RealClock()
        self.peer = Peer("observer", loss=loss, fleet="benchmark", hooks=Hooks(state=self._heard))

    def _heard(self, message: Mapping[str, Any]) -> None:
        self.late.append(self._clock.now_ns() / NS_PER_S - message["sent"] / NS_PER_S)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=1000)
    parser.add_argument("--loss", type=float, default=0.3)
    parser.add_argument("--peers", type=int, default=10)
    parser.add_argument("--be", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.be:
        peer(arguments.be, arguments.loss)
        return
    for loss in (0.0, arguments.loss):
        _measure(arguments.peers, loss, arguments.stops if loss else 0)


def _measure(count: int, loss: float, stops: int) -> None:
    command = [sys.executable, "-m", "benchmarks.fleet_network", "--loss", str(loss), "--be"]
    others = [
        subprocess.Popen([*command, f"txt{number:02d}"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for number in range(1, count + 1)
    ]
    outputs = [other.stdout for other in others if other.stdout is not None]
    for output in outputs:
        output.readline()
    observer = Observer(loss)
    observer.peer.listen(3.0)
    observer.late.clear()
    observer.peer.listen(10.0)
    late = sorted(observer.late)
    rate = len(late) / 10.0 / count
    figures = [f"{1e3 * late[int(share * (len(late) - 1))]:.2f} ms" for share in (0.5, 0.99, 1.0)]
    title = f"Telemetry of {count} processes, {100 * loss:.0f} % of the messages lost each way"
    table(title, ("per robot", "p50", "p99", "longest"), [(f"{rate:.1f} Hz", *figures)])
    if stops:
        times = sorted(_stop(observer.peer, outputs) for _ in range(stops))
        late_ones = sum(time > 0.5 for time in times)
        row = (str(stops), *(f"{1e3 * times[int(p * (stops - 1))]:.0f} ms" for p in (0.5, 0.99, 1.0)), str(late_ones))
        table(
            f"Stop of all, until the last of {count} is told", ("stops", "p50", "p99", "longest", "over 0.5 s"), [row]
        )
    for other in others:
        other.communicate("")
    observer.peer.close()


def _stop(peer: Peer, outputs: list[Any]) -> float:
    began = peer.now
    peer.stop_all()
    return max(json.loads(output.readline()) for output in outputs) - began


if __name__ == "__main__":
    main()
