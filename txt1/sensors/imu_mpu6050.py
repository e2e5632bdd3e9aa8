"""InvenSense MPU6050 (MPU6500, MPU9250) by I2C: registers, bias at rest, driver.

The chip's gyro is off by up to 20 degrees a second, and by another value at each temperature. So its mean is taken
for zero whenever the robot is disarmed and the chip lies still for a second: a car that drives straight on looks still,
too, but is armed. Until then a reading's sigma says that the rates are worth little. An outage of the bus leaves the
bias as it is.

A chip that has lost its power starts in its first mode: an MPU6050 sleeps, an MPU9250 measures at other scales. So a
register that setting it up changes is read after each measurement.
"""

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from math import cos, hypot, radians, sin
from statistics import fmean, pstdev
from typing import Annotated, Final, Literal, NamedTuple

from annotated_types import Ge, Le

from txt1.config.sources import checked
from txt1.errors import HalError
from txt1.sensors.base import Setup
from txt1.sensors.frame_grabber import Frames, Wait
from txt1.sensors.i2c import SensorBus, opener, why_silent
from txt1.sensors.readings import IMU_MOUNT, STANDARD_GRAVITY, ImuReading, ImuSigma, Mount, Vector, imu_topic
from txt1.units import Positive

# registers of "MPU-6000 and MPU-6050 Register Map", revision 4.2
SMPLRT_DIV: Final = 0x19
CONFIG: Final = 0x1A
GYRO_CONFIG: Final = 0x1B
ACCEL_CONFIG: Final = 0x1C
ACCEL_XOUT_H: Final = 0x3B
PWR_MGMT_1: Final = 0x6B
WHO_AM_I: Final = 0x75
# accelerations, temperature, rates: seven words, high byte first
DATA: Final = struct.Struct(">7h")
KNOWN: Final = {0x68: "MPU6050", 0x70: "MPU6500", 0x71: "MPU9250"}
SETUP: Final = (
    # out of sleep, clock of the x gyro
    (PWR_MGMT_1, 0x01),
    # filter of 44 Hz
    (CONFIG, 0x03),
    # 200 samples a second
    (SMPLRT_DIV, 0x04),
    # +-500 degrees/s, +-4 g
    (GYRO_CONFIG, 0x08),
    (ACCEL_CONFIG, 0x08),
)
# counts per degree/s, and per g
PER_DEGREE: Final = 65.5
PER_G: Final = 8192.0

# samples that have to be still
STILL_SAMPLES: Final = 100
# rad/s, m/s^2: standard deviations of a chip that lies still, and share by which it may misjudge gravity
STILL_RATE: Final = 0.01
STILL_FORCE: Final = 0.3
GRAVITY_SHARE: Final = 0.1
# rad/s, largest bias: the data sheet's 20 degrees/s, and as much for the temperature
BIAS_MAX: Final = 0.7
# rad/s, standard deviation of the rates before the bias is known
BIAS_UNKNOWN: Final = 0.35


class RestBias:
    """Finds the gyro's bias while the chip lies still, and the robot is disarmed."""

    def __init__(self) -> None:
        self.bias: Vector | None = None
        """The mean of the last still second, rad/s; None before the first."""
        self._samples: list[tuple[float, ...]] = []

    def take(self, force: Vector, rates: Vector, armed: bool) -> None:
        """Take a sample: m/s^2, rad/s as the chip tells them; `armed`: the robot may move."""
        if armed:
            self._samples.clear()
            return
        self._samples.append((*force, *rates))
        if len(self._samples) < STILL_SAMPLES:
            return
        axes = tuple(zip(*self._samples, strict=True))
        self._samples.clear()
        means, spread = [fmean(axis) for axis in axes], [pstdev(axis) for axis in axes]
        upright = abs(hypot(*means[:3]) - STANDARD_GRAVITY) < GRAVITY_SHARE * STANDARD_GRAVITY
        if upright and max(spread[:3]) < STILL_FORCE and max(spread[3:]) < STILL_RATE:
            x, y, z = means[3:]
            if hypot(x, y, z) < BIAS_MAX:
                self.bias = x, y, z


def decode(data: Sequence[int]) -> tuple[Vector, Vector]:
    """Return specific force, m/s^2, and rates, rad/s, about the chip's axes, of its 14 bytes."""
    ax, ay, az, _, gx, gy, gz = DATA.unpack(bytes(data))
    g, w = STANDARD_GRAVITY / PER_G, radians(1.0) / PER_DEGREE
    return (ax * g, ay * g, az * g), (gx * w, gy * w, gz * w)


class MotionChip(NamedTuple):
    """A chip's registers."""

    # of its identity, and the names by what stands there
    who: int
    known: Mapping[int, str]
    # registers and values that wake it and set its ranges
    setup: Sequence[tuple[int, int]]
    # one of them that is another one after power-up
    mark: tuple[int, int]
    # of the first of 14 bytes, and their decoder
    data: int
    decode: Callable[[Sequence[int]], tuple[Vector, Vector]]
    # of the bank that its registers belong to, if it has banks
    bank: int | None = None


MPU6050: Final = MotionChip(WHO_AM_I, KNOWN, SETUP, (GYRO_CONFIG, 0x08), ACCEL_XOUT_H, decode)

SIGMA: Final = ImuSigma(rates=0.01, acceleration=1.0, attitude=0.0, heading=0.0)
"""Assumed; the chip tells no orientation."""


@dataclass(frozen=True, slots=True)
class Mpu6050Options:
    """The place of the chip, and its mounting."""

    bus: Annotated[int, Ge(0)] | Literal["virtual"] = 3
    """Number of the I2C bus, not that of a servo board; `virtual`: a virtual chip at rest."""
    address: Annotated[int, Ge(3), Le(0x77)] = 0x68
    """I2C address: 0x68, or 0x69 if AD0 is high."""
    period: Positive = 0.01
    """s between two readings."""
    mount: Mount = IMU_MOUNT
    """x, y, z (m) on the vehicle, and the angle (rad) of the chip's x axis to the vehicle's."""
    sigma: ImuSigma = SIGMA
    """Standard deviations for its messages: rates (rad/s) once the bias is known, accelerations (m/s^2)."""


def begin(bus: SensorBus, address: int, chip: MotionChip = MPU6050) -> None:
    """Wake the chip; raises HalError if it is another one or keeps nothing, OSError if none answers."""
    who = bus.read_i2c_block_data(address, chip.who, 1)[0]
    if who not in chip.known and chip.bank is not None:
        # another program may have left it in another bank
        bus.write_i2c_block_data(address, chip.bank, [0])
        who = bus.read_i2c_block_data(address, chip.who, 1)[0]
    if who not in chip.known:
        raise HalError(f"the chip at 0x{address:02x} is no {', '.join(chip.known.values())}: it says 0x{who:02x}")
    for register, value in chip.setup:
        bus.write_i2c_block_data(address, register, [value])
    if not is_set(bus, address, chip):
        raise HalError(f"the chip at 0x{address:02x} does not keep its settings: check its power and wiring")


def is_set(bus: SensorBus, address: int, chip: MotionChip) -> bool:
    """Return whether the chip has its settings."""
    register, value = chip.mark
    return bus.read_i2c_block_data(address, register, 1)[0] == value


def turning(yaw: float) -> Callable[[Vector], Vector]:
    """Return what turns a vector from a chip's axes to the vehicle's; `yaw` is the chip's x axis on it, rad."""
    c, s = cos(yaw), sin(yaw)

    def turned(vector: Vector) -> Vector:
        x, y, z = vector
        return c * x - s * y, s * x + c * y, z

    return turned


def readings(
    given: Mpu6050Options,
    opened: Callable[[], SensorBus],
    armed: Callable[[], bool],
    wait: Wait,
    chip: MotionChip = MPU6050,
    rest: RestBias | None = None,
) -> Iterator[ImuReading | None]:
    """Yield readings in the vehicle's axes, one in each period; raises HalError when the bus or the chip fails.

    `rest` is what is known of the bias.
    """
    rest = rest or RestBias()
    yaw, mount = given.mount.yaw, given.mount._replace(yaw=0.0)
    unsure = given.sigma._replace(rates=max(BIAS_UNKNOWN, given.sigma.rates or 0.0))
    turned = turning(yaw)
    try:
        with closing(opened()) as bus:
            begin(bus, given.address, chip)
            while True:
                wait(given.period)
                force, told = chip.decode(bus.read_i2c_block_data(given.address, chip.data, DATA.size))
                if not is_set(bus, given.address, chip):
                    # it lost its power before it measured this, or while it did
                    begin(bus, given.address, chip)
                    yield None
                    continue
                if not any(force):
                    # it has just been woken
                    yield None
                    continue
                rest.take(force, told, armed())
                bias = rest.bias or (0.0, 0.0, 0.0)
                rates = told[0] - bias[0], told[1] - bias[1], told[2] - bias[2]
                yield ImuReading(turned(force), turned(rates), None, None, mount, given.sigma if rest.bias else unsure)
    except OSError as error:
        raise HalError(why_silent(error, given.bus, given.address)) from None


def create(setup: Setup) -> Frames[ImuReading]:
    """Make the driver ``imu_mpu6050``; options: those of `Mpu6050Options`."""
    from txt1.sensors.virtual_mpu6050 import Mpu6050Chip

    given = checked(Mpu6050Options, setup.options, f"sensors.{setup.name}.options")
    opened = opener(setup, given.bus, lambda: Mpu6050Chip(given.address))
    return sensor(setup.name, given, opened, setup.armed)


def sensor(
    name: str,
    given: Mpu6050Options,
    opened: Callable[[], SensorBus],
    armed: Callable[[], bool],
    chip: MotionChip = MPU6050,
) -> Frames[ImuReading]:
    """Return the sensor on a bus that `opened` opens in the sensor's thread."""
    rest = RestBias()
    return Frames(imu_topic(name), given.period, lambda wait: readings(given, opened, armed, wait, chip, rest))
