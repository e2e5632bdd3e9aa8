"""Holds on the page: a hand that has gone is noticed, whatever the browser tells of it.

The keys, the mouse and the finger are the browser's own input events (DevTools protocol); the robot is simulated, and
its set-points and its way are measured behind the page's real connection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import monotonic
from typing import Any

import pytest

from rigs.browser_hands import ALT, CONTROL, META, PAD, SHIFT, A, B, W, at, down, finger, hands, repeats, up
from rigs.live_browser import Live, live
from tests.browser.conftest import opened
from tests.patience import LIMIT, S

pytestmark = pytest.mark.browser

LASTS = 3.0
"""s that a hold lasts without a sign of a hand."""
ENDS = 0.3
"""s within which a hold ends otherwise than by its release."""
LATE = 0.5 * S
"""s that a busy computer may add."""


@pytest.fixture(scope="module")
def car() -> Iterator[Live]:
    """A simulated robot in a long hall, and its page."""
    with live(("sim.room.length=60", "sim.room.width=10")) as here:
        yield here


@pytest.fixture
def page(browser: Any, car: Live) -> Iterator[Any]:
    for page in opened(browser, car):
        yield hands(page)


def moves(robot: Any) -> bool:
    return bool(abs(robot.runtime.state.control.v) > 0.2)


def begins(page: Any, car: Live, press: Callable[[], None], release: Callable[[], None]) -> float:
    """Press until it drives; the time of the press, monotonic. A busy computer has the page let go of a press."""
    for _ in range(10):
        pressed = monotonic()
        press()
        try:
            car.until(moves, 2.0 * S)
            return pressed
        except TimeoutError:
            release()
    raise AssertionError("it does not drive")


def by_w(page: Any, car: Live) -> float:
    return begins(page, car, lambda: down(page, *W), lambda: up(page, *W))


def drove(car: Live, since: float) -> float:
    """The last moment since then at which the set-point was not zero, in s from then; 0 if there is none."""
    samples = [each.time for each in car.samples[:] if each.time > since and (each.v or each.omega)]
    return max(samples, default=since) - since


def context_menu(page: Any) -> None:
    box = page.locator("#map").bounding_box()
    at = {"x": box["x"] + 30, "y": box["y"] + 30, "button": "right", "clickCount": 1}
    page.input.send("Input.dispatchMouseEvent", {"type": "mousePressed", **at})


def another_window(page: Any) -> None:
    """The focus goes to a window inside the page: playwright has every page believe that it is in front."""
    page.evaluate("document.body.append(document.createElement('iframe')); document.body.lastChild.focus()")


FIELD = "document.body.append(document.createElement('input')); document.body.lastChild.focus()"
TAKES_THE_RELEASE: dict[str, Callable[[Any], None]] = {
    "Command": lambda page: down(page, "Meta", "MetaLeft", 91, META),
    "Option": lambda page: down(page, "Alt", "AltLeft", 18, ALT),
    "Control": lambda page: down(page, "Control", "ControlLeft", 17, CONTROL),
    "AltGr": lambda page: down(page, "AltGraph", "AltRight", 225),
    "another layout": lambda page: down(page, "z", "KeyW", 90, repeat=True),
    "an input method": lambda page: down(page, "Process", "KeyW", 229, repeat=True),
    "a context menu": context_menu,
    "another window": another_window,
    "a text field": lambda page: page.evaluate(FIELD),
}


@pytest.mark.parametrize("what", TAKES_THE_RELEASE)
def test_a_key_lets_go_when_its_release_may_never_be_told(page: Any, car: Live, what: str) -> None:
    by_w(page, car)
    struck = monotonic()
    TAKES_THE_RELEASE[what](page)
    took = monotonic() - struck
    repeats(page, W, 0.6)
    assert drove(car, struck) < took + ENDS + LATE, "it lets go, and repeats do not revive it"
    for key in (("Meta", "MetaLeft", 91), ("Alt", "AltLeft", 18), ("Control", "ControlLeft", 17)):
        up(page, *key)
    page.evaluate("document.activeElement.blur()")
    by_w(page, car)
    up(page, *W)


@pytest.mark.parametrize(
    ("key", "code", "number", "modifiers"),
    [("W", "KeyW", 87, SHIFT), ("∑", "KeyW", 87, ALT), ("z", "KeyW", 90, 0), ("Unidentified", "KeyW", 0, 0)],
)
def test_a_key_goes_up_by_its_place_under_whatever_name(
    page: Any, car: Live, key: str, code: str, number: int, modifiers: int
) -> None:
    by_w(page, car)
    released = monotonic()
    up(page, key, code, number, modifiers)
    page.wait_for_timeout(500)
    assert drove(car, released) < ENDS + LATE


def test_shift_does_not_let_go_as_plus_needs_it(page: Any, car: Live) -> None:
    for _ in range(5):
        by_w(page, car)
        down(page, "Shift", "ShiftLeft", 16, SHIFT)
        down(page, "W", "KeyW", 87, SHIFT, repeat=True)
        pressed = monotonic()
        page.wait_for_timeout(600)
        up(page, "Shift", "ShiftLeft", 16)
        up(page, *W)
        if drove(car, pressed) > 0.5:
            return
    raise AssertionError("it lets go")


FAST = "speed.value = 1.5; speed.dispatchEvent(new Event('input'))"


@pytest.mark.parametrize("slower", [1, 4])
def test_a_key_whose_release_is_lost_drives_for_three_seconds(page: Any, car: Live, slower: int) -> None:
    page.input.send("Emulation.setCPUThrottlingRate", {"rate": slower})
    page.evaluate(FAST)
    for _ in range(5):
        pressed = by_w(page, car)
        from_here = car.call(lambda robot: robot.pose[0])
        repeats(page, W, LASTS + 1.0)
        assert drove(car, pressed) < LASTS + ENDS + LATE
        way = car.call(lambda robot: robot.pose[0]) - from_here
        assert way < 1.5 * (LASTS + ENDS + LATE) + 1.0
        page.input.send("Emulation.setCPUThrottlingRate", {"rate": 1})
        up(page, *W)
        if way > 0.3:
            return
        # the page was so late that the hold ended before
        page.input.send("Emulation.setCPUThrottlingRate", {"rate": slower})
    raise AssertionError("a held key does not drive")


def test_another_driving_key_renews_the_hold(page: Any, car: Live) -> None:
    for _ in range(5):
        pressed = by_w(page, car)
        for _ in range(4):
            page.wait_for_timeout(1000)
            down(page, "d", "KeyD", 68)
            page.wait_for_timeout(100)
            up(page, "d", "KeyD", 68)
        lasted = drove(car, pressed)
        up(page, *W)
        if lasted > LASTS + 1.0:
            return
    raise AssertionError("a hand that presses keys loses its hold")


def by_mouse(page: Any, car: Live) -> float:
    x, y = at(page, "#stick")

    def press() -> None:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x, y - 80)

    return begins(page, car, press, page.mouse.up)


def by_finger(page: Any, car: Live) -> float:
    x, y = at(page, "#stick")

    def press() -> None:
        finger(page, "touchStart", (x, y))
        finger(page, "touchMove", (x, y - 80))

    return begins(page, car, press, lambda: finger(page, "touchEnd"))


def by_pad(page: Any, car: Live, index: int = 0) -> float:
    page.evaluate(f"pads[{index}].axes = [0, -1, 0, 0]")
    page.wait_for_timeout(700)  # it may just have appeared
    return begins(
        page,
        car,
        lambda: page.evaluate(f"press({A}, 1, {index})"),
        lambda: [page.evaluate(f"press({A}, 0, {index})"), page.wait_for_timeout(200)],
    )


BY: dict[str, Callable[[Any, Live], float]] = {"mouse": by_mouse, "finger": by_finger, "pad": by_pad}


@pytest.mark.parametrize("by", BY)
def test_a_stick_that_rests_at_its_stop_for_ten_seconds(browser: Any, car: Live, by: str) -> None:
    for page in opened(browser, car, has_touch=True):
        hands(page).evaluate(PAD)
        for _ in range(5):
            pressed = BY[by](page, car)
            page.wait_for_timeout(10_000)
            lasted = drove(car, pressed)
            assert lasted < LASTS + ENDS + LATE
            if lasted > LASTS - 0.5:
                break
            # a busy computer had the page let go
            page.mouse.up()
            finger(page, "touchCancel")
            page.evaluate(f"press({A}, 0)")
        else:
            raise AssertionError("a hand that rests is let go of at once")


def test_a_stick_that_moves_keeps_its_hold(page: Any, car: Live) -> None:
    for _ in range(5):
        pressed, (x, y) = by_mouse(page, car), at(page, "#stick")
        for step in range(45):
            page.wait_for_timeout(100)
            page.mouse.move(x + step % 2, y - 80)
        lasted = drove(car, pressed)
        page.mouse.up()
        if lasted > LASTS + 1.0:
            return
    raise AssertionError("a hand that moves loses its hold")


def test_another_hand_drives_after_zero_and_from_a_fresh_press_alone(page: Any, car: Live) -> None:
    for _ in range(5):
        by_w(page, car)
        began = monotonic()
        by_mouse(page, car)
        if 0.0 in [each.v for each in car.samples[:] if each.time > began]:
            break
        # a busy computer brought the zero and what followed it in one tick
        page.mouse.up()
        up(page, *W)
    else:
        raise AssertionError("a change of hands passes through zero")
    page.mouse.up()
    released = monotonic()
    repeats(page, W, 0.5)
    assert drove(car, released) < ENDS + LATE, "the key that is still down needs a fresh press"
    up(page, *W)


def test_the_release_of_any_dead_man_ends_every_hold(page: Any, car: Live) -> None:
    page.evaluate(PAD)
    page.evaluate("plug(1)")
    by_pad(page, car, 0)
    by_pad(page, car, 1)
    released = monotonic()
    page.evaluate(f"press({A}, 0, 0)")
    page.wait_for_timeout(500)
    assert drove(car, released) < ENDS + LATE


@pytest.mark.parametrize("mapping", ["standard", ""])
def test_every_pad_may_stop(page: Any, car: Live, mapping: str) -> None:
    page.evaluate(PAD)
    page.evaluate(f"plug(2, '{mapping}')")
    by_pad(page, car)
    if not mapping:
        page.wait_for_function("document.getElementById('toasts').textContent.includes(\"'pad 2' cannot drive\")")
    page.evaluate(f"press({B}, 1, 2)")
    car.until(lambda robot: robot.runtime.gate.stopped, LIMIT)


@pytest.mark.parametrize("how", ["", f"press({A}, 0, 1)"], ids=["down", "its first report is late"])
def test_a_pad_that_comes_back_needs_a_fresh_press(page: Any, car: Live, how: str) -> None:
    page.evaluate(PAD)
    by_pad(page, car)
    gone = monotonic()
    page.evaluate(f"pads[1] = {{...pads[0], index: 1}}; pads[0] = null; {how}")
    page.wait_for_timeout(300)
    page.evaluate(f"press({A}, 1, 1)")
    page.wait_for_timeout(700)
    assert drove(car, gone) < ENDS + LATE
    page.evaluate(f"press({A}, 0, 1)")
    page.wait_for_timeout(100)
    by_pad(page, car, 1)
