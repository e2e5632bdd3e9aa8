"""An ICM-20948 and a BNO055 by I2C: their makers' data sheets judge what is read."""

from __future__ import annotations

from itertools import islice
from math import cos, hypot, pi, radians, sin
from typing import Any

import pytest

from txt1.config import load
from txt1.errors import ConfigError, HalError
from txt1.sensors import imu_bno055, imu_icm20948, imu_mpu6050
from txt1.sensors.base import Setup
from txt1.sensors.imu_bno055 import Bno055Options
from txt1.sensors.imu_icm20948 import ICM20948, Icm20948Options
from txt1.sensors.readings import ImuReading, Mount, heading
from txt1.sensors.virtual_i2c_imus import Bno055Chip, Icm20948Chip

G = 9.80665


def icm(chip: Icm20948Chip, count: int, mount: Mount = Mount()) -> list[ImuReading | None]:  # noqa: B008
    """The next readings of a chip, by a robot that is not armed."""
    options = Icm20948Options(mount=mount)
    return list(islice(imu_mpu6050.readings(options, lambda: chip, lambda: False, lambda s: None, ICM20948), count))


def bno(chip: Bno055Chip, count: int, mount: Mount = Mount()) -> list[ImuReading | None]:  # noqa: B008
    """The next readings of a chip."""
    return list(islice(imu_bno055.readings(Bno055Options(mount=mount), lambda: chip, lambda s: None), count))


def sound(found: list[ImuReading | None]) -> ImuReading:
    """The last reading."""
    assert found[-1] is not None
    return found[-1]


def test_the_scales_of_the_icm_are_its_data_sheets() -> None:
    # DS-000189, tables 1 and 2: 65.5 counts a degree/s at +-500, 8192 counts a g at +-4 g; 7.2: high byte first,
    # accelerations at 2Dh, rates at 33h, then the temperature
    data = [0x20, 0x00, 0xE0, 0x00, 0x10, 0x00, 0x02, 0x8F, 0xFD, 0x71, 0x80, 0x00, 0x7F, 0xFF]
    force, rates = imu_icm20948.decode(data)
    assert force == pytest.approx((G, -G, G / 2))
    assert rates == pytest.approx((radians(10.0), radians(-10.0), radians(-500.3)), rel=1e-3)


def test_the_icm_is_woken_and_set_in_its_banks_and_left_in_the_first() -> None:
    chip = Icm20948Chip()
    assert sound(icm(chip, 1)).acceleration == pytest.approx((0.0, 0.0, G), abs=0.05)
    # 8.1: PWR_MGMT_1, bit 6 is sleep; 10.2 and 10.15: bits 2 and 1 are the ranges, bit 0 lets the filter work
    assert chip.bank == 0 and chip.banks[0][0x06] & 0x40 == 0
    assert chip.banks[2][0x01] & 7 == chip.banks[2][0x14] & 7 == 0b011


def test_an_icm_that_another_program_left_in_another_bank_is_found() -> None:
    chip = Icm20948Chip()
    chip.bank = 3
    assert sound(icm(chip, 1)).acceleration == pytest.approx((0.0, 0.0, G), abs=0.05)


def test_the_icms_bias_is_found_at_rest_and_it_is_woken_after_a_loss_of_power() -> None:
    chip = Icm20948Chip()
    assert sound(icm(chip, 120)).rates == pytest.approx((0.0, 0.0, 0.0), abs=0.005)
    made = imu_mpu6050.readings(Icm20948Options(), lambda: chip, lambda: False, lambda s: None, ICM20948)
    next(made)
    chip.power_up()
    assert next(made) is None
    assert sound([next(made)]).acceleration[2] == pytest.approx(G, abs=0.05)


def test_the_scales_of_the_bno_are_its_data_sheets() -> None:
    # BST-BNO055-DS000, tables 3-17, 3-22 and 3-31: 100 counts a m/s^2, 16 a degree/s, 2^14 a quaternion's 1; 4.3.9 and
    # following: low byte first, accelerations, field, rates, angles, then w x y z of the quaternion
    data = [0xD5, 0x03, 0x9C, 0xFF, 0, 0, *(0,) * 6, 0xA0, 0x00, 0x60, 0xFF, 0, 0, *(0,) * 6]
    # a quarter turn to the left: w and z are 11585
    told = imu_bno055.decode([*data, 0x41, 0x2D, 0, 0, 0, 0, 0x41, 0x2D])
    assert told is not None
    assert told.force == pytest.approx((9.81, -1.0, 0.0))
    assert told.rates == pytest.approx((radians(10.0), radians(-10.0), 0.0))
    assert heading(told.orientation) == pytest.approx(pi / 2)
    assert imu_bno055.decode([*data, 0x41, 0x2D, 0, 0, 0, 0, 0x41, 0x6D]) is None, "a flipped bit is no rotation"


def test_the_bno_is_set_to_its_mode_imu_and_one_that_is_set_is_left_alone() -> None:
    chip = Bno055Chip()
    assert sound(bno(chip, 1)).acceleration == pytest.approx((0.0, 0.0, G), abs=0.01)
    # table 3-5: IMU is 1000b; 3.6.1: bits 0 and 1 of UNIT_SEL are m/s^2 and degrees/s
    assert (chip.registers[0x3D], chip.registers[0x3B] & 3) == (0x08, 0)
    wrote: list[Any] = []
    chip.write = lambda register, data: wrote.append(register)  # type: ignore[method-assign]
    assert sound(bno(chip, 1)) and not wrote, "its orientation would begin anew"


def test_a_bno_that_lost_its_power_or_was_misread_is_read_on() -> None:
    chip = Bno055Chip()
    made = imu_bno055.readings(Bno055Options(), lambda: chip, lambda s: None)
    assert next(made) is not None
    chip.power_up()
    assert next(made) is None
    assert next(made) is not None and chip.registers[0x3D] == 0x08


def test_the_bnos_sigma_tells_whether_the_chip_knows_its_bias() -> None:
    chip = Bno055Chip()
    chip.calibrated = 1
    unsure = sound(bno(chip, 1)).sigma
    chip.calibrated = 3
    sure = sound(bno(chip, 1)).sigma
    assert unsure is not None and unsure.rates is not None and unsure.rates > 0.3
    assert sure is not None and sure.rates == 0.01


@pytest.mark.parametrize("yaw", [0.0, pi / 2, -pi / 2, pi])
def test_chips_that_are_mounted_turned_tell_the_vehicles_axes(yaw: float) -> None:
    icm_chip, bno_chip = Icm20948Chip(), Bno055Chip()
    icm_chip.bias = (0.0, 0.0, 0.0)
    for chip in (icm_chip, bno_chip):
        # the vehicle's nose is up: its x axis feels a part of gravity
        chip.force, chip.rates = (2.0 * cos(yaw), -2.0 * sin(yaw), 9.6), (0.0, 0.0, 1.0)
    for reading in (sound(icm(icm_chip, 1, Mount(yaw=yaw))), sound(bno(bno_chip, 1, Mount(yaw=yaw)))):
        assert reading.acceleration == pytest.approx((2.0, 0.0, 9.6), abs=0.05)
        assert reading.rates == pytest.approx((0.0, 0.0, 1.0), abs=0.01)


def test_the_bnos_orientation_agrees_with_gravity_and_is_the_vehicles() -> None:
    chip = Bno055Chip()
    chip.heading, chip.pitch = 0.5, 0.2
    chip.force = (G * sin(0.2), 0.0, G * cos(0.2))
    reading = sound(bno(chip, 1))
    assert reading.orientation is not None
    x, y, z, w = reading.orientation
    # the vehicle's axes in which the world's vertical lies
    up = 2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z
    felt = hypot(*reading.acceleration)
    assert up == pytest.approx([part / felt for part in reading.acceleration], abs=0.01)
    assert heading(reading.orientation) == pytest.approx(0.5, abs=0.01)
    turned = sound(bno(chip, 1, Mount(yaw=0.3))).orientation
    assert turned is not None and heading(turned) == pytest.approx(0.2, abs=0.03)


def test_another_chip_and_the_bus_of_the_outputs_are_refused() -> None:
    other = Bno055Chip()
    other.registers[0x00] = 0x68
    with pytest.raises(HalError, match="is no BNO055: it says 0x68"):
        bno(other, 1)
    strange = Icm20948Chip()
    strange.banks[0][0x00] = 0x71
    with pytest.raises(HalError, match="is no ICM20948: it says 0x71"):
        icm(strange, 1)
    config = load(None, ["hal=pi"], {}, {"vehicle": "donkeycar"}).config
    for create in (imu_bno055.create, imu_icm20948.create):
        with pytest.raises(ConfigError, match="1 is the bus of the outputs"):
            create(Setup("imu", {"bus": 1}, config))
