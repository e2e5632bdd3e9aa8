"""A sensor's I2C bus: opened by smbus2, and kept apart from the bus of the outputs.

A chip that holds the data line down blocks everything on its bus. On the bus of a servo board it keeps the guard of
the outputs from its neutral, and the board repeats its last pulses. So no sensor is opened there, unless a watchdog
switches the outputs off then.
"""

import errno
from collections.abc import Callable, Sequence
from typing import Protocol

from txt1.config import Config
from txt1.errors import ConfigError, HalError, MissingExtra
from txt1.sensors.base import Setup


class SensorBus(Protocol):
    """An I2C bus with the interface of smbus2; raises OSError if a chip does not answer."""

    def write_i2c_block_data(self, address: int, register: int, data: Sequence[int], /) -> None:
        """Write bytes, starting at a register."""

    def read_i2c_block_data(self, address: int, register: int, count: int, /) -> Sequence[int]:
        """Read bytes, starting at a register."""

    def close(self) -> None:
        """Close the bus."""


def refuse_bus_of_outputs(name: str, bus: int, config: Config) -> None:
    """Raise ConfigError if a sensor is on the bus of a servo board whose outputs no watchdog switches off."""
    given = config.hal_options
    on_it = config.hal == "pi" and given.get("output", "pca9685") == "pca9685" and given.get("bus", 1) == bus
    if on_it and given.get("watchdog") is None:
        raise ConfigError(
            f"sensors.{name}.options.bus: {bus} is the bus of the outputs (hal_options.bus): a sensor that holds its "
            "data line keeps them from neutral. Use a second bus (dtoverlay=i2c3, bus 3) or a sensor with a UART; or "
            "fit the watchdog and set hal_options.watchdog (docs/hal-pi.md)"
        )


def open_bus(bus: int) -> SensorBus:
    """Open a bus by its number; raises HalError with the remedy, MissingExtra."""
    try:
        from smbus2 import SMBus
    except ImportError:
        raise MissingExtra("a sensor on the I2C bus", "devices") from None
    try:
        opened: SensorBus = SMBus(bus)
    except OSError as error:
        remedy = "switch I2C on (sudo raspi-config, Interface Options) and check options.bus"
        if error.errno == errno.EACCES:
            remedy = "sudo usermod -aG i2c $USER, then log out and in again"
        raise HalError(f"I2C bus {bus} cannot be opened ({error.strerror}): {remedy}") from None
    return opened


def opener(setup: Setup, bus: int | str, virtual: Callable[[], SensorBus]) -> Callable[[], SensorBus]:
    """Return what opens the bus of a sensor: `virtual` for "virtual". Raises ConfigError for the bus of the outputs."""
    if isinstance(bus, str):
        return virtual
    refuse_bus_of_outputs(setup.name, bus, setup.config)
    return lambda: open_bus(bus)


def why_silent(error: OSError, bus: int | str, address: int) -> str:
    """Return where a transfer failed, and the remedy."""
    where = f"I2C bus {bus}, address 0x{address:02x}"
    if error.errno in (errno.EREMOTEIO, errno.ENXIO):
        # the second from buses made of two pins
        return f"{where}: nothing answers; check wiring, power and options.address"
    if error.errno in (errno.ENODEV, errno.ENOENT):
        return f"{where}: there is no such bus any more; is its adapter plugged in?"
    return f"{where}: {error.strerror}; a chip may hold the bus: switch its power off and on"
