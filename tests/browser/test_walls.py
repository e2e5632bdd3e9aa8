"""The page's map shows the walls of a map."""

from collections.abc import Iterator
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigs.live_browser import Live, live
from tests.browser.conftest import fresh, opened, waits
from tests.patience import LIMIT, S, wait_until
from txt1.exploring.explorer import FRONTIERS, Frontiers
from txt1.maps.files import read
from txt1.maps.outlines import outlines

pytestmark = pytest.mark.browser
# how wide and how high is what is drawn in the colour of walls, pixels of the canvas
EXTENT = """() => {
    const canvas = document.getElementById("map"), { width, height } = canvas
    const data = canvas.getContext("2d").getImageData(0, 0, width, height).data
    const brush = document.createElement("canvas").getContext("2d")
    brush.fillStyle = getComputedStyle(canvas).getPropertyValue("--wall")
    brush.fillRect(0, 0, 1, 1)
    const [r, g, b] = brush.getImageData(0, 0, 1, 1).data
    const xs = [], ys = []
    for (let k = 0; k < width * height; k++)
        if (Math.abs(data[4 * k] - r) + Math.abs(data[4 * k + 1] - g) + Math.abs(data[4 * k + 2] - b) < 12
            && data[4 * k + 3] > 200) xs.push(k % width), ys.push(Math.floor(k / width))
    const most = (values) => values.reduce((found, v) => Math.max(found, v), -1e9)
    const span = (values) => most(values) + most(values.map((v) => -v))
    return xs.length > 500 ? [span(xs), span(ys)] : [0, 1]
}"""
# the same for what is drawn in the colour of goals, of which there is less
GOALS = EXTENT.replace("--wall", "--goal").replace("500", "20")

# a robot that is told a wrong place is drawn there, or lost
ELSEWHERE = "() => !/^map  x -?0.[01]/.test(document.getElementById('where').textContent)"


@pytest.fixture(scope="module")
def car(folder: Path) -> Iterator[Live]:
    with live(("sim.room.map=flat",), folder=folder) as here:
        yield here


def test_the_map_on_the_page_shows_the_whole_flat(browser: Any, car: Live) -> None:
    for page in opened(browser, car):
        page.wait_for_function(f"() => {{ const [x, y] = ({EXTENT})(); return Math.abs(x / y - 11.0 / 8.5) < 0.02 }}")


@pytest.fixture(scope="module")
def mapper(folder: Path) -> Iterator[Live]:
    pytest.importorskip("numba", reason="a map is made by the extra 'fast'")
    make = f"mapping.make={folder / 'made'}"
    with live(("sensors.laser.driver=sim_laser", make), folder=folder) as here:
        yield here


def test_the_map_in_the_making_is_drawn_with_the_robot_on_it(browser: Any, mapper: Live) -> None:
    page = fresh(browser)
    page.goto(mapper.url)
    page.wait_for_function("() => /^map  x/.test(document.getElementById('where').textContent)")
    page.wait_for_function(f"() => {{ const [x, y] = ({EXTENT})(); return x > 100 && y > 100 }}")
    page.context.close()


def test_the_frontiers_of_a_robot_that_explores_are_drawn(browser: Any, mapper: Live) -> None:
    page = fresh(browser)
    page.goto(mapper.url)
    page.wait_for_function("() => /^map  x/.test(document.getElementById('where').textContent)")
    assert page.evaluate(f"({GOALS})()") == [0, 1]
    # a door, and the robot drives to its middle
    shown = Frontiers(tuple((1.0, 0.05 * k) for k in range(-10, 11)), (1.0, 0.0))
    mapper.call(lambda robot: robot.runtime.bus.offer(FRONTIERS, lambda: shown))
    page.wait_for_function(f"() => {{ const [x, y] = ({GOALS})(); return x > 5 && y > 20 }}")
    mapper.call(lambda robot: robot.runtime.bus.offer(FRONTIERS, Frontiers))
    page.wait_for_function(f"() => ({GOALS})()[0] === 0")
    page.context.close()


@pytest.fixture(scope="module")
def located(folder: Path) -> Iterator[Live]:
    pytest.importorskip("numba", reason="a robot finds itself by the extra 'fast'")
    room = ("sim.room.map=laboratory", "mapping.room=laboratory")
    with live(("sensors.laser.driver=sim_laser", *room), folder=folder) as here:
        yield here


def tap(page: Any, x: float, y: float) -> None:
    """Tap a place on the map, m: its walls fill the picture, but for a margin and a line of text."""
    corners = np.concatenate([np.array(line) for line in outlines(read("laboratory").grid)])
    (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
    box = page.locator("#map").bounding_box()
    scale = min((box["width"] - 24) / (right - left), (box["height"] - 64) / (high - low))
    middle_x, middle_y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.click(middle_x + scale * (x - (left + right) / 2), middle_y - scale * (y - (low + high) / 2))


def where(x: float, y: float, within: float) -> str:
    """JavaScript: whether the page says that the robot is there on the map."""
    found = "/^map  x (\\S+)  y (\\S+) m/.exec(document.getElementById('where').textContent)"
    return f"() => {{ const at = {found}; return at && Math.hypot(at[1] - {x}, at[2] - {y}) < {within} }}"


def sent(page: Any, car: Live, x: float, y: float) -> bool:
    """Send the robot to a place; returns whether it comes to rest there before a stall of the machine ends its way."""

    def ended() -> float:
        events = car.call(lambda robot: list(robot.runtime.state.events))
        return max((event.time for event in events if "the route was ended" in event.text), default=0.0)

    def rests(robot: Any) -> bool:
        return hypot(robot.pose[0] - x, robot.pose[1] - y) < 0.2 and robot.odometry.v == 0.0

    before = ended()
    page.locator("#waypoints").click()
    tap(page, x, y)
    page.locator("#go").click()
    for _ in range(15):
        page.wait_for_timeout(1000.0 * S)
        if car.call(rests) and waits(page, where(x, y, 0.2), S):
            return True
        if ended() > before:
            break
    return False


def put(page: Any, condition: str, *places: tuple[float, float]) -> bool:
    """Say where the robot is; returns whether that comes true: on a busy computer the page may say it too late."""
    page.locator("#waypoints").click()
    for place in places:
        tap(page, *place)
    page.locator("#here").click()
    return waits(page, condition, 15.0 * S)


def test_taps_say_where_the_robot_is_on_its_map_and_take_it_to_a_goal(browser: Any, located: Live) -> None:
    for page in opened(browser, located):
        page.wait_for_function(where(0.0, 0.0, 0.2))
        wait_until(lambda page=page: put(page, ELSEWHERE, (3.0, 2.0)))
        wait_until(lambda page=page: put(page, where(0.0, 0.0, 0.2), (0.0, 0.0), (1.0, 0.0)))
        wait_until(lambda page=page: sent(page, located, 1.0, 0.0), 2.0 * LIMIT)  # each stall ends its way
