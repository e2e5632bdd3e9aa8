"""A HAL that hears another device's language names it, and every device is known by its answer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from txt1.cars.vesc import driver as vesc
from txt1.cars.waveshare import driver as waveshare
from txt1.config import Config, load
from txt1.errors import HalError
from txt1.hal.languages import LANGUAGES, answering, known, named
from txt1.hal.registry import PORTS
from txt1.hal.serial import SerialHal
from txt1.kernel.loop import run
from txt1.link.base import End, Link, Port, connect
from txt1.protocol.layout import encode
from txt1.protocol.messages import EncoderOdometry

REPORT = b'{"T":1001,"L":0.25,"R":-0.5,"gz":-89,"odl":56,"odr":-20,"v":1216}\n'
ODOMETRY = encode(EncoderOdometry(0.1, 0.2, 0.3, 0.4, 0.5))
FIRMWARE = vesc.packet(bytes((vesc.PacketId.FW_VERSION, 6, 5)) + b"VESC\0")


def config(hal: str, port: str) -> Config:
    return load(None, [f"serial.port={port}"], {}, {"hal": hal}).config


@pytest.mark.parametrize(
    ("data", "name"), [(REPORT, "waveshare"), (ODOMETRY, "serial"), (FIRMWARE, "vesc"), (b"NMEA,1,2,3*44\r\n", "")]
)
def test_a_language_is_that_of_one_device(data: bytes, name: str) -> None:
    garbled = data[len(data) // 2 :] + data + data[:3]
    assert [each for each, language in known() if language.speaks(garbled)] == ([name] if name else [])
    told = named(garbled)
    assert told.endswith(f"take --hal {name}") if name else told == ""
    assert named(garbled, but=name) == ""


def test_every_hal_on_a_line_has_a_language() -> None:
    assert set(LANGUAGES.ours) == {"serial", "vesc", "waveshare"}


class Speaker:
    """A port whose device says the same again and again."""

    address = "speaker"

    def __init__(self, data: bytes) -> None:
        self._data = data

    async def open(self, end: End) -> Link:
        host, self._device = connect(end, self)
        self._speaking = asyncio.ensure_future(self._speak())
        return host

    async def close(self) -> None:
        self._speaking.cancel()

    async def _speak(self) -> None:
        while True:
            await asyncio.sleep(0.02)
            self._device.write(self._data)

    def connected(self, link: Link) -> None:
        pass

    def received(self, data: bytes) -> None:
        pass

    def lost(self, reason: str) -> None:
        pass


MAKERS: dict[str, Callable[[Port, Config], Any]] = {
    "vesc": lambda port, made: vesc.VescHal(port, vesc.VescOptions(), made.geometry, lambda end: end, True),
    "waveshare": lambda port, made: waveshare.WaveshareHal(
        port, waveshare.WaveshareOptions(), made.geometry, lambda end: end, True
    ),
    "serial": lambda port, made: SerialHal(port),
}


@pytest.mark.parametrize(
    ("hal", "data", "told"),
    [
        ("serial", REPORT, "a Waveshare rover's board speaks there: take --hal waveshare"),
        ("vesc", REPORT, "a Waveshare rover's board speaks there: take --hal waveshare"),
        ("vesc", ODOMETRY, "a board of the TXT-1 speaks there: take --hal serial"),
        ("waveshare", FIRMWARE, "a VESC speaks there: take --hal vesc"),
        ("waveshare", b"", "txt1 doctor --port speaker asks which device is there"),
    ],
)
def test_a_hal_names_the_device_that_speaks_in_the_place_of_its_own(hal: str, data: bytes, told: str) -> None:
    async def look() -> str:
        robot = MAKERS[hal](Speaker(data), config(hal, "x"))
        await robot.open()
        for k in range(200):
            await asyncio.sleep(0.02)
            text: str = robot.read(0.02 * k).link.text
        await robot.close()
        return text

    assert told in run(look(), speed="max")


@pytest.mark.parametrize("device", ["vesc", "waveshare"])
def test_a_device_is_known_by_its_answer(device: str) -> None:
    def port_for(language: Any) -> Port:
        port: Port = PORTS.make("serial.port", device, config(device, device))
        return port

    found = run(answering(port_for), speed="max")
    assert [name for name, _ in found] == [device]


class Counting(Speaker):
    """A port that is counted."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self.baud: list[int] = []
        self.closed = self.hung_up = 0

    async def close(self) -> None:
        self.closed += 1
        await super().close()

    def lost(self, reason: str) -> None:
        self.hung_up += 1


def test_each_language_is_listened_to_for_0_8_s_and_every_line_is_closed() -> None:
    port = Counting(b"nothing that anybody speaks")

    def port_for(language: Any) -> Any:
        port.baud.append(language.baud)
        return port

    async def ask() -> float:
        began = asyncio.get_running_loop().time()
        assert await answering(port_for) == []
        return asyncio.get_running_loop().time() - began

    languages = [language for _, language in known()]
    assert run(ask(), speed="max") == pytest.approx(0.8 * len(languages))
    assert (port.closed, port.hung_up) == (len(languages), len(languages))
    assert port.baud == [language.baud for language in languages] and 57600 in port.baud


def test_a_line_that_does_not_open_is_closed_and_nothing_hangs_up() -> None:
    class Busy(Counting):
        async def open(self, end: End) -> Link:
            raise HalError("somebody else has it")

        async def close(self) -> None:
            self.closed += 1

    port = Busy(b"")
    with pytest.raises(HalError, match="somebody else"):
        run(answering(lambda language: port), speed="max")
    assert port.closed == 1
