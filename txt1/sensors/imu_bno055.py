"""Bosch BNO055 by I2C: specific force, rates, and the orientation that the chip computes.

It runs in its mode IMU, which uses no magnetometer, as a car's motor disturbs it. So its heading counts from where the
chip was switched on, and drifts. The chip finds the gyro's bias by itself, at rest, and tells when it has; until then a
reading's sigma says that the rates are worth little.

The chip holds the clock down while it thinks, which the I2C of a Raspberry Pi reads wrongly at times. A reading whose
orientation is no rotation is therefore discarded; a bus made of two pins (i2c-gpio) reads it rightly.
"""

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from math import cos, hypot, radians, sin
from typing import Annotated, Final, NamedTuple

from annotated_types import Ge, Le

from txt1.config.sources import checked
from txt1.errors import HalError
from txt1.sensors.base import Setup
from txt1.sensors.frame_grabber import Frames, Wait
from txt1.sensors.i2c import SensorBus, opener, why_silent
from txt1.sensors.imu_bno08x import product
from txt1.sensors.imu_mpu6050 import Mpu6050Options, turning
from txt1.sensors.readings import ImuReading, ImuSigma, Quaternion, Vector, imu_topic

# registers of page 0, of the data sheet BST-BNO055-DS000
CHIP_ID: Final = 0x00
PAGE_ID: Final = 0x07
ACC_DATA: Final = 0x08
CALIB_STAT: Final = 0x35
UNIT_SEL: Final = 0x3B
OPR_MODE: Final = 0x3D
PWR_MODE: Final = 0x3E
IDENTITY: Final = 0xA0
CONFIG: Final = 0x00
IMU: Final = 0x08
# m/s^2, degrees/s, degrees
UNITS: Final = 0x00
# accelerations, magnetic field, rates, angles, quaternion: 16 words, low byte first
DATA: Final = struct.Struct("<3h3h3h3h4h")
# counts per m/s^2, per degree/s, and of a quaternion's 1
PER_FORCE: Final = 100.0
PER_DEGREE: Final = 16.0
PER_ONE: Final = 16384.0
# s that a change of the mode takes
CHANGES: Final = 0.02
# largest error of the length of a rotation's quaternion
NORM_ERROR: Final = 0.01
# rad/s, standard deviation of the rates before the chip knows their bias
BIAS_UNKNOWN: Final = 0.35
SIGMA: Final = ImuSigma(rates=0.01, acceleration=1.0, attitude=0.03, heading=0.2)
"""Assumed."""


@dataclass(frozen=True, slots=True)
class Bno055Options(Mpu6050Options):
    """The place of the chip, and its mounting; its address is 0x29 if ADR (COM3) is high.

    It makes a hundred readings a second. It finds its bias by itself, and `sigma` is for its readings from then on.
    """

    address: Annotated[int, Ge(3), Le(0x77)] = 0x28
    sigma: ImuSigma = SIGMA


class Bno055Sample(NamedTuple):
    """What the chip tells, about its own axes: m/s^2, rad/s, orientation."""

    force: Vector
    rates: Vector
    orientation: Quaternion


def decode(data: Sequence[int]) -> Bno055Sample | None:
    """Return what the chip tells in 32 bytes; None if the orientation is no rotation."""
    words = DATA.unpack(bytes(data))
    ax, ay, az, _, _, _, gx, gy, gz, _, _, _, w, x, y, z = words
    norm = hypot(w, x, y, z) / PER_ONE
    if abs(norm - 1.0) > NORM_ERROR:
        return None
    one, rate = norm * PER_ONE, radians(1.0) / PER_DEGREE
    return Bno055Sample(
        (ax / PER_FORCE, ay / PER_FORCE, az / PER_FORCE),
        (gx * rate, gy * rate, gz * rate),
        (x / one, y / one, z / one, w / one),
    )


def begin(bus: SensorBus, address: int, wait: Wait) -> None:
    """Set units and mode, unless they are set; raises HalError if it is another chip, OSError if none answers."""
    who = bus.read_i2c_block_data(address, CHIP_ID, 1)[0]
    if who != IDENTITY:
        raise HalError(f"the chip at 0x{address:02x} is no BNO055: it says 0x{who:02x}")
    if is_set(bus, address):
        return
    for register, value in ((PAGE_ID, 0), (OPR_MODE, CONFIG), (UNIT_SEL, UNITS), (PWR_MODE, 0), (OPR_MODE, IMU)):
        bus.write_i2c_block_data(address, register, [value])
        if register == OPR_MODE:
            wait(CHANGES)
    if not is_set(bus, address):
        raise HalError(f"the chip at 0x{address:02x} does not keep its settings: check its power and wiring")


def is_set(bus: SensorBus, address: int) -> bool:
    """Return whether the chip has its units and its mode."""
    mode, units = (bus.read_i2c_block_data(address, register, 1)[0] for register in (OPR_MODE, UNIT_SEL))
    return mode & 0x0F == IMU and units & 0x07 == UNITS


def readings(given: Bno055Options, opened: Callable[[], SensorBus], wait: Wait) -> Iterator[ImuReading | None]:
    """Yield readings in the vehicle's axes, one in each period; raises HalError when the bus or the chip fails."""
    yaw, mount = given.mount.yaw, given.mount._replace(yaw=0.0)
    unsure = given.sigma._replace(rates=max(BIAS_UNKNOWN, given.sigma.rates or 0.0))
    turned, back = turning(yaw), (0.0, 0.0, -sin(0.5 * yaw), cos(0.5 * yaw))
    try:
        with closing(opened()) as bus:
            begin(bus, given.address, wait)
            while True:
                wait(given.period)
                told = decode(bus.read_i2c_block_data(given.address, ACC_DATA, DATA.size))
                if told is None:
                    # misread, or it lost its power and is in its first mode
                    begin(bus, given.address, wait)
                    yield None
                    continue
                knows = bus.read_i2c_block_data(given.address, CALIB_STAT, 1)[0] >> 4 & 3 == 3
                yield ImuReading(
                    turned(told.force),
                    turned(told.rates),
                    product(told.orientation, back),
                    None,
                    mount,
                    given.sigma if knows else unsure,
                )
    except OSError as error:
        raise HalError(why_silent(error, given.bus, given.address)) from None


def create(setup: Setup) -> Frames[ImuReading]:
    """Make the driver ``imu_bno055``; options: those of `Bno055Options`."""
    from txt1.sensors.virtual_i2c_imus import Bno055Chip

    given = checked(Bno055Options, setup.options, f"sensors.{setup.name}.options")
    return sensor(setup.name, given, opener(setup, given.bus, lambda: Bno055Chip(given.address)))


def sensor(name: str, given: Bno055Options, opened: Callable[[], SensorBus]) -> Frames[ImuReading]:
    """Return the sensor on a bus that `opened` opens in the sensor's thread."""
    return Frames(imu_topic(name), given.period, lambda wait: readings(given, opened, wait))
