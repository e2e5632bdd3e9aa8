"""Where a board is found: its port, opened as often as the line is lost."""

import asyncio
import os
from pathlib import Path
from typing import Any

import pytest

from txt1.config import load
from txt1.errors import ConfigError, HalError
from txt1.hal.registry import port_of
from txt1.link import device
from txt1.link.device import DevicePort
from txt1.link.tcp import BOARD


class World:
    """What is plugged in, and how the port was opened."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.devices = iter(["/dev/ttyUSB0", "/dev/ttyUSB1"])
        self.left_behind: bool | None = False  # None: nobody can tell
        self.trouble: HalError | None = None
        self.opened: list[tuple[Any, ...]] = []
        monkeypatch.setattr(device, "only_candidate", lambda: next(self.devices))
        monkeypatch.setattr(device, "is_left_behind", lambda address: self.left_behind)
        monkeypatch.setattr(device, "open_link", self._open)

    async def _open(self, *how: Any) -> str:
        if self.trouble is not None:
            raise self.trouble
        *where, self.transport, self.dtr, self.framing = how
        self.opened.append(tuple(where))
        return "link"

    def opens(self, port: DevicePort) -> None:
        """Open the port."""
        assert asyncio.run(port.open(END)) == "link"


END: Any = object()


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    return World(monkeypatch)


def test_a_port_that_is_named_is_opened_as_it_is(world: World) -> None:
    port = DevicePort("/dev/ttyACM3", 57600)
    assert port.address == "/dev/ttyACM3"
    world.opens(port)
    world.opens(port)
    assert world.opened == [("/dev/ttyACM3", END, 57600, None, BOARD)] * 2


def test_without_a_name_it_is_the_only_device_there_is_wherever_that_turns_up(world: World) -> None:
    port = DevicePort(None, 115200, behind="another command")
    assert port.address == "the serial port"
    for address in ("/dev/ttyUSB0", "/dev/ttyUSB1"):
        world.opens(port)
        assert port.address == address
        assert world.opened[-1] == (address, END, 115200, None, "another command")


def test_what_a_board_that_is_gone_left_behind_is_not_opened(world: World) -> None:
    world.left_behind = True
    with pytest.raises(HalError, match="/dev/ttyACM3 was left behind by a board that is gone; waiting for a new board"):
        world.opens(DevicePort("/dev/ttyACM3", 57600))


@pytest.mark.parametrize(("target", "once"), [("/dev/pts/9", True), ("/dev/ttyS9", False)])
def test_a_link_to_a_pseudo_terminal_of_unknown_owner_is_opened_once(
    world: World, tmp_path: Path, target: str, once: bool
) -> None:
    place = tmp_path / "board"
    place.symlink_to(target)
    world.left_behind = None
    port = DevicePort(str(place), 57600)
    world.trouble = HalError("busy")
    with pytest.raises(HalError, match="busy"):
        world.opens(port)
    world.trouble = None
    world.opens(port)  # one that did not open is none
    if not once:
        world.opens(port)
        return
    with pytest.raises(HalError, match="left behind"):
        world.opens(port)
    (tmp_path / "new").symlink_to(target)
    (tmp_path / "new").rename(place)
    world.opens(port)
    world.left_behind = False
    world.opens(port)


def test_a_stranger_s_pseudo_terminal_is_opened_again_while_it_is_the_same(tmp_path: Path) -> None:
    place = tmp_path / "theirs"
    master, slave = os.openpty()
    place.symlink_to(os.ttyname(slave))
    port = DevicePort(str(place), 57600)

    async def use() -> None:
        for _ in range(3):
            link = await port.open(Nobody())
            link.write(b"hello")
            link.close()
            await asyncio.sleep(0.0)

    try:
        asyncio.run(use())
    finally:
        os.close(slave)
        os.close(master)
    with pytest.raises(HalError, match="left behind"):
        asyncio.run(use())


class Nobody:
    def connected(self, link: Any) -> None:
        pass

    def received(self, data: bytes) -> None:
        pass

    def lost(self, reason: str) -> None:
        pass


def test_the_first_line_of_the_secret_file_is_the_secret(world: World, tmp_path: Path) -> None:
    file = tmp_path / "secret"
    port = DevicePort("socket://robot:5000", 57600, str(file))
    with pytest.raises(ConfigError, match=r"serial\.secret_file: .*secret: No such file .*write the board's secret"):
        world.opens(port)
    file.write_text("\nsecond\n")
    with pytest.raises(ConfigError, match=r"serial\.secret_file: .*secret is empty; write the board's secret"):
        world.opens(port)
    file.write_text("  abc \nsecond\n")
    world.opens(port)
    assert world.opened == [("socket://robot:5000", END, 57600, b"abc", BOARD)]


def test_there_is_nothing_to_let_go_of() -> None:
    asyncio.run(DevicePort("/dev/ttyACM3", 57600).close())


@pytest.mark.parametrize(("settings", "library"), [([], "pyserial-asyncio"), (["serial.transport=serialx"], "serialx")])
def test_the_configured_library_serves_the_port(world: World, settings: list[str], library: str) -> None:
    port = port_of(load(None, ["hal=serial", "serial.port=/dev/ttyACM3", *settings], {}, {}).config)
    assert isinstance(port, DevicePort)
    world.opens(port)
    assert world.transport == library


def test_another_library_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"serial\.transport.*'pyserial-asyncio' or 'serialx'"):
        load(None, ["serial.transport=other"], {}, {})
