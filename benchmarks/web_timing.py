"""How long the robot goes on when its driver's page is gone: ``python -m benchmarks.web_timing``.

A real browser (Debian's chromium through playwright) holds a key down; then the network falls silent with its
connections open, the page's process is stopped, the browser is killed, the page is reloaded, or the server is killed.
Counted is the time from the last fresh input, by its own time stamp, to the set-point 0, and from the fault to it; and
that nothing moves again by itself. 50 rounds of each take a quarter of an hour.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import monotonic, sleep
from typing import Any, Final, NamedTuple

from playwright.sync_api import sync_playwright

from benchmarks.rounds import spread, table, verdict
from tests.browser.live import CHROMIUM, FLAGS, Live, live

LIMIT: Final = 0.25 + 0.02 + 0.04
"""s: the age at which a command is late, one tick of the controller, and the step in which the page renews it."""
ENDLESS: Final = ("sim.room.length=.inf", "sim.room.width=.inf")


class Round(NamedTuple):
    """What came of one: s from the last input and from the fault to neutral; whether it moved again; cycles missed."""

    input: float
    fault: float
    again: bool
    misses: int


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
    """A browser with the page, its key w held down."""

    def __init__(self, playwright: Any, url: str) -> None:
        self.browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        self.page = self.browser.new_page()
        self.page.goto(url)
        self.page.wait_for_function("() => document.getElementById('link').textContent.endsWith('ms')")

    def pids(self, kind: str) -> list[int]:
        """The processes of this kind: "browser", or "renderer" for those of pages."""
        session = self.browser.new_browser_cdp_session()
        processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
        session.detach()
        return [each["id"] for each in processes if each["type"] == kind]


def held(car: Live, driver: Driver, fault: Callable[[], None], mend: Callable[[], None]) -> Round:
    """Drive, let the fault happen, wait for neutral, mend it, and see whether the robot moves again."""
    misses = car.misses()
    with suppress(Exception):
        driver.page.keyboard.up("w")
    driver.page.keyboard.down("w")
    car.until(lambda robot: robot.runtime.state.control.v > 0.3)
    sleep(random.uniform(0.3, 0.6))
    assert car.samples[-1].v > 0.3
    began = monotonic()
    fault()
    ends = monotonic() + 3.0
    while not any(each.time > began and each.v == 0.0 for each in car.samples[-50:]):
        assert monotonic() < ends, "it drives on"
        sleep(0.01)
    stood = next(each.time for each in car.samples if each.time > began and each.v == 0.0)
    last = max(each.origin for each in car.samples if each.v != 0.0)
    sleep(0.6)
    mend()
    sleep(0.8)
    again = any(each.v != 0.0 for each in car.samples if each.time > stood)
    missed = car.misses() - misses
    car.samples.clear()
    return Round(stood - last, stood - began, again, missed)


@contextmanager
def stage() -> Iterator[Live]:
    """A robot in an endless room."""
    with live(ENDLESS) as car:
        yield car


def rounds(playwright: Any, name: str, number: int) -> list[Round]:
    """So many rounds of a fault."""
    found = []
    if name == "server killed":
        for _ in range(number):
            with stage() as car:
                driver = Driver(playwright, car.url)
                found.append(held(car, driver, lambda: os.kill(car.pid, signal.SIGKILL), lambda: None))
                driver.browser.close()
        return found
    with stage() as car:
        relay = Relay(car.port)
        driver = None
        for _ in range(number):
            if driver is None:
                driver = Driver(playwright, f"http://127.0.0.1:{relay.port}/")
            page = driver.page
            match name:
                case "network cut":
                    one = held(car, driver, relay.silent.set, relay.silent.clear)
                case "page frozen":
                    pids = driver.pids("renderer")
                    one = held(car, driver, lambda: send(pids, signal.SIGSTOP), lambda: send(pids, signal.SIGCONT))  # noqa: B023
                case "browser killed":
                    pids = driver.pids("browser")
                    one = held(car, driver, lambda: send(pids, signal.SIGKILL), lambda: None)  # noqa: B023
                    with suppress(Exception):
                        driver.browser.close()
                    driver = None
                case _:
                    one = held(car, driver, lambda: page.reload(wait_until="commit"), lambda: None)  # noqa: B023
            found.append(one)
            if driver is not None:
                driver.page.keyboard.up("w")
                driver.page.wait_for_function("() => document.getElementById('link').textContent.endsWith('ms')")
        if driver is not None:
            driver.browser.close()
        relay.close()
    return found


def send(pids: list[int], number: signal.Signals) -> None:
    """Send processes a signal."""
    for pid in pids:
        os.kill(pid, number)


FAULTS: Final = ("network cut", "page frozen", "browser killed", "page reloaded", "server killed")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.web_timing", description=__doc__)
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--fault", choices=FAULTS, action="append", help="only this one; may be given again")
    arguments = parser.parse_args()
    lines, worst = [], 0.0
    with sync_playwright() as playwright:
        for name in arguments.fault or FAULTS:
            found = rounds(playwright, name, arguments.rounds)
            calm = [each.input for each in found if not each.misses] or [0.0]
            worst = max(worst, *calm)
            line = (
                name,
                spread([each.input for each in found], 3),
                spread([each.fault for each in found], 3),
                str(sum(each.again for each in found)),
                str(sum(each.misses for each in found)),
                f"{max(calm):.3f} of {len(calm)}",
            )
            print(*line, sep="  ", flush=True)
            lines.append(line)
    head = ("fault", "s from the last input", "s from the fault", "moved again", "cycles missed", "worst without")
    table(f"to the set-point 0, {arguments.rounds} rounds each: median (least .. most)", head, lines)
    print("\nA busy machine has the controller miss cycles, and then the set-point is looked at late.")
    print(f"worst of the rounds in which none was missed {worst:.3f} s, at most {LIMIT:g}: {verdict(worst <= LIMIT)}")


if __name__ == "__main__":
    main()
