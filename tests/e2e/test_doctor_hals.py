"""`txt1 doctor --hal NAME` looks at a hardware layer, and at the Raspberry Pi that it may be on."""

import errno
from pathlib import Path

import pytest

from txt1.cars.pi.command import access, chips, findings
from txt1.cli import execute
from txt1.cli.doctor_hal import examined, supply
from txt1.commands import FAULT
from txt1.config import load
from txt1.hal.registry import create
from txt1.kernel.loop import run


@pytest.mark.parametrize(
    ("said", "well", "found"),
    [
        ("throttled=0x0\n", True, "no under-voltage"),
        ("throttled=0x50005\n", False, "under-voltage now"),
        ("throttled=0x50000\n", False, "under-voltage since it was switched on: a stronger supply"),
        ("throttled=0x4", False, "slowed down now"),
        ("VCHI initialization failed", False, "not understood"),
    ],
)
def test_the_supply_by_vcgencmd(said: str, well: bool, found: str) -> None:
    assert (supply(said).well, found in supply(said).text) == (well, True)


def test_chips_on_the_bus() -> None:
    def read_byte(address: int) -> int:
        if address != 0x41:
            raise OSError(errno.EREMOTEIO, "Remote I/O error")
        return 0

    (found,) = chips(read_byte, 0x40)
    assert (found.well, "0x41 (INA219)" in found.text, "nothing at 0x40" in found.text) == (False, True, True)
    (found,) = chips(read_byte, 0x41)
    assert found.well


def test_a_device_that_is_not_there_or_not_ours(tmp_path: Path) -> None:
    config = load(None, ["vehicle=donkeycar"], {}, {"hal": "pi"}).config
    found = {finding.subject: finding for finding in findings(config, tmp_path)}
    assert "raspi-config" in found["i2c"].text
    (tmp_path / "i2c-1").touch()
    assert access(tmp_path / "i2c-1", "i2c", "").well


@pytest.mark.parametrize(("hal", "vehicle"), [("vesc", "f1tenth"), ("waveshare", "rover")])
def test_all_is_well_on_the_desk(hal: str, vehicle: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["doctor", "--hal", hal, "--vehicle", vehicle, "--port", hal, "--duration", "2"]
    assert execute(words) in (0, 1)  # a container may have no serial port of its own to show
    said = capsys.readouterr().out
    assert "stops by itself after" in said
    assert "odometry  50 a second" in said


def test_a_line_that_brings_nothing_is_told() -> None:
    silent = ["vehicle=f1tenth", "serial.port=vesc", "serial.fault.drop=1"]
    hal = create(load(None, silent, {}, {"hal": "vesc"}).config)
    found = {finding.subject: finding for finding in run(examined(hal, 2.0), speed="max")}
    assert (found["link"].well, found["odometry"].well, found["battery"].well) == (False, False, False)
    assert "transmit and receive lines crossed" in found["link"].text


@pytest.mark.parametrize(("device", "hal"), [("vesc", "vesc"), ("waveshare", "waveshare")])
def test_another_device_at_the_board_s_port_is_asked_and_proposed(
    device: str, hal: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["doctor", "--port", device, "--duration", "0.5"]) == FAULT
    told = capsys.readouterr().out
    assert f"txt1 run --hal {hal} --port {device}; txt1 doctor --hal {hal} --port {device} looks at it" in told
    assert told.count("answers at") == 1
