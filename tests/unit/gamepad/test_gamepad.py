"""Gamepads through SDL's virtual joystick: axes, buttons, removal, two pads."""

from __future__ import annotations

import os
from collections.abc import Iterator
from random import Random

import pytest

pytest.importorskip("pygame", reason="pygame-ce is not installed: the extra 'gamepad'")

from rigs.virtual_pad import VirtualPad
from tests.unit.gamepad.test_pad import by_chance, does_what_the_manual_says
from txt1.control.hand import DEFAULT_HAND
from txt1.gamepad.bridge import Devices, now
from txt1.gamepad.command import described, mapping_line, moved
from txt1.gamepad.pad import AXES, BUTTONS, PadParameters, Pads, PadState

HELD_AND_PRESSED = ("a", "b", "start", "y", "back", "x")


@pytest.fixture(scope="module")
def devices() -> Iterator[Devices]:
    """SDL, begun once in a process as the bridge does it."""
    os.environ["SDL_VIDEODRIVER"] = "dummy"
    devices = Devices()
    yield devices
    devices.close()


def at_rest(devices: Devices) -> Pads:
    """The pads, which appeared a second ago."""
    pads = Pads(PadParameters(), DEFAULT_HAND)
    for time in (0.0, 1.0):
        pads.take(dict.fromkeys(devices.look(), (PadState(), time)), time)
    return pads


def soon(devices: Devices, number: int) -> dict[int, tuple[PadState, float]]:
    """The readings once there are so many pads: SDL tells of one now and of its parts with the next look."""
    for _ in range(5):
        found = devices.look()
    assert len(found) == number
    return found


def only(devices: Devices) -> PadState:
    devices.look()
    [(reading, _)] = devices.look().values()
    return reading


def test_every_axis_and_button_arrives_under_its_name(devices: Devices) -> None:
    pad = VirtualPad()
    rest = only(devices)
    assert rest.buttons == frozenset() and all(abs(value) < 0.01 for value in rest.axes.values())
    for name in AXES:
        pad.push(name, 1.0)
        there = only(devices)
        assert there.axes[name] == pytest.approx(1.0, abs=0.01), name
        assert all(abs(value) < 0.01 for other, value in there.axes.items() if other != name)
        pad.push(name, -1.0 if "trigger" in name else 0.0)
    for name in BUTTONS:
        pad.press(name)
        assert only(devices).buttons == {name}
        pad.press(name, False)
    pad.unplug()


def test_a_pad_does_what_the_manual_says_in_a_thousand_random_sequences(devices: Devices) -> None:
    pad, random = VirtualPad(), Random(1)
    devices.look()

    def held(reading: PadState) -> PadState:
        """Move the pad's parts, and what SDL makes of it."""
        for name, value in reading.axes.items():
            pad.push(name, 2.0 * value - 1.0 if "trigger" in name else value)
        for name in HELD_AND_PRESSED:
            pad.press(name, name in reading.buttons)
        there = only(devices)
        assert there.buttons == reading.buttons
        assert all(abs(there.axes[name] - value) < 1e-4 for name, value in reading.axes.items())  # 16 bits
        return there

    for _ in range(1000):
        does_what_the_manual_says([(random.uniform(0.0, 0.4), held(by_chance(random))) for _ in range(8)])
    pad.unplug()


def test_a_pad_that_is_unplugged_is_gone_at_once_and_one_more_is_found(devices: Devices) -> None:
    first = VirtualPad()
    soon(devices, 1)
    pads = at_rest(devices)
    first.push("lefty", -1.0)
    first.press("a")
    devices.look()
    assert pads.take(devices.look(), 1.1).velocity == pytest.approx((1.5, 0.0))
    first.unplug()
    assert pads.take(devices.look(), 1.12).velocity is None
    assert devices.names == {}
    second = VirtualPad()
    devices.look()
    assert len(devices.look()) == 1
    second.unplug()


def test_a_stick_that_rests_at_its_stop_lets_go_after_three_seconds(devices: Devices) -> None:
    """Ten seconds, by the clock of the readings: SDL reports changes, and nothing changes."""
    pad = VirtualPad()
    soon(devices, 1)
    pads, present = at_rest(devices), now()
    pad.push("lefty", -1.0)
    pad.press("a")
    soon(devices, 1)

    def drives(later: float) -> bool:
        readings = devices.look()
        aged = {number: (reading, 1.1 + max(0.0, heard - present)) for number, (reading, heard) in readings.items()}
        return pads.take(aged, 1.1 + later).velocity is not None

    assert [later for later in range(11) if drives(float(later))] == [0, 1, 2, 3]
    pad.press("a", False)
    soon(devices, 1)
    assert not drives(10.1)
    pad.press("a")
    soon(devices, 1)
    assert drives(10.2), "by a fresh press"
    pad.unplug()


def test_two_pads_are_told_apart(devices: Devices) -> None:
    one, two = VirtualPad(), VirtualPad()
    one.press("x")
    two.press("y")
    down = {frozenset({"x"}), frozenset({"y"})}
    assert {reading.buttons for reading, _ in soon(devices, 2).values()} == down
    two.unplug()
    assert [reading.buttons for reading, _ in soon(devices, 1).values()] == [{"x"}]
    one.unplug()


def test_the_wizard_knows_the_part_that_moves_and_writes_it_down() -> None:
    rest = {"b0": 0.0, "a0": 0.0, "a5": -1.0, "h0.1": 0.0}
    assert moved(rest, rest) is None
    assert moved(rest, rest | {"b0": 1.0}) == "b0"
    assert moved(rest, rest | {"a5": 1.0}) == "a5"
    assert moved(rest, rest | {"a0": -0.9}) == "a0~"
    assert moved(rest, rest | {"a0": 0.3}) is None
    line = mapping_line("030000004c050000c405000000010000", "Pad, a cheap one", {"a": "b0", "leftx": "a0"})
    assert line.startswith("030000004c050000c405000000010000,Pad  a cheap one,a:b0,leftx:a0,platform:")


def test_a_reading_in_words() -> None:
    assert described(PadState(frozenset({"b", "a"}), {"leftx": -0.5})) == "leftx -0.50  a b"
    assert described(PadState()).endswith("no button")
