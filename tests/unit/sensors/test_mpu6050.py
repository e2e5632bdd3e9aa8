"""An MPU6050 by I2C: its maker's pages judge what is read; its bias is found at rest; it may hold the bus."""

from __future__ import annotations

import asyncio
import errno
import os
from itertools import islice
from math import cos, pi, radians, sin
from random import Random

import pytest

from txt1.cars.pi.chips import Chip
from txt1.cars.pi.driver import PiHal, PiOptions, setup_of
from txt1.cars.pi.virtual_pi import LooseBus, VirtualPi
from txt1.config import Config, checked, load
from txt1.errors import ConfigError, HalError
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.sensors.base import Setup
from txt1.sensors.i2c import why_silent
from txt1.sensors.imu_mpu6050 import Mpu6050Options, RestBias, create, decode, readings
from txt1.sensors.readings import ImuReading, Mount
from txt1.sensors.virtual_mpu6050 import Mpu6050Chip, Mpu9250Chip
from txt1.sim.parameters import LineFaults

G = 9.80665


def read(chip: Mpu6050Chip, count: int, armed: bool = False, mount: Mount = Mount()) -> list[ImuReading]:  # noqa: B008
    """So many readings of a chip."""
    made = readings(Mpu6050Options(mount=mount), lambda: chip, lambda: armed, lambda seconds: None)
    return [each for each in islice(made, count) if each is not None]


def test_the_makers_scales_are_used() -> None:
    # "MPU-6000 and MPU-6050 Register Map" 4.2, sections 4.17 and 4.19: 8192 counts are 1 g at +-4 g, 65.5 counts are a
    # degree/s at +-500 degrees/s, two's complement, high byte first
    force, rates = decode([0x20, 0x00, 0xE0, 0x00, 0x10, 0x00, 0, 0, 0x02, 0x8F, 0xFD, 0x71, 0x80, 0x00])
    assert force == pytest.approx((G, -G, G / 2))
    assert rates == pytest.approx((radians(10.0), radians(-10.0), radians(-500.3)), rel=1e-3)


def test_a_chip_that_was_powered_up_is_woken_and_set() -> None:
    chip = Mpu6050Chip()
    (reading,) = read(chip, 1)
    assert reading.acceleration == pytest.approx((0.0, 0.0, G), abs=0.05)
    # section 4.28: bit 6 is sleep; 4.4 and 4.5: bits 4 and 3 are the ranges
    assert chip.registers[0x6B] & 0x40 == 0 and chip.registers[0x1B] >> 3 == chip.registers[0x1C] >> 3 == 1


def test_a_chip_that_lost_its_power_is_woken_again() -> None:
    chip = Mpu6050Chip()
    made = readings(Mpu6050Options(), lambda: chip, lambda: False, lambda seconds: None)
    assert next(made) is not None
    chip.power_up()
    assert next(made) is None
    again = next(made)
    assert again is not None and again.acceleration[2] == pytest.approx(G, abs=0.05)


def test_an_mpu9250_that_lost_its_power_is_not_read_at_its_first_scale() -> None:
    """An MPU9250 is awake then, and tells 1 g as 2 g by the scale that was set."""
    chip = Mpu9250Chip()
    made = readings(Mpu6050Options(), lambda: chip, lambda: False, lambda seconds: None)
    found = []
    for k in range(20):
        if k % 5 == 4:
            chip.power_up()
        found.append(next(made))
    forces = [each.acceleration[2] for each in found if each is not None]
    assert forces == pytest.approx([G] * 16, abs=0.05)


def test_a_chip_that_has_just_been_woken_tells_no_free_fall() -> None:
    chip = Mpu6050Chip()
    made = readings(Mpu6050Options(), lambda: chip, lambda: False, lambda seconds: None)
    assert next(made) is not None
    measure = chip.measure
    chip.measure = lambda: None  # type: ignore[method-assign]
    chip.registers[0x3B:0x49] = bytes(14)
    assert next(made) is None
    chip.measure = measure  # type: ignore[method-assign]
    assert next(made) is not None


def test_a_chip_that_keeps_no_settings_is_told() -> None:
    chip = Mpu6050Chip()
    chip.write = lambda register, data: None  # type: ignore[method-assign]
    with pytest.raises(HalError, match="the chip at 0x68 does not keep its settings: check its power"):
        read(chip, 1)


def test_an_outage_leaves_the_bias_as_it_is() -> None:
    chip, rest = Mpu6050Chip(), RestBias()

    def read_on(count: int, armed: bool) -> ImuReading:
        made = readings(Mpu6050Options(), lambda: chip, lambda: armed, lambda seconds: None, rest=rest)
        *_, last = islice(made, count)
        assert last is not None and last.sigma is not None
        return last

    read_on(120, armed=False)
    chip.held = True
    with pytest.raises(HalError):
        read_on(1, armed=True)
    chip.held = False
    chip.power_up()
    after = read_on(1, armed=True)
    assert after.rates == pytest.approx((0.0, 0.0, 0.0), abs=0.005) and after.sigma and after.sigma.rates == 0.01


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (errno.EREMOTEIO, "nothing answers; check wiring"),
        (errno.ENXIO, "nothing answers; check wiring"),
        (errno.ENODEV, "is its adapter plugged in"),
        (errno.ETIMEDOUT, "a chip may hold the bus"),
    ],
)
def test_each_error_of_a_bus_has_its_remedy(number: int, told: str) -> None:
    """A bus of two pins tells a missing answer as ENXIO, a Raspberry Pi's own as EREMOTEIO."""
    assert told in why_silent(OSError(number, os.strerror(number)), 3, 0x68)


def test_the_bias_is_found_at_rest_while_disarmed_and_told_by_the_sigma() -> None:
    chip = Mpu6050Chip()
    before, *_, after = read(chip, 120)
    assert before.rates == pytest.approx(chip.bias, abs=0.01) and before.sigma is not None
    assert before.sigma.rates is not None and before.sigma.rates > 0.3
    assert after.rates == pytest.approx((0.0, 0.0, 0.0), abs=0.005) and after.sigma is not None
    assert after.sigma.rates == 0.01


def test_no_bias_is_found_while_armed() -> None:
    assert read(Mpu6050Chip(), 300, armed=True)[-1].rates == pytest.approx((0.05, -0.12, 0.21), abs=0.01)


@pytest.mark.parametrize("motion", ["shaken", "turned by hand", "lifted", "spun"])
def test_no_bias_is_found_while_it_moves(motion: str) -> None:
    rest, rng = RestBias(), Random(1)
    for k in range(500):
        force, rates = (0.0, 0.0, G), (0.0, 0.0, 0.1)
        if motion == "shaken":
            force = (rng.gauss(0.0, 1.0), 0.0, G)
        elif motion == "turned by hand":
            rates = (0.0, 0.0, 0.1 + 0.3 * sin(0.1 * k))
        elif motion == "lifted":
            force = (0.0, 0.0, 1.2 * G)
        else:
            rates = (0.0, 0.0, 1.0)
        rest.take(force, rates, False)
    assert rest.bias is None


def test_an_arming_in_mid_search_begins_it_anew() -> None:
    rest = RestBias()
    for k in range(150):
        rest.take((0.0, 0.0, G), (0.0, 0.0, 0.1), armed=k == 80)
    assert rest.bias is None


@pytest.mark.parametrize("yaw", [0.0, pi / 2, -pi / 2, pi])
def test_a_chip_that_is_mounted_turned_tells_the_vehicles_axes(yaw: float) -> None:
    chip = Mpu6050Chip()
    chip.bias = (0.0, 0.0, 0.0)
    # the vehicle's nose is up: its x axis feels a part of gravity
    chip.force, chip.rates = (2.0 * cos(yaw), -2.0 * sin(yaw), 9.6), (0.0, 0.0, 1.0)
    (reading,) = read(chip, 1, mount=Mount(yaw=yaw))
    assert reading.acceleration == pytest.approx((2.0, 0.0, 9.6), abs=0.05)
    assert reading.rates == pytest.approx((0.0, 0.0, 1.0), abs=0.01)


def test_what_does_not_answer_or_is_another_chip_is_told() -> None:
    with pytest.raises(HalError, match="I2C bus 3, address 0x69: nothing answers; check wiring"):
        next(readings(Mpu6050Options(address=0x69), Mpu6050Chip, lambda: False, lambda seconds: None))
    other = Mpu6050Chip()
    other.registers[0x75] = 0xEA
    with pytest.raises(HalError, match="is no MPU6050, MPU6500, MPU9250: it says 0xea"):
        read(other, 1)
    held = Mpu6050Chip()
    held.held = True
    with pytest.raises(HalError, match="a chip may hold the bus"):
        read(held, 1)


# -- the bus of the outputs ---------------------------------------------------------------------------------------


def at_pi(*settings: str) -> Config:
    return load(None, ["hal=pi", *settings], {}, {"vehicle": "donkeycar"}).config


@pytest.mark.parametrize(
    ("settings", "bus", "refused"),
    [
        ([], 1, True),
        ([], 3, False),
        (["hal_options.bus=3"], 3, True),
        (["hal_options.watchdog=22"], 1, False),
        (["hal_options.output=gpio"], 1, False),
    ],
)
def test_a_sensor_on_the_bus_of_the_outputs_needs_a_watchdog(settings: list[str], bus: int, refused: bool) -> None:
    setup = Setup("imu", {"bus": bus}, at_pi(*settings))
    if refused:
        with pytest.raises(ConfigError, match=rf"sensors.imu.options.bus: {bus} is the bus of the outputs .* watchdog"):
            create(setup)
    else:
        assert create(setup).topic.name == "/sensors/imu"


class SharedBus(LooseBus):
    """A bus that carries the servo board and the sensor, whose data line is held down at times."""

    held = False

    def _chip(self, address: int) -> Chip:
        if self.held:
            raise TimeoutError(110, "Connection timed out")
        return super()._chip(address)


@pytest.mark.parametrize("seconds", [0.1, 1.0, 60.0])
def test_a_data_line_that_is_held_down_stops_a_car_with_a_watchdog(seconds: float) -> None:
    config = at_pi("hal_options.watchdog=22", "sim.room.length=.inf", "sim.room.width=.inf")
    options = checked(PiOptions, config.hal_options, "x")
    desk = VirtualPi(config, setup_of(options, config.geometry))
    chip: Mpu6050Chip = Mpu6050Chip()
    desk.bus = bus = SharedBus({**desk.bus.chips, 0x68: chip}, LineFaults(), Random(1))
    hal = PiHal(desk, options, config.geometry, simulated=True)
    imu = readings(Mpu6050Options(bus=1), lambda: bus, lambda: True, lambda seconds: None)

    async def drive() -> None:
        async with Robot.open(hal, config=config) as robot:

            async def keep_on(duration: float) -> None:
                ends = robot.now + duration
                while robot.now < ends:
                    robot.command(0.6, 0.0)
                    await asyncio.sleep(0.05)

            await keep_on(1.5)
            v = desk.vehicle.state.v
            assert v > 0.4 and next(imu) is not None
            bus.held = True
            with pytest.raises(HalError, match="a chip may hold the bus"):
                next(imu)
            await keep_on(min(seconds, 4.0))
            if seconds > 0.5:
                assert not robot.armed and abs(desk.vehicle.state.v) < 0.7 * v
            if seconds > 5.0:
                assert abs(desk.vehicle.state.v) < 0.01
                return
            bus.held = False
            await keep_on(1.5)
            if seconds < 0.2:
                assert robot.armed and desk.vehicle.state.v > 0.4, "no longer than a late command"
            else:
                assert not robot.armed and abs(desk.vehicle.state.v) < 0.1
            again = readings(Mpu6050Options(bus=1), lambda: bus, lambda: True, lambda seconds: None)
            assert next(again) is not None

    run(drive(), speed="max")
