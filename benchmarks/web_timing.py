"""How long the robot goes on when its driver's page is gone: ``python -m benchmarks.web_timing``.

A real browser (Debian's chromium through playwright) holds a key down; then the network falls silent with its
connections open, the page's process is stopped, the browser is killed, the page is reloaded, or the server is killed.
Counted is the time from the last fresh input, by its own time stamp, to the set-point 0, and from the fault to it; and
that nothing moves again by itself. 50 rounds of each take a quarter of an hour; they are kept in out/web_timing.jsonl,
so that a command that was ended goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import cycle
from pathlib import Path
from time import monotonic, sleep
from typing import Any, Final

from playwright.sync_api import Error, sync_playwright

from benchmarks.rounds import spread, table, write
from benchmarks.web_car import Car, car
from rigs.live_browser import CHROMIUM, FLAGS, Sample

LIMIT: Final = 0.25 + 0.02 + 0.04  # s: the age at which a command is late, a tick, and the step in which pages renew it
FAULTS: Final = ("network cut", "page frozen", "browser killed", "page reloaded", "server killed")
CHUNK: Final = 5  # rounds of a fault, then it is the next one's turn
KEPT: Final = Path("out/web_timing.jsonl")
PHONE: Final = {"width": 390, "height": 844}  # a small page takes little of the processor from the robot


@dataclass(frozen=True)
class Round:
    """What came of one."""

    fault: str
    input: float  # s from the last input to neutral
    strike: float  # s from the fault to it
    again: bool  # whether it moved again
    cycles: int  # of the controller
    misses: int
    load: float  # of the machine
    realtime: bool


class Relay:
    """Passes bytes on between browsers and the server, and when it is `silent` swallows nothing and sends nothing."""

    def __init__(self, port: int) -> None:
        self.silent = threading.Event()
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                far = socket.create_connection(("127.0.0.1", self._target))
                for one, other in ((near, far), (far, near)):
                    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    threading.Thread(target=self._pass, args=(one, other), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                while self.silent.is_set():
                    sleep(0.005)
                sink.sendall(data)
        for each in (source, sink):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Take nobody in any more."""
        self.silent.clear()
        self._listener.close()


class Driver:
    """A browser with the page."""

    def __init__(self, playwright: Any, url: str) -> None:
        self.browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        self.page = self.browser.new_page(viewport=PHONE)
        self.page.goto(url)

    def ready(self) -> None:
        """Wait until it hears the robot."""
        self.page.wait_for_function("() => document.getElementById('link').textContent.endsWith('ms')")

    def pids(self, kind: str) -> list[int]:
        """The processes of this kind: "browser", or "renderer" for those of pages."""
        session = self.browser.new_browser_cdp_session()
        processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
        session.detach()
        return [each["id"] for each in processes if each["type"] == kind]


class Watch:
    """The set-points since a moment."""

    def __init__(self, robot: Car) -> None:
        self._robot = robot
        self.first = self.last = robot.look()
        self.samples: list[Sample] = []

    def look(self) -> list[Sample]:
        """All of them up to now."""
        self.last = self._robot.look()
        self.samples += self.last.samples
        return self.samples

    def until(self, condition: Callable[[Sample], bool], limit: float) -> Sample | None:
        """The first set-point of which something is true; None: there is none within `limit` s."""
        ends = monotonic() + limit
        while monotonic() < ends:
            for each in self.look():
                if condition(each):
                    return each
            sleep(0.02)
        return None


def held(
    name: str, robot: Car, driver: Driver, fault: Callable[[], None], mend: Callable[[], None], realtime: bool
) -> Round | None:
    """Drive, let the fault happen, wait for neutral, mend it, and see whether the robot moves again.

    None: the page let go by itself before, as it does when a busy machine holds it up.
    """
    watch = Watch(robot)
    driver.ready()
    driver.page.keyboard.up("w")
    driver.page.keyboard.down("w")
    if watch.until(lambda each: each.v > 0.3, 5.0) is None:
        return None
    sleep(random.uniform(0.3, 0.6))
    if watch.look()[-1].v < 0.3:
        return None
    began = monotonic()
    fault()
    stood = watch.until(lambda each: each.time > began and each.v == 0.0, 5.0)
    sleep(0.6)
    mend()
    sleep(0.8)
    watch.look()
    assert stood is not None, f"{name}: it drives on"
    last = max(each.origin for each in watch.samples if each.v != 0.0 and each.time < stood.time)
    again = any(each.v != 0.0 for each in watch.samples if each.time > stood.time)
    first, final = watch.first, watch.last
    return Round(
        name,
        stood.time - last,
        stood.time - began,
        again,
        final.cycles - first.cycles,
        final.misses - first.misses,
        os.getloadavg()[0],
        realtime,
    )


def rounds(playwright: Any, name: str, number: int, realtime: bool) -> Iterator[Round]:
    """So many rounds of a fault, or fewer where the page would not drive."""
    if name == "server killed":
        driver = None
        for _ in range(number):
            with car(realtime=realtime) as robot:
                driver = driver or Driver(playwright, robot.url)
                driver.page.goto(robot.url)
                one = held(name, robot, driver, sending([robot.pid], signal.SIGKILL), nothing, realtime)
            if one is not None:
                yield one
        return
    with car(realtime=realtime) as robot:
        relay = Relay(robot.port)
        driver = None
        for _ in range(number):
            driver = driver or Driver(playwright, f"http://127.0.0.1:{relay.port}/")
            page = driver.page
            match name:
                case "network cut":
                    fault, mend = relay.silent.set, relay.silent.clear
                case "page frozen":
                    pids = driver.pids("renderer")
                    fault, mend = sending(pids, signal.SIGSTOP), sending(pids, signal.SIGCONT)
                case "browser killed":
                    fault, mend = sending(driver.pids("browser"), signal.SIGKILL), nothing
                case _:
                    fault, mend = (lambda: page.reload(wait_until="commit")), nothing  # noqa: B023
            one = held(name, robot, driver, fault, mend, realtime)
            if one is not None:
                yield one
            if name == "browser killed":
                with suppress(Error):
                    driver.browser.close()
                driver = None
        if driver is not None:
            driver.browser.close()
        relay.close()


def nothing() -> None:
    """What cannot be mended."""


def sending(pids: Sequence[int], number: signal.Signals) -> Callable[[], None]:
    """Return a function that sends processes a signal."""

    def send() -> None:
        for pid in pids:
            os.kill(pid, number)

    return send


def kept(path: Path) -> list[Round]:
    """The rounds made so far."""
    return [Round(**json.loads(line)) for line in path.read_text().splitlines()] if path.exists() else []


def collect(wanted: int, faults: Sequence[str], minutes: float, realtime: bool, path: Path) -> None:
    """Make the rounds that are missing, a few of each fault in turn, and keep each at once."""
    path.parent.mkdir(parents=True, exist_ok=True)
    ends = monotonic() + 60.0 * minutes
    with sync_playwright() as playwright, path.open("a") as file:
        for name in cycle(faults):
            done = {each: sum(one.fault == each for one in kept(path)) for each in faults}
            if monotonic() > ends or all(number >= wanted for number in done.values()):
                return
            for one in rounds(playwright, name, min(CHUNK, wanted - done[name]), realtime):
                print(f"{name}: {one.input:.3f} s, {one.misses} cycles missed, load {one.load:.1f}", flush=True)
                file.write(json.dumps(asdict(one)) + "\n")
                file.flush()


def show(found: Sequence[Round]) -> tuple[list[tuple[str, ...]], str]:
    """Return the rows of the table, and the verdict in words."""
    rows = []
    for name in FAULTS:
        if some := [each for each in found if each.fault == name]:
            missed, cycles = sum(each.misses for each in some), sum(each.cycles for each in some)
            rows.append(
                (
                    name,
                    str(len(some)),
                    spread([each.input for each in some], 3),
                    spread([each.strike for each in some], 3),
                    str(sum(each.again for each in some)),
                    f"{missed} of {cycles}",
                )
            )
    worst = max(each.input for each in found)
    calm = [each.input for each in found if not each.misses]
    worst_calm = f"; their worst is {max(calm):.3f} s" if 0 < len(calm) < len(found) else ""
    loads = sorted(each.load for each in found)
    text = (
        f"Worst: {worst:.3f} s ({'' if worst <= LIMIT else 'over the '}limit {LIMIT:g} s: the gate's 0.25 s, a tick of "
        f"0.02 s, and 0.04 s between two inputs). {len(calm)} of {len(found)} rounds had no missed cycle{worst_calm}. "
        f"The robot ran with `--realtime` in {sum(each.realtime for each in found)} rounds. Load of the machine, which "
        f"has {os.cpu_count()} processors: {loads[0]:.1f} to {loads[-1]:.1f}, median {loads[len(loads) // 2]:.1f}."
    )
    return rows, text


HEAD: Final = ("fault", "rounds", "s from the last input", "s from the fault", "moved again", "cycles missed")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.web_timing", description=__doc__)
    parser.add_argument("--rounds", type=int, default=50, help="of each fault; 0: show those there are")
    parser.add_argument("--minutes", type=float, default=60.0, help="begin nothing more after so many")
    parser.add_argument("--fault", choices=FAULTS, action="append", help="only this one; may be given again")
    parser.add_argument("--realtime", action="store_true", help="the robot goes before other programs (--realtime)")
    parser.add_argument("--kept", type=Path, default=KEPT, help="where the rounds are kept")
    parser.add_argument("--page", action="store_true", help="write the table to docs/web.md")
    arguments = parser.parse_args()
    collect(arguments.rounds, arguments.fault or FAULTS, arguments.minutes, arguments.realtime, arguments.kept)
    found = kept(arguments.kept)
    if not found:
        return
    rows, text = show(found)
    table("from the last fresh input to the set-point 0: median (least .. most)", HEAD, rows)
    print(f"\n{text}")
    if arguments.page:
        write(Path("docs/web.md"), "web_timing", HEAD, rows, text)


if __name__ == "__main__":
    main()
