"""How soon the page is there, its size on the wire, how often its map is drawn: ``python -m benchmarks.web_page``.

In a real browser without a window (Debian's chromium through playwright), each time with nothing kept from before, on
the robot's own machine; while frames are counted a hand on the stick drives the robot. Half a minute.
"""

from __future__ import annotations

import argparse
import os
from typing import Any, Final

from playwright.sync_api import sync_playwright

from benchmarks.rounds import spread, table, verdict
from benchmarks.web_car import car
from rigs.live_browser import CHROMIUM, FLAGS

SIZES: Final = {"1280 x 800": (1280, 800), "390 x 844, a phone's": (390, 844)}
PAINT: Final = 1000.0  # ms, at most
WIRE: Final = 300.0  # kB, at most
FRAMES: Final = 30  # a second, at least
HEAD: Final = ("page", "loaded", "first paint, ms", "on the wire, kB", "frames a second of the map")
COUNT: Final = """() => {
  const rows = [...document.querySelectorAll("#panel tr")]
  return Number(rows.find((row) => row.cells[0].textContent.startsWith("frames")).cells[1].textContent)
}"""


def load(browser: Any, url: str, size: tuple[int, int]) -> tuple[float, float]:
    """The first paint, ms, and what went over the wire, kB, until the robot's state is shown."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    session = context.new_cdp_session(page)
    session.send("Network.enable")
    received: list[float] = []
    session.on("Network.loadingFinished", lambda event: received.append(event["encodedDataLength"]))
    page.goto(url)
    page.wait_for_function("() => document.getElementById('state').textContent === 'armed'")
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    context.close()
    return paint, sum(received) / 1000.0


def frames(browser: Any, url: str, size: tuple[int, int], seconds: int) -> list[float]:
    """How often the map was drawn in each of so many seconds."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    page.goto(url)
    page.wait_for_function("() => document.getElementById('state').textContent === 'armed'")
    page.locator("[data-tab=page]").click()
    page.evaluate("scrollTo(0, 0)")
    page.locator("#stick").scroll_into_view_if_needed()
    box = page.locator("#stick").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 40)
    found = []
    page.wait_for_timeout(2000)
    for second in range(seconds):
        # a hand that does not move is let go of
        page.mouse.move(box["x"] + box["width"] / 2 + second % 2, box["y"] + 40)
        page.wait_for_timeout(1000)
        found.append(page.evaluate(COUNT))
    page.mouse.up()
    context.close()
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.web_page", description=__doc__)
    parser.add_argument("--loads", type=int, default=20, help="of each size")
    parser.add_argument("--seconds", type=int, default=8, help="in which frames are counted")
    arguments = parser.parse_args()
    rows, paints, wires, counts = [], [], [], []
    with car() as robot, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        for name, size in SIZES.items():
            loads = [load(browser, robot.url, size) for _ in range(arguments.loads)]
            drawn = frames(browser, robot.url, size, arguments.seconds)
            paints += [paint for paint, _ in loads]
            wires += [wire for _, wire in loads]
            counts += drawn
            rows.append(
                (
                    name,
                    str(len(loads)),
                    spread([paint for paint, _ in loads], 0),
                    spread([wire for _, wire in loads], 1),
                    spread(drawn, 0),
                )
            )
        version = browser.version
        browser.close()
    table("the page in a browser: median (least .. most)", HEAD, rows)
    text = (
        f"First paint within {PAINT:.0f} ms: {verdict(max(paints) <= PAINT)}; at most {WIRE:.0f} kB: "
        f"{verdict(max(wires) <= WIRE)}; {FRAMES} frames a second in the median: "
        f"{verdict(sorted(counts)[len(counts) // 2] >= FRAMES)}. Chromium {version} without a graphics card; the load "
        f"of this machine of {os.cpu_count()} processors was {os.getloadavg()[0]:.1f}."
    )
    print(f"\n{text}")


if __name__ == "__main__":
    main()
