"""A virtual I2C bus with a servo board (PCA9685) and battery sensors (INA219, ADS1115), register by register.

The registers in use follow the data sheets. They are not the guard's, so that a wrong number there shows. The servo
board has no time-out, takes a prescaler only while it sleeps, and repeats its last output for ever. A missing chip does
not acknowledge: OSError 121, as on Linux. For programs that watch from outside, a bus and a pin can be files.
"""

import errno
import mmap
import os
from collections.abc import Sequence
from typing import Final, Protocol

# of the servo board (PCA9685): first register of the first output; each output has four: times of on and off
LED0: Final = 0x06
MODE1: Final = 0x00
MODE2: Final = 0x01
PRESCALE: Final = 0xFE
SLEEP: Final = 0x10
# the register advances with each byte
AUTO: Final = 0x20
# counts of a period
STEPS: Final = 4096
# in the high byte of the time at which an output goes off
FULL_OFF: Final = 0x10
OSCILLATOR: Final = 25e6  # Hz


class Chip(Protocol):
    """A chip on the bus."""

    def write(self, register: int, data: Sequence[int]) -> None:
        """Take bytes, starting at a register."""

    def read(self, register: int, count: int) -> list[int]:
        """Return bytes, starting at a register."""


class Pca9685Chip:
    """The servo board's registers, in a buffer of 256 bytes."""

    def __init__(self, registers: bytearray | mmap.mmap | None = None) -> None:
        self.registers = bytearray(256) if registers is None else registers
        self.power_up()

    def power_up(self) -> None:
        """Sleep, with all outputs off."""
        self.registers[MODE1], self.registers[MODE2], self.registers[PRESCALE] = 0x11, 0x04, 0x1E
        for channel in range(16):
            self.registers[LED0 + 4 * channel : LED0 + 4 * channel + 4] = bytes((0, 0, 0, FULL_OFF))

    def write(self, register: int, data: Sequence[int]) -> None:
        """Take bytes. Without auto-increment all of them go to the same register."""
        for byte in data:
            if register != PRESCALE:
                self.registers[register] = byte
            elif self.registers[MODE1] & SLEEP:
                self.registers[register] = max(byte, 3)
            if self.registers[MODE1] & AUTO:
                register = (register + 1) % 256

    def read(self, register: int, count: int) -> list[int]:
        """Return bytes, starting at a register."""
        return list(self.registers[register : register + count])

    def pulse(self, channel: int) -> float:
        """Return the pulse at an output, us; 0 while the output is off."""
        return pulse_of(self.registers, channel)


def pulse_of(registers: bytes | bytearray | mmap.mmap, channel: int) -> float:
    """Return the pulse at a servo board's output, from its registers, us; 0 while the output is off."""
    on_low, on_high, off_low, off_high = registers[LED0 + 4 * channel : LED0 + 4 * channel + 4]
    if registers[MODE1] & SLEEP or off_high & FULL_OFF:
        return 0.0
    steps = ((off_high << 8 | off_low) - (on_high << 8 | on_low)) % STEPS
    return steps * (registers[PRESCALE] + 1) / OSCILLATOR * 1e6


class WordChip:
    """A chip whose registers have 16 bits, high byte first."""

    def __init__(self, **words: int) -> None:
        self.words = {int(name[1:], 16): word for name, word in words.items()}

    def write(self, register: int, data: Sequence[int]) -> None:
        """Take a word."""
        if len(data) == 2:
            self.words[register] = data[0] << 8 | data[1]

    def read(self, register: int, count: int) -> list[int]:
        """Return the word in a register."""
        return list((self.words.get(register, 0) & 0xFFFF).to_bytes(2))[:count]


class Ina219Chip(WordChip):
    """The sensor of voltage and current; `voltage` (V) may be set."""

    voltage = 0.0

    def read(self, register: int, count: int) -> list[int]:
        """Return a word: 4 mV in the upper 13 bits, and the bit for a complete conversion."""
        if register == 0x02:
            self.words[register] = round(self.voltage / 0.004) << 3 | 2
        return super().read(register, count)


class Ads1115Chip(WordChip):
    """The converter; `voltage` (V) at its first input may be set."""

    voltage = 0.0

    def write(self, register: int, data: Sequence[int]) -> None:
        """Take a word; a single shot at +-4.096 V of an input against ground is complete at once here."""
        super().write(register, data)
        config = self.words.get(0x01, 0)
        if register == 0x01 and config & 0x8000 and (config >> 9) & 7 == 1:
            volts = self.voltage if (config >> 12) & 7 == 4 else 0.0
            self.words[0x00] = min(round(volts / 0.000125), 0x7FFF)


class VirtualBus:
    """The bus; `chips` by address."""

    def __init__(self, chips: dict[int, Chip]) -> None:
        self.chips = chips

    def write_i2c_block_data(self, address: int, register: int, data: Sequence[int]) -> None:
        """Write bytes."""
        self._chip(address).write(register, data)

    def read_i2c_block_data(self, address: int, register: int, count: int) -> list[int]:
        """Read bytes."""
        return self._chip(address).read(register, count)

    def close(self) -> None:
        """Do nothing: the chips belong to their maker."""

    def _chip(self, address: int) -> Chip:
        try:
            return self.chips[address]
        except KeyError:
            raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO)) from None


class FileBus(VirtualBus):
    """A bus whose servo board, at 0x40, has its registers in a file, so that other programs can read them."""

    def __init__(self, path: str) -> None:
        with open(path, "a+b") as file:
            file.truncate(256)
            registers = mmap.mmap(file.fileno(), 256)
        super().__init__({0x40: Pca9685Chip(registers)})


class FilePin:
    """A pin whose level is the only byte of a file, so that other programs can read it."""

    def __init__(self, path: str) -> None:
        with open(path, "a+b") as file:
            file.truncate(1)
            self._byte = mmap.mmap(file.fileno(), 1)

    def set(self, level: int) -> None:
        """Set the level, 0 or 1."""
        self._byte[0] = level
