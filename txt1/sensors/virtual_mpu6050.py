"""A virtual MPU6050 and MPU9250, register by register, each alone on its I2C bus.

The numbers are those of the maker's register map and data sheet; they are not the driver's, so that a wrong number
there shows. After power-up an MPU6050 sleeps, and its measurements are zero.
"""

import errno
import os
from collections.abc import Sequence
from math import degrees
from random import Random

from txt1.sensors.readings import STANDARD_GRAVITY, Vector

# counts at full scale
COUNTS_FULL: float = 32768.0


class Mpu6050Chip:
    """The chip; its motion may be set, in m/s^2 and rad/s about its own axes."""

    def __init__(self, address: int = 0x68, seed: int = 1) -> None:
        self.force: Vector = (0.0, 0.0, STANDARD_GRAVITY)
        self.rates: Vector = (0.0, 0.0, 0.0)
        self.bias: Vector = (0.05, -0.12, 0.21)
        """Offset of the gyro, rad/s."""
        self.held = False
        """Whether it holds the data line down."""
        self.address, self._rng = address, Random(seed)
        self.power_up()

    def power_up(self) -> None:
        """Sleep, with the registers' first values."""
        self.registers = bytearray(128)
        self.registers[0x6B], self.registers[0x75] = 0x40, 0x68

    def write_i2c_block_data(self, address: int, register: int, data: Sequence[int]) -> None:
        """Write bytes."""
        self._check(address)
        self.write(register, data)

    def read_i2c_block_data(self, address: int, register: int, count: int) -> list[int]:
        """Read bytes."""
        self._check(address)
        return self.read(register, count)

    def close(self) -> None:
        """Do nothing: the chip goes on."""

    def _check(self, address: int) -> None:
        if self.held:
            raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))
        if address != self.address:
            raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))

    def write(self, register: int, data: Sequence[int]) -> None:
        """Take bytes, starting at a register."""
        for k, byte in enumerate(data):
            self.registers[register + k] = byte

    def read(self, register: int, count: int) -> list[int]:
        """Return bytes, starting at a register; the measurements are made now."""
        self.measure()
        return list(self.registers[register : register + count])

    def measure(self) -> None:
        """Fill the registers of the measurements."""
        awake = not self.registers[0x6B] & 0x40
        g_range = 2 << (self.registers[0x1C] >> 3 & 3)
        degree_range = 250 << (self.registers[0x1B] >> 3 & 3)
        words = [a / STANDARD_GRAVITY / g_range + self._rng.gauss(0.0, 0.0003) for a in self.force]
        words.append(0.0)
        told = zip(self.rates, self.bias, strict=True)
        words += [degrees(w + b) / degree_range + self._rng.gauss(0.0, 0.00005) for w, b in told]
        for k, word in enumerate(words):
            count = min(max(round(word * COUNTS_FULL), -32768), 32767) if awake else 0
            self.registers[0x3B + 2 * k : 0x3D + 2 * k] = (count & 0xFFFF).to_bytes(2, "big")


class Mpu9250Chip(Mpu6050Chip):
    """The MPU-9250's gyro and accelerometer: awake after power-up, at +-2 g and +-250 degrees/s."""

    def power_up(self) -> None:
        """Measure, with the registers' first values."""
        self.registers = bytearray(128)
        self.registers[0x6B], self.registers[0x75] = 0x01, 0x71
