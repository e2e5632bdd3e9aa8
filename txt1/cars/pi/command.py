"""Checks of `txt1 doctor --hal pi`: the libraries, devices and chips that an R/C car on a Raspberry Pi needs."""

import errno
import os
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from txt1.cars.pi.driver import GET_LGPIO, UNKNOWN
from txt1.config import Config
from txt1.installing import installs
from txt1.kit.findings import Finding, judged

CHIPS: Final = {
    0x40: "servo board (PCA9685), or an INA219",
    0x41: "INA219",
    0x48: "ADS1115",
    0x70: "servo board, all at once",
}
"""I2C addresses to ask, and the chips that may answer."""


def findings(config: Config, devices: Path = Path("/dev")) -> Iterator[Finding]:
    """Yield findings on the Raspberry Pi below the car; the devices are in the folder `devices`."""
    options = config.hal_options
    bus = options.get("bus", 1)
    # no fault: the car drives forward
    yield Finding("reverse", options.get("reverse") or f"unknown: {UNKNOWN}")
    if isinstance(bus, str):
        return
    gpio = options.get("output") == "gpio"
    for module, needed, get in (
        ("smbus2", not gpio or options.get("battery", "none") != "none", installs("devices")),
        ("lgpio", gpio or bool(options.get("encoders")), f"{installs('devices')}; {GET_LGPIO}"),
    ):
        if needed:
            yield judged("extra", module, find_spec(module) is not None, f"it is missing: {get}")
    if gpio or options.get("encoders"):
        yield access(devices / "gpiochip0", "gpio", "is this a Raspberry Pi?")
    if not gpio:
        place = devices / f"i2c-{bus}"
        remark = access(place, "i2c", "sudo raspi-config, Interface Options, I2C: on")
        yield remark
        if remark.well and find_spec("smbus2") is not None:
            from smbus2 import SMBus

            with SMBus(str(place)) as opened:
                yield from chips(opened.read_byte, options.get("address", 0x40))


def access(device: Path, group: str, absent: str) -> Finding:
    """Return whether a device is there and may be used; `absent` is the remedy if it is not there."""
    if not device.exists():
        return Finding(group, f"{device} does not exist: {absent}", False)
    well = os.access(device, os.R_OK | os.W_OK)
    return judged(group, str(device), well, f"no permission: sudo usermod -aG {group} $USER, then log out and in again")


def chips(read_byte: Callable[[int], Any], wanted: int) -> Iterator[Finding]:
    """Yield findings on known chips that answer on an I2C bus; the servo board at `wanted` has to answer."""
    answered = []
    for address in sorted({*CHIPS, wanted}):
        try:
            read_byte(address)
        except OSError as error:
            # a driver of the kernel has the chip, so it is there
            if error.errno == errno.EBUSY:
                answered.append(address)
            continue
        answered.append(address)
    told = ", ".join(f"0x{each:02x} ({CHIPS.get(each, 'servo board')})" for each in answered) or "none"
    remedy = f"nothing at 0x{wanted:02x}: look at VCC, GND, SDA (pin 3), SCL (pin 5), and hal_options.address"
    yield judged("chips", f"that answer: {told}", wanted in answered, remedy)
