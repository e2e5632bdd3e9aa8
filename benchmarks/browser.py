"""The robot in a web browser, beside its limits: ``python -m benchmarks.browser``.

A folder is built as by ``txt1 browser build``, served by a server of plain files, and opened in a real browser
(Debian's chromium through playwright). Counted is from the address to the first measured motion, with w pressed as
soon as the robot is armed, in a page that was loaded before; the size of what is loaded beyond Pyodide's own; a
simulation as fast as it can; cycles of the 50 Hz controller that were missed on the wall clock in a visible tab,
beside those of a desk; and how long a board drives on when the browser that drives it is stopped (SIGSTOP) or killed.
It takes six minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import monotonic, sleep
from typing import Any, Final

from playwright.sync_api import sync_playwright

from rigs import page_parts
from rigs.browser_robot import ARMED, START, board, driven, drives_off, hold, renderers, serving, signalled
from rigs.live_browser import CHROMIUM, FLAGS
from tests.size import ROOT, statements
from txt1_browser.site import build

PLUGIN: Final = ROOT / "plugins" / "browser"
SIZE: Final = {"width": 1280, "height": 800}
CONTROLLER: Final = (
    "[...document.querySelectorAll('#panel tr')].map((row) => [...row.cells].map((one) => one.textContent))"
)
DRIVES: Final = (10.0, 110.0)
"""s of two drives whose inputs are run again as fast as it goes; the difference is without loading."""
# in a worker of its own, as the page does it
VERIFY: Final = """async (name) => {
  const file = await (await fetch(name)).blob()
  const worker = new Worker("worker.js", { type: "module" })
  let began = 0
  return new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => {
      if (data.loading) began = performance.now()
      if (data.why || data.code) reject(new Error(data.why ?? `exit code ${data.code}`))
      if (data.code === 0) worker.terminate(), resolve((performance.now() - began) / 1000)
    }
    worker.postMessage({ do: "perform", words: ["replay", "--verify", name], name, file })
  })
}"""


def opened(browser: Any, size: Mapping[str, int] = SIZE, **about: Any) -> Any:
    """A blank page that waits as long as a busy computer needs."""
    context = browser.new_context(viewport=size, **about)
    context.set_default_timeout(1000.0 * START)
    return context.new_page()


def starts(browser: Any, url: str, rounds: int) -> list[float]:
    """How many s it takes from the address to the first motion, from a warm cache, each time."""
    page = opened(browser)
    page.goto(url)
    page.wait_for_function(ARMED)
    page.wait_for_function("navigator.serviceWorker.controller !== null")
    found = []
    for _ in range(rounds):
        page.goto("about:blank")
        began = monotonic()
        page.goto(url)
        page.wait_for_function(ARMED)
        drives_off(page)
        found.append(monotonic() - began)
        page.keyboard.up("w")
    page.context.close()
    return found


def speed(browser: Any, folder: Path, url: str) -> float:
    """How many times as fast as real time a drive is verified in the browser, beside the page's own robot."""
    page = opened(browser)
    page.goto(url)
    page.wait_for_function(ARMED)
    seconds: list[float] = []
    for duration in DRIVES:
        name = f"{duration:g}.mcap"
        words = ["run", "--headless", "--speed", "max", "--duration", f"{duration:g}", "--drive", "0.5,0.6"]
        subprocess.run(
            [sys.executable, "-m", "txt1", *words, "--log", str(folder / name)], check=True, stdout=subprocess.DEVNULL
        )
        seconds.append(page.evaluate(VERIFY, name))
    page.context.close()
    return (DRIVES[1] - DRIVES[0]) / (seconds[1] - seconds[0])


def cycles(browser: Any, url: str, seconds: float) -> tuple[int, int]:
    """Cycles of the controller in a visible tab that drives, and how many were missed."""
    page = opened(browser)
    page.goto(url)
    page.wait_for_function(ARMED)
    page.click("[data-tab=tasks]")
    page.wait_for_function(f"{CONTROLLER}.some((row) => row[0] === 'controller')")

    def told() -> tuple[int, int]:
        row = next(each for each in page.evaluate(CONTROLLER) if each[0] == "controller")
        return int(row[2]), int(row[3])

    before, ends = told(), monotonic() + seconds
    while monotonic() < ends:
        page.keyboard.down("d")
        page.keyboard.down("w")
        sleep(2.0)
        page.keyboard.up("w")
        page.keyboard.up("d")
    after = told()
    page.context.close()
    return after[0] - before[0], after[1] - before[1]


def desk_cycles(seconds: float) -> tuple[int, int]:
    """The same of a desk."""
    words = ["run", "--headless", "--duration", f"{seconds:g}", "--drive", "0.5,0.6", "--json"]
    done = subprocess.run([sys.executable, "-m", "txt1", *words], capture_output=True, text=True, check=True)
    controller = json.loads(done.stdout.splitlines()[-1])["tasks"]["controller"]
    return controller["cycles"], controller["misses"]


def stopped(browser: Any, folder: Path, url: str, habits: str, what: signal.Signals) -> float:
    """How many s a board drives on when the browser that drives it gets a signal."""
    with board(habits) as relay:
        page = opened(browser, {"width": 480, "height": 360}, service_workers="block")
        with driven(page, folder, url, relay):
            processes = renderers(browser)
            hold(page, relay)
            try:
                return relay.frozen(lambda: signalled(processes, what))
            finally:
                if what is signal.SIGSTOP:
                    signalled(processes, signal.SIGCONT)
                page.context.close()


def lines_of_code() -> int:
    """Statements of Python, and lines of JavaScript without blanks and comments, of the plug-in."""
    files = [*PLUGIN.glob("txt1_browser/static/*.js"), *PLUGIN.glob("txt1_browser/*.mjs")]
    scripts = (line.strip() for file in files for line in file.read_text().splitlines())
    of_python = sum(statements(file) for file in (PLUGIN / "txt1_browser").glob("*.py"))
    return of_python + sum(bool(line) and not line.startswith("//") for line in scripts)


def in_time(count: int, missed: int) -> str:
    """The share of cycles that were not missed."""
    return f"{100.0 * (1.0 - missed / (count + missed)):.2f} %"


def main() -> None:
    """Measure, print, and write the page."""
    parser = argparse.ArgumentParser(prog="benchmarks.browser", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="starts, and stops of each kind; 5")
    parser.add_argument("--seconds", type=float, default=60.0, help="of driving in which cycles are counted; 60")
    parser.add_argument("--pyodide", type=Path, metavar="FOLDER", help="in place of npm's")
    parser.add_argument("--page", action="store_true", help="write the tables to plugins/browser/README.md")
    arguments = parser.parse_args()
    with TemporaryDirectory() as temporary, sync_playwright() as playwright:
        folder = Path(temporary, "site")
        build(folder, arguments.pyodide, print)
        files = [each for each in folder.rglob("*") if each.is_file() and each.parent.name != "pyodide"]
        size = sum(each.stat().st_size for each in files) / 1e6

        def browsing(measure: Callable[[Any], Any]) -> Any:
            # a browser of its own, so that none has another's killed renderers
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
            try:
                return measure(browser)
            finally:
                browser.close()

        with serving(folder) as url:
            begun = browsing(lambda browser: starts(browser, url, arguments.rounds))
            fast = browsing(lambda browser: speed(browser, folder, url))
            here = in_time(*browsing(lambda browser: cycles(browser, url, arguments.seconds)))
            desk = in_time(*desk_cycles(arguments.seconds))
            rows = [
                ("s from the address to the first motion, warm cache: median (worst)", _worst(begun), "10"),
                ("MB to load beyond Pyodide's own", f"{size:.1f}", "12"),
                ("speed of a simulation that is verified, times real time", f"{fast:.0f}", "at least 10"),
                (f"cycles of 20 ms met in a visible tab (on a desk {desk})", here, "at least 99.9 %"),
                ("statements, and lines of JavaScript", str(lines_of_code()), "900"),
            ]
            lines = ["| figure | measured | limit |", "|---|--:|--:|", *(f"| {' | '.join(row)} |" for row in rows)]
            lines += ["", "| the browser is | board | s at its full speed: median (worst) |", "|---|---|--:|"]
            for name, what in (("stopped", signal.SIGSTOP), ("killed", signal.SIGKILL)):
                for habits in ("ours", "original"):
                    late = [
                        browsing(lambda browser, h=habits, w=what: stopped(browser, folder, url, h, w))  # type: ignore[misc]
                        for _ in range(arguments.rounds)
                    ]
                    lines.append(f"| **red: {name}** | {habits} | {_worst(late)} |")
    load = os.getloadavg()[0]
    day = f"{datetime.now(UTC):%Y-%m-%d}"
    lines += [
        "",
        f"{os.cpu_count()} processors, load {load:.1f} after it, {day}. The board is virtual. In a row that is red",
        "nothing of txt1 can stop the car: the board's own time-out does, from its last command.",
    ]
    text = "\n".join(lines)
    print(text)
    if arguments.page:
        page_parts.write(PLUGIN / "README.md", "measured", text, "benchmarks.browser")


def _worst(values: list[float]) -> str:
    return f"{median(values):.2f} ({max(values):.2f})"


if __name__ == "__main__":
    main()
