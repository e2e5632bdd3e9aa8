"""A browser's own input events, by the DevTools protocol, and gamepads in place of those that a browser finds.

A page gets `page.input`, a session of the protocol, from `hands`.
"""

from __future__ import annotations

from time import monotonic
from typing import Any

ALT, CONTROL, META, SHIFT = 1, 2, 4, 8
"""Modifier keys that are down."""
W = ("w", "KeyW", 87)
"""A key: its name, its place, its number."""
COMMAND = ("Meta", "MetaLeft", 91)


def hands(page: Any) -> Any:
    """Give a page its session."""
    page.input = page.context.new_cdp_session(page)
    return page


def down(page: Any, key: str, code: str, number: int, modifiers: int = 0, repeat: bool = False) -> None:
    """A key goes down, or repeats."""
    about = {"key": key, "code": code, "windowsVirtualKeyCode": number, "modifiers": modifiers, "autoRepeat": repeat}
    page.input.send("Input.dispatchKeyEvent", {"type": "rawKeyDown", **about})


def up(page: Any, key: str, code: str, number: int, modifiers: int = 0) -> None:
    about = {"key": key, "code": code, "windowsVirtualKeyCode": number, "modifiers": modifiers}
    page.input.send("Input.dispatchKeyEvent", {"type": "keyUp", **about})


def repeats(page: Any, key: tuple[str, str, int], seconds: float) -> None:
    """The computer repeats a key."""
    ends = monotonic() + seconds
    while monotonic() < ends:
        down(page, *key, repeat=True)
        page.wait_for_timeout(33)


def at(page: Any, selector: str) -> tuple[float, float]:
    box = page.locator(selector).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def finger(page: Any, kind: str, *places: tuple[float, float]) -> None:
    points = [{"x": x, "y": y} for x, y in places]
    page.input.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


PAD = """
window.pads = [];
window.plug = (index, mapping = 'standard') => { pads[index] = {
  connected: true, mapping, axes: [0, 0, 0, 0], index, id: `pad ${index}`,
  get timestamp() { return performance.now() },  // of some browsers at every look
  buttons: Array.from({length: 17}, () => ({pressed: false, value: 0}))} };
navigator.getGamepads = () => window.pads;
window.press = (button, value, index = 0) => pads[index].buttons[button] = {pressed: value > 0, value};
plug(0);
"""
A, B = 0, 1
"""Buttons of a standard pad: dead-man and stop."""
