"""A virtual ICM-20948 and a virtual BNO055, register by register, each alone on its I2C bus.

The numbers are those of the makers' data sheets; they are not the drivers', so that a wrong number there shows.
"""

from collections.abc import Sequence
from math import cos, degrees, sin

from txt1.sensors.readings import STANDARD_GRAVITY
from txt1.sensors.virtual_mpu6050 import COUNTS_FULL, Mpu6050Chip


class Icm20948Chip(Mpu6050Chip):
    """The chip: four banks of registers, and another order of its measurements. It sleeps after power-up."""

    def __init__(self, address: int = 0x69, seed: int = 1) -> None:
        super().__init__(address, seed)

    def power_up(self) -> None:
        """Sleep, with the registers' first values."""
        self.banks = [bytearray(128) for _ in range(4)]
        self.banks[0][0x00], self.banks[0][0x06] = 0xEA, 0x41
        self.banks[2][0x01], self.banks[2][0x14] = 0x01, 0x01
        self.bank = 0
        """The bank that is selected."""

    def write(self, register: int, data: Sequence[int]) -> None:
        """Take bytes, starting at a register; 0x7F selects the bank for all."""
        for k, byte in enumerate(data):
            if register + k == 0x7F:
                self.bank = byte >> 4 & 3
            else:
                self.banks[self.bank][register + k] = byte

    def read(self, register: int, count: int) -> list[int]:
        """Return bytes of the bank that is selected; the measurements are made now."""
        self.measure()
        return list(self.banks[self.bank][register : register + count])

    def measure(self) -> None:
        """Fill the registers of the measurements."""
        awake = not self.banks[0][0x06] & 0x40
        g_range = 2 << (self.banks[2][0x14] >> 1 & 3)
        degree_range = 250 << (self.banks[2][0x01] >> 1 & 3)
        words = [a / STANDARD_GRAVITY / g_range + self._rng.gauss(0.0, 0.0003) for a in self.force]
        told = zip(self.rates, self.bias, strict=True)
        words += [degrees(w + b) / degree_range + self._rng.gauss(0.0, 0.00005) for w, b in told]
        for k, word in enumerate(words):
            count = min(max(round(word * COUNTS_FULL), -32768), 32767) if awake else 0
            self.banks[0][0x2D + 2 * k : 0x2F + 2 * k] = (count & 0xFFFF).to_bytes(2, "big")


class Bno055Chip(Mpu6050Chip):
    """The chip, turned to the left by `heading`, rad, on a slope that raises its x axis by `pitch`, rad."""

    def __init__(self, address: int = 0x28, seed: int = 1) -> None:
        self.heading = self.pitch = 0.0
        self.calibrated = 3
        """How well it knows the gyro's bias, 0 to 3."""
        super().__init__(address, seed)
        self.bias = (0.0, 0.0, 0.0)

    def power_up(self) -> None:
        """Be in the mode CONFIG, whose measurements are zero."""
        self.registers = bytearray(128)
        self.registers[0x00], self.registers[0x3B] = 0xA0, 0x80

    def measure(self) -> None:
        """Fill the registers of the measurements."""
        fuses = self.registers[0x3D] & 0x0F == 0x08 and self.registers[0x3E] == 0
        in_mg, in_rps = self.registers[0x3B] & 1, self.registers[0x3B] >> 1 & 1
        force = [round(a * (1000.0 / STANDARD_GRAVITY if in_mg else 100.0)) for a in self.force]
        rates = [round(w * 900.0 if in_rps else degrees(w) * 16.0) for w in self.rates]
        # about z by the heading, then about the turned y axis: a raised x axis is a negative turn
        a, b = 0.5 * self.heading, -0.5 * self.pitch
        turn = cos(a) * cos(b), -sin(a) * sin(b), cos(a) * sin(b), sin(a) * cos(b)
        words = [*force, 0, 0, 0, *rates, 0, 0, 0, *(round(part * 16384.0) for part in turn)]
        for k, word in enumerate(words):
            self.registers[0x08 + 2 * k : 0x0A + 2 * k] = ((word if fuses else 0) & 0xFFFF).to_bytes(2, "little")
        self.registers[0x35] = self.calibrated << 4
