"""Every driver on a serial port finds its device again when it is plugged in on another name, and no other device."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from tests.conformance.test_hals import TestSerial as OfSerial
from tests.conformance.test_hals import TestVesc as OfVesc
from tests.conformance.test_hals import TestWaveshare as OfWaveshare
from tests.conformance.test_sensors_on_lines import TestBno08x as OfBno08x
from tests.conformance.test_sensors_on_lines import TestImu as OfImu
from tests.conformance.test_sensors_on_lines import TestLd19 as OfLd19
from tests.conformance.test_sensors_on_lines import TestRplidarExpress as OfRplidar
from tests.conformance.test_sensors_on_lines import TestScip as OfScip
from tests.conformance.test_sensors_on_lines import TestYdlidarX4 as OfYdlidar
from txt1.link import device, ports
from txt1.link.base import End, Link, Port
from txt1.link.device import DevicePort
from txt1.link.outages import OutagePort

SUITES = [OfImu, OfBno08x, OfScip, OfLd19, OfRplidar, OfYdlidar, OfSerial, OfVesc, OfWaveshare]
OLD, NEW = "/dev/ttyUSB0", "/dev/ttyUSB1"


class Found(NamedTuple):
    """A USB adapter, as pyserial lists it."""

    device: str
    serial_number: str
    location: str = "1-1"
    vid: int = 0x10C4
    pid: int = 0xEA60
    description: str = "CP2102"


class DeskAtADevice(DevicePort):
    """What is on the desk, reached through a serial device's name."""

    def __init__(self, desk: Port) -> None:
        super().__init__(OLD, 115200)
        self._desk = desk

    async def close(self) -> None:
        await super().close()
        await self._desk.close()


@pytest.mark.parametrize("suite", SUITES, ids=lambda suite: suite.__name__[4:])
def test_a_device_is_found_on_another_name(suite: type[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Another adapter of the same kind takes its old name meanwhile."""
    opened: list[str] = []
    outages: list[OutagePort] = []
    desks: list[Port] = []

    def plugged() -> list[Found]:
        if all(port.opened < 2 for port in outages):
            return [Found(OLD, "A1")]
        return [Found(OLD, "B2", "1-2"), Found(NEW, "A1")]

    async def open_link(address: str, end: End, *others: object) -> Link:
        opened.append(address)
        return await desks[0].open(end)

    monkeypatch.setattr(ports.list_ports, "comports", plugged)
    monkeypatch.setattr(device, "open_link", open_link)
    made = suite()
    behind: Callable[[Callable[[Port], Port]], Any] = made.behind

    def over_a_device(wrap: Callable[[Port], Port]) -> Any:
        def named(desk: Port) -> Port:
            desks.append(desk)
            port = wrap(DeskAtADevice(desk))
            assert isinstance(port, OutagePort)
            outages.append(port)
            return port

        return behind(named)

    monkeypatch.setattr(made, "behind", over_a_device)
    names = [name for name in dir(made) if name.startswith("test_a_device_that_is_unplugged")]
    assert len(names) == 1
    getattr(made, names[0])()
    assert opened[0] == OLD and set(opened[1:]) == {NEW}
