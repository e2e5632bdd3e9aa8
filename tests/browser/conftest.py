"""Debian's chromium, driven by playwright. `make test-web` installs both; without them these tests are skipped."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rigs.live_browser import CHROMIUM, FLAGS, Live, live
from tests.patience import LIMIT


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: make test-web does it")
    if CHROMIUM is None:
        pytest.skip("there is no chromium: apt-get install chromium, as make test-web does")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def car(folder: Path) -> Iterator[Live]:
    """A simulated robot in a room with two obstacles, and its page."""
    box, post = "{kind: box, x: 1.5, y: 1.2, length: 0.5, width: 0.4}", "{kind: post, x: -1.2, y: 1.0, radius: 0.15}"
    room = ("sim.room.length=6", "sim.room.width=6", f"sim.obstacles=[{box}, {post}]")
    with live(room, folder=folder) as here:
        yield here


@pytest.fixture
def page(browser: Any, car: Live) -> Iterator[Any]:
    """A page at 1280 x 800 that hears the robot, which is armed and stands in the middle."""
    yield from opened(browser, car)


def fresh(browser: Any, **about: Any) -> Any:
    """A blank page in a context of its own, 1280 x 800."""
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **about})
    context.set_default_timeout(1000.0 * LIMIT)
    return context.new_page()


def opened(browser: Any, car: Live, **about: Any) -> Iterator[Any]:
    car.until(lambda robot: robot.odometry.v == 0.0)
    car.call(lambda robot: robot.place(0.0, 0.0, 0.0) if robot.hal.capabilities.place else None)
    errors: list[str] = []
    page = fresh(browser, **about)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.goto(car.url)
    # not before: a page sends its stop again until it is confirmed, and the last copy may come after the page has gone
    car.call(lambda robot: robot.arm())
    page.wait_for_function("() => document.getElementById('state').textContent === 'armed'")
    page.wait_for_function("() => document.getElementById('link').textContent.endsWith('ms')")
    yield page
    page.context.close()
    assert not errors


def waits(page: Any, condition: str, limit: float = LIMIT) -> bool:
    """Whether something comes true of a page."""
    try:
        page.wait_for_function(condition, timeout=1000 * limit)
        return True
    except Exception:
        return False
