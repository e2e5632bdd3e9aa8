"""The page's map shows the walls of a map."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rigs.live_browser import Live, live
from tests.browser.conftest import fresh, opened

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


@pytest.fixture(scope="module")
def car(folder: Path) -> Iterator[Live]:
    with live(("sim.room.map=flat",), folder=folder) as here:
        yield here


def test_the_map_on_the_page_shows_the_whole_flat(browser: Any, car: Live) -> None:
    for page in opened(browser, car):
        page.wait_for_function(f"() => {{ const [x, y] = ({EXTENT})(); return Math.abs(x / y - 11.0 / 8.5) < 0.02 }}")


@pytest.fixture(scope="module")
def mapper(folder: Path) -> Iterator[Live]:
    pytest.importorskip("numba", reason="a map is made by the extra 'mapping'")
    make = f"mapping.make={folder / 'made'}"
    with live(("sensors.laser.driver=sim_laser", make), folder=folder) as here:
        yield here


def test_the_map_in_the_making_is_drawn_with_the_robot_on_it(browser: Any, mapper: Live) -> None:
    page = fresh(browser)
    page.goto(mapper.url)
    page.wait_for_function("() => /^map  x/.test(document.getElementById('where').textContent)")
    page.wait_for_function(f"() => {{ const [x, y] = ({EXTENT})(); return x > 100 && y > 100 }}")
    page.context.close()
