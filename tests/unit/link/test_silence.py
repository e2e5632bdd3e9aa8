"""What is done about a device that is silent, and when."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.unit.link.link_ends import End, opened_pty, run_quietly, turns
from txt1.errors import HalError
from txt1.link import ports
from txt1.link.base import Link
from txt1.link.device import DevicePort
from txt1.link.silence import FIRST_PAUSE, LONGEST_PAUSE, LOST_LONGEST, Ladder, Step, Watched


def climbed(ladder: Ladder, until: float) -> list[tuple[float, Step]]:
    """The steps until a time, if a port opens at once and nothing is heard."""
    steps = []
    while ladder.due <= until:
        time = ladder.due
        steps.append((round(time, 3), ladder.take(time)))
        if steps[-1][1] is Step.OPEN:
            ladder.connected(time)
    return steps


def test_a_silent_device_is_greeted_and_then_its_port_is_opened_with_growing_pauses() -> None:
    ladder = Ladder(2.0)
    ladder.heard(1.0)
    times, steps = zip(*climbed(ladder, 80.0), strict=True)
    assert steps == (Step.GREET, *[Step.OPEN] * (len(steps) - 1))
    assert times[:6] == (3.0, 5.0, 7.0, 11.0, 19.0, 29.0)
    pauses = [b - a for a, b in pairwise(times)]
    assert pauses == sorted(pauses) and pauses[-1] == LONGEST_PAUSE, "for ever"
    assert str(ladder) == f"greeted again, opened again {len(steps) - 1} times"


def test_a_sound_reading_ends_the_silence_and_the_next_begins_at_the_first_step() -> None:
    ladder = Ladder(2.0)
    ladder.heard(0.0)
    climbed(ladder, 30.0)
    ladder.heard(30.0)
    assert not ladder.silent
    assert climbed(ladder, 34.0) == [(32.0, Step.GREET), (34.0, Step.OPEN)]


def test_a_device_without_commands_is_not_greeted() -> None:
    ladder = Ladder(2.0, greets=False)
    ladder.heard(0.0)
    assert climbed(ladder, 3.0) == [(2.0, Step.OPEN)]


def test_a_lost_port_is_tried_soon_and_at_last_about_once_a_second() -> None:
    ladder, time, pauses = Ladder(2.0), 5.0, []
    ladder.heard(4.0)
    for _ in range(8):
        ladder.lost(time)
        pauses.append(round(ladder.due - time, 3))
        time = ladder.due
        assert ladder.take(time) is Step.OPEN
        assert ladder.due == inf, "one attempt at a time"
    assert pauses[:4] == [FIRST_PAUSE, 0.2, 0.4, 0.8] and set(pauses[4:]) == {LOST_LONGEST}


class Wire(Link):
    """A link whose end nobody answers."""

    def _send(self, data: bytes) -> None:
        pass

    def _let_go(self) -> None:
        pass


class Shop:
    """A port that can be opened now and then."""

    address = "shop"

    def __init__(self) -> None:
        self.trouble: Exception | None = None
        self.opened: list[float] = []

    async def open(self, end: Any) -> Link:
        self.opened.append(round(asyncio.get_running_loop().time(), 3))
        if self.trouble is not None:
            raise self.trouble
        link = Wire("shop", end)
        end.connected(link)
        return link

    async def close(self) -> None:
        pass


def test_a_port_that_is_closed_is_left_alone_and_no_timer_stays() -> None:
    async def main() -> None:
        shop, end = Shop(), End()
        watched = Watched(shop, end, 1.0, lambda: None, lambda text: None, lambda error: None)
        await watched.open()
        await asyncio.sleep(10.0)
        assert len(shop.opened) > 2
        before = len(shop.opened)
        watched.close()
        await asyncio.sleep(100.0)
        assert len(shop.opened) == before
        assert end.reasons == ["shop is silent"] * (before - 1)

    run_quietly(main(), speed="max")


def test_what_keeps_a_port_from_opening_is_told_and_other_errors_are_not_swallowed() -> None:
    async def main() -> None:
        shop, told, failed = Shop(), [], []
        watched = Watched(shop, End(), 1.0, None, told.append, failed.append)
        await watched.open()
        shop.trouble = HalError("it is busy")
        watched.lost("unplugged")
        await asyncio.sleep(2.0)
        assert set(told) == {"it is busy"} and not failed
        shop.trouble = ZeroDivisionError("a mistake")
        await asyncio.sleep(2.0)
        assert [type(error) for error in failed] == [ZeroDivisionError]
        watched.close()

    run_quietly(main(), speed="max")


# -- which port ----------------------------------------------------------------------------------------------------


class Found(NamedTuple):
    """A port as pyserial lists it."""

    device: str
    serial_number: str | None = "A1"
    location: str = "1-1"
    vid: int | None = 0x10C4
    pid: int = 0xEA60
    description: str = "adapter"


def test_a_device_plugged_in_on_another_name_is_opened_there_and_no_other_is(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with opened_pty() as (_, one), opened_pty() as (_, two):
        plugged: list[Found] = [Found(one)]
        monkeypatch.setattr(ports.list_ports, "comports", lambda: plugged)
        opened: list[str] = []

        async def main() -> None:
            for name in (one, None):
                plugged[:] = [Found(one)]
                port = DevicePort(name, 57600)
                for there in ([Found(one)], [Found(one, "B2"), Found(two)]):
                    plugged[:] = there
                    link = await port.open(End())
                    opened.append(port.address)
                    link.close()
                    await turns()
                plugged[:] = [Found(one, "B2"), Found(two, "C3", "1-2")]
                with pytest.raises(HalError, match="10c4:ea60 with serial number A1 is not there"):
                    await port.open(End())

        run_quietly(main())
        assert opened == [one, two, one, two]


def test_adapters_with_one_serial_number_or_none_are_known_by_their_sockets(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged: list[Found] = []
    monkeypatch.setattr(ports.list_ports, "comports", lambda: plugged)
    plugged[:] = [Found("/dev/x0", "0001", "1-1"), Found("/dev/x1", "0001", "1-2")]
    plug = ports.plug_of("/dev/x1")
    assert plug is not None
    plugged[:] = [Found("/dev/x0", "0001", "1-2"), Found("/dev/x1", "0001", "1-1")]
    assert ports.port_with(plug) == "/dev/x0"
    plugged[:] = [Found("/dev/x5", None, "1-4")]
    plug = ports.plug_of("/dev/x5")
    assert plug is not None and str(plug).endswith("at socket 1-4")
    plugged[:] = [Found("/dev/x5", None, "1-3")]
    assert ports.port_with(plug) is None, "perhaps another device"
    plugged[:] = [Found("/dev/ttyS0", None, "", None)]
    assert ports.plug_of("/dev/ttyS0") is None
