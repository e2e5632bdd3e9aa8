"""The hand rule on the page: the numbers of `txt1.control.hand`, of the car that it shows."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random
from typing import Any

import pytest

from rigs.live_browser import Live, live
from tests.browser.conftest import opened
from txt1.config import load
from txt1.control.hand import shaped

pytestmark = pytest.mark.browser

WIDE = ("sim.room.length=12", "sim.room.width=12")

RULE = """async (cases) => {
  const { axes, shaped, velocity } = await import("/hand.js")
  return cases.map(([hand, speed, ahead, left, wheel]) => {
    const command = velocity(hand, speed, shaped(ahead), shaped(left), wheel)
    return [command.v, command.omega, axes(hand, speed, command).ahead]
  })
}"""


@pytest.fixture(scope="module")
def rover() -> Iterator[Live]:
    with live(("vehicle=rover", *WIDE)) as here:
        yield here


@pytest.fixture
def page(browser: Any, rover: Live) -> Iterator[Any]:
    yield from opened(browser, rover)


def test_the_page_computes_what_the_robot_s_own_rule_says(page: Any) -> None:
    random, cases = Random(1), []
    for name in ("txt1", "donkeycar", "f1tenth", "rover"):
        hand = load(None, [f"vehicle={name}"], {}, {}).config.hand()
        for ahead in (-1.0, -0.05, 0.0, 1.0, *(random.uniform(-1.1, 1.1) for _ in range(20))):
            left, speed = random.uniform(-1.1, 1.1), random.uniform(0.1, 4.0)
            cases += [(hand, speed, ahead, left, wheel) for wheel in (False, True)]
    told = page.evaluate(RULE, [[hand._asdict(), *rest] for hand, *rest in cases])
    for (hand, speed, ahead, left, wheel), (v, omega, shown) in zip(cases, told, strict=True):
        assert (v, omega) == pytest.approx(hand.velocity(speed, shaped(ahead), shaped(left), wheel=wheel), abs=1e-12)
        assert shown == pytest.approx(shaped(ahead), abs=1e-12)


@pytest.mark.parametrize("how", ["stick", "keys"])
def test_a_rover_turns_in_place_by_the_page(page: Any, rover: Live, how: str) -> None:
    for _ in range(10):
        if how == "keys":
            page.keyboard.down("a")
        else:
            box = page.locator("#stick").bounding_box()
            page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            page.mouse.down()
            page.mouse.move(box["x"], box["y"] + box["height"] / 2, steps=3)
        try:
            rover.until(lambda robot: robot.runtime.state.control.omega > 1.0 and robot.runtime.state.control.v == 0.0)
            break
        except TimeoutError:  # a busy computer had the page let go
            page.keyboard.up("a")
            page.mouse.up()
    else:
        raise AssertionError("it does not turn")
    page.keyboard.up("a")
    page.mouse.up()
    rover.until(lambda robot: robot.runtime.state.control.omega == 0.0)


def test_a_car_s_own_speed_and_circle_are_told_to_its_page(browser: Any) -> None:
    with live(("vehicle=f1tenth", *WIDE)) as car:
        for page in opened(browser, car):
            page.wait_for_function("() => document.getElementById('speed').max === '3'")
