"""Makes the pictures of docs/web.md and of the README from a live page: `python -m docs.web_pictures [NAME ...]`.

A simulated robot drives in a room, and Debian's chromium, through playwright, looks at its page. "drive" is the moving
picture: pictures of the page, one after the other, shown at about twice the robot's speed.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from functools import partial
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep
from typing import Any, Final

from PIL import Image
from playwright.sync_api import sync_playwright

from rigs.live_browser import CHROMIUM, FLAGS, Live, arrive, command, live
from txt1.navigation import follow

FOLDER: Final = Path(__file__).parent / "web"
BOX: Final = "{kind: box, x: 1.6, y: 1.5, length: 0.6, width: 0.4, theta: 0.4}"
POST: Final = "{kind: post, x: -1.4, y: 1.2, radius: 0.2}"
ROOM: Final = (
    "sim.room.length=7",
    "sim.room.width=6",
    "sim.room.light=[-2.0, -1.5]",
    f"sim.obstacles=[{BOX}, {POST}]",
    "sensors.laser.driver=sim_laser",
)
PICTURES: Final = {
    "wide-light": ((1280, 800), "light", "events"),
    "wide-dark": ((1280, 800), "dark", "tasks"),
    "tall-light": ((390, 844), "light", "events"),
    "tall-dark": ((390, 844), "dark", "events"),
}

ROUND: Final = ((0.8, 0.0), (1.4, 0.9), (3.0, 1.4), (4.6, 1.0), (5.0, -0.4), (4.4, -1.5), (3.0, -1.7), (1.2, -1.4))
"""m: a way round the table in config/maps/laboratory.yaml."""
FASTER: Final = 2.0  # times real time, in the moving picture

FLEET: Final = """\
all: {sim: {room: {length: 10, width: 7}}, safety: {missed_ticks_max: 100000}}
robots:
  txt01: {start: [-3, 1.5, 0], drive: [0.5, 0.6]}
  txt02: {start: [2.5, 1, 0], drive: [0.5, 0.5]}
""" + "".join(f"  txt{k:02}: {{start: [{x}, -2, 1.57]}}\n" for k, x in zip(range(3, 11), range(-4, 4), strict=True))


def centre(page: Any, selector: str) -> tuple[float, float]:
    """The middle of something on the page, in pixels."""
    box = page.locator(selector).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drive(page: Any, steps: tuple[tuple[float, float, float], ...], begin: Callable[[], object]) -> None:
    """Hold the stick: pixels to the right and down, and for how many s; anew where a busy computer had it let go."""
    x, y = centre(page, "#stick")
    for _ in range(5):
        begin()
        page.mouse.move(x, y)
        page.mouse.down()
        for dx, dy, seconds in steps:
            page.mouse.move(x + dx, y + dy, steps=4)
            page.wait_for_timeout(1000 * seconds)
        if page.locator("#stick.held").count():
            return
        page.mouse.up()


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
    place = partial(car.call, lambda robot: robot.place(-1.5, -0.8, 0.2))
    drive(page, ((0, -50, 2.5), (-30, -45, 2.5), (35, -45, 2.5), (0, -55, 1.0)), place)
    page.screenshot(path=FOLDER / f"{name}.png")
    page.mouse.up()
    car.until(lambda robot: robot.odometry.v == 0.0)
    context.close()


def shoot_drive(browser: Any) -> None:
    """The moving picture: round the table of the laboratory's map, seen by the laser."""
    settings = ("sim.room.map=laboratory", "sensors.laser.driver=sim_laser", "safety.missed_ticks_max=100000")
    with live(settings) as car:
        # at this width, the speed's legend has its place beside the speed
        page = browser.new_page(viewport={"width": 1120, "height": 640}, color_scheme="light")
        arrive(page, car.url)
        page.wait_for_timeout(1500)
        way = asyncio.run_coroutine_threadsafe(follow(car.robot, ROUND, speed=0.6), car.loop)
        pictures, times = [], []
        while not way.done():
            times.append(car.call(lambda robot: robot.now))
            pictures.append(Image.open(BytesIO(page.screenshot())).convert("RGB"))
        page.close()
    shown = [round(1000 * (b - a) / FASTER) for a, b in pairwise(times)]
    pictures[0].save(
        FOLDER / "drive.webp",
        save_all=True,
        append_images=pictures[1:],
        duration=[*shown, 2000],  # the last one stays for a moment
        loop=0,
        quality=50,
        method=4,
    )


def shoot_fleet(browser: Any) -> None:
    """Ten robots in one room, two of them on a circle, one driven from the page."""
    with TemporaryDirectory() as folder:
        plan = Path(folder, "fleet.yaml")
        plan.write_text(FLEET)
        with command("fleet", str(plan)) as url:
            page = browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme="light")
            arrive(page, url)
            page.wait_for_function("() => document.getElementById('robots').options.length === 10")
            page.locator("#robots").select_option("txt03")
            page.wait_for_function("() => document.getElementById('state').textContent === 'armed'")
            drive(page, ((0, -50, 2.0), (-30, -45, 1.5)), lambda: None)
            page.screenshot(path=FOLDER / "fleet.png")
            page.mouse.up()
            page.close()


def shoot_learner(browser: Any) -> None:
    """A learner at its sixteenth episode, eight times as fast as in reality."""
    room = ("sim.room.length=6", "sim.room.width=6")
    settings = [word for setting in room for word in ("--set", setting)]
    with command("run", "--hal", "sim", "--learn", "sweeps", "--seed", "1", "--speed", "8", *settings) as url:
        page = browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme="light")
        arrive(page, url)
        page.locator("[data-tab=learner]").click()
        page.wait_for_function(
            "() => /^episode 15:/m.test(document.getElementById('panel').innerText)", timeout=300_000
        )
        page.wait_for_timeout(1000)
        page.screenshot(path=FOLDER / "learner.png")
        page.close()


def main() -> None:
    """Make them all, or those named."""
    FOLDER.mkdir(exist_ok=True)
    known = [*PICTURES, "drive", "fleet", "learner"]
    names = sys.argv[1:] or known
    if strange := sorted(set(names) - set(known)):
        sys.exit(f"{strange[0]}: there is no such picture; there are: {', '.join(known)}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        if some := [name for name in names if name in PICTURES]:
            with live(ROOM) as car:
                sleep(1.5)
                for name in some:
                    shoot(browser, car, name)
        if "drive" in names:
            shoot_drive(browser)
        if "fleet" in names:
            shoot_fleet(browser)
        if "learner" in names:
            shoot_learner(browser)
        browser.close()


if __name__ == "__main__":
    main()
