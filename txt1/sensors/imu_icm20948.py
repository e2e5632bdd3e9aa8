"""InvenSense ICM-20948 by I2C: its registers. Bias at rest and driver are those of the MPU6050.

Its registers lie in four banks; the driver leaves the first one selected. Its magnetometer is not read: a car's motor
disturbs it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import Final

from txt1.config.sources import checked
from txt1.sensors.base import Setup
from txt1.sensors.frame_grabber import Frames
from txt1.sensors.i2c import opener
from txt1.sensors.imu_mpu6050 import DATA, PER_DEGREE, PER_G, MotionChip, Mpu6050Options, sensor
from txt1.sensors.readings import STANDARD_GRAVITY, ImuReading, Vector

# registers of the data sheet DS-000189, revision 1.3; of bank 0
WHO_AM_I: Final = 0x00
PWR_MGMT_1: Final = 0x06
ACCEL_XOUT_H: Final = 0x2D
# of bank 2
GYRO_SMPLRT_DIV: Final = 0x00
GYRO_CONFIG_1: Final = 0x01
ACCEL_SMPLRT_DIV_2: Final = 0x11
ACCEL_CONFIG: Final = 0x14
# of all banks
REG_BANK_SEL: Final = 0x7F


def decode(data: Sequence[int]) -> tuple[Vector, Vector]:
    """Return specific force, m/s^2, and rates, rad/s, about the chip's axes, of its 14 bytes."""
    ax, ay, az, gx, gy, gz, _ = DATA.unpack(bytes(data))
    g, w = STANDARD_GRAVITY / PER_G, radians(1.0) / PER_DEGREE
    return (ax * g, ay * g, az * g), (gx * w, gy * w, gz * w)


ICM20948: Final = MotionChip(
    WHO_AM_I,
    {0xEA: "ICM20948"},
    (
        (REG_BANK_SEL, 0x00),
        # out of sleep, best clock
        (PWR_MGMT_1, 0x01),
        (REG_BANK_SEL, 0x20),
        # 225 samples a second
        (GYRO_SMPLRT_DIV, 0x04),
        (ACCEL_SMPLRT_DIV_2, 0x04),
        # filters of 50 Hz, +-500 degrees/s, +-4 g
        (GYRO_CONFIG_1, 0x1B),
        (ACCEL_CONFIG, 0x1B),
        (REG_BANK_SEL, 0x00),
    ),
    (PWR_MGMT_1, 0x01),
    ACCEL_XOUT_H,
    decode,
    REG_BANK_SEL,
)


@dataclass(frozen=True, slots=True)
class Icm20948Options(Mpu6050Options):
    """The place of the chip, and its mounting; its address is 0x69 if AD0 is high, as on most boards, else 0x68."""

    address: int = 0x69


def create(setup: Setup) -> Frames[ImuReading]:
    """Make the driver ``imu_icm20948``; options: those of `Icm20948Options`."""
    from txt1.sensors.virtual_i2c_imus import Icm20948Chip

    given = checked(Icm20948Options, setup.options, f"sensors.{setup.name}.options")
    opened = opener(setup, given.bus, lambda: Icm20948Chip(given.address))
    return sensor(setup.name, given, opened, setup.armed, ICM20948)
