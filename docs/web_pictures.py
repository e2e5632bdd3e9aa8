"""Makes the pictures of docs/web.md from a live page: `python -m docs.web_pictures [NAME ...]`.

A simulated robot drives in a room, and Debian's chromium, through playwright, looks at its page.
"""

from __future__ import annotations

import sys
from pathlib import Path
from time import sleep
from typing import Any, Final

from playwright.sync_api import sync_playwright

from tests.browser.live import CHROMIUM, FLAGS, Live, live

FOLDER: Final = Path(__file__).parent / "web"
BOX: Final = "{kind: box, x: 1.6, y: 1.5, length: 0.6, width: 0.4, theta: 0.4}"
POST: Final = "{kind: post, x: -1.4, y: 1.2, radius: 0.2}"
ROOM: Final = (
    "sim.room.length=7", "sim.room.width=6", "sim.room.light=[-2.0, -1.5]", f"sim.obstacles=[{BOX}, {POST}]",
    "sensors.laser.driver=sim_laser",
)  # fmt: skip
PICTURES: Final = {
    "wide-light": ((1280, 800), "light", "events"),
    "wide-dark": ((1280, 800), "dark", "tasks"),
    "tall-light": ((390, 844), "light", "events"),
    "tall-dark": ((390, 844), "dark", "events"),
}


def centre(page: Any, selector: str) -> tuple[float, float]:
    """The middle of something on the page, in pixels."""
    box = page.locator(selector).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drive(page: Any, steps: tuple[tuple[float, float, float], ...]) -> None:
    """Hold the stick: pixels to the right and down, and for how many s."""
    x, y = centre(page, "#stick")
    page.mouse.move(x, y)
    page.mouse.down()
    for dx, dy, seconds in steps:
        page.mouse.move(x + dx, y + dy, steps=4)
        page.wait_for_timeout(1000 * seconds)


def shoot(browser: Any, car: Live, name: str) -> None:
    """Make one picture, the robot on its way."""
    (width, height), scheme, tab = PICTURES[name]
    car.call(lambda robot: robot.arm())
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
    page = context.new_page()
    page.goto(car.url)
    page.wait_for_function("() => document.getElementById('link').textContent.endsWith('ms')")
    page.locator(f"[data-tab={tab}]").click()
    page.evaluate("scrollTo(0, 0)")
    car.call(lambda robot: robot.place(-1.5, -0.8, 0.2))
    drive(page, ((0, -50, 2.5), (-30, -45, 2.5), (35, -45, 2.5), (0, -55, 1.0)))
    page.screenshot(path=FOLDER / f"{name}.png")
    page.mouse.up()
    car.until(lambda robot: robot.odometry.v == 0.0)
    context.close()


def main() -> None:
    """Make them all, or those named."""
    FOLDER.mkdir(exist_ok=True)
    with live(ROOM) as car, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        sleep(1.5)
        for name in sys.argv[1:] or PICTURES:
            shoot(browser, car, name)
        browser.close()


if __name__ == "__main__":
    main()
