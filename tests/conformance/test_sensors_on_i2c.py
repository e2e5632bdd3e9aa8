"""Drivers of chips on an I2C bus keep the promises of every sensor, also when the bus fails."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from txt1.errors import HalError
from txt1.sensors import imu_bno055, imu_mpu6050
from txt1.sensors.base import Reading, Sensor, reading_topic
from txt1.sensors.conformance import SensorConformance
from txt1.sensors.frame_grabber import Frames, Wait
from txt1.sensors.i2c import SensorBus
from txt1.sensors.imu_icm20948 import ICM20948, Icm20948Options
from txt1.sensors.virtual_i2c_imus import Bno055Chip, Icm20948Chip
from txt1.sensors.virtual_mpu6050 import Mpu6050Chip, Mpu9250Chip

Opened = Callable[[], Any]


class OnABus(SensorConformance):
    """A driver with its virtual chip on a bus in memory. The driver reads it in a thread, so in real time."""

    speed = None
    # on a busy computer, also if it holds up the thread of a virtual chip, which has Python's lock then
    settle = 20.0
    prompt = 0.2

    def chip(self) -> Any:
        raise NotImplementedError

    def sensor(self, opened: Opened) -> Sensor[Any]:
        raise NotImplementedError

    def on_bus(self, wrap: Callable[[Opened], Opened]) -> Sensor[Any]:
        return self.sensor(wrap(self.chip))

    def make(self) -> Sensor[Any]:
        return self.sensor(self.chip)

    def absent(self) -> Sensor[Any]:
        def nowhere() -> Any:
            raise FileNotFoundError(2, "No such file or directory")

        return self.sensor(nowhere)


class TestMpu6050(OnABus):
    def chip(self) -> Any:
        return Mpu6050Chip()

    def sensor(self, opened: Opened) -> Sensor[Any]:
        return imu_mpu6050.sensor("checked_mpu", imu_mpu6050.Mpu6050Options(), opened, lambda: False)


class TestMpu9250(TestMpu6050):
    """It is awake after power-up, and measures at other scales."""

    def chip(self) -> Any:
        return Mpu9250Chip()


class TestIcm20948(OnABus):
    def chip(self) -> Any:
        return Icm20948Chip()

    def sensor(self, opened: Opened) -> Sensor[Any]:
        return imu_mpu6050.sensor("checked_icm", Icm20948Options(), opened, lambda: False, ICM20948)


class TestBno055(OnABus):
    def chip(self) -> Any:
        return Bno055Chip()

    def sensor(self, opened: Opened) -> Sensor[Any]:
        return imu_bno055.sensor("checked_bno", imu_bno055.Bno055Options(), opened)


# -- a stranger's driver --------------------------------------------------------------------------------------------


class ThermometerBus:
    """A bus with a thermometer that tells thousandths of a degree once it was switched on."""

    def __init__(self) -> None:
        self.on = 0

    def write_byte_data(self, address: int, register: int, value: int) -> None:
        self.on = value

    def read_word_data(self, address: int, register: int) -> int:
        return 20_000 * self.on

    def close(self) -> None: ...


def degrees(opened: Opened, wait: Wait, attentive: bool = True) -> Iterator[float | None]:
    """The readings of a stranger's driver; `attentive`: it notices that the chip was switched off."""
    try:
        bus = opened()
        bus.write_byte_data(0x48, 0x01, 1)
        while True:
            wait(0.02)
            told = bus.read_word_data(0x48, 0x00)
            if told == 0 and attentive:
                bus.write_byte_data(0x48, 0x01, 1)
                yield None
                continue
            yield told / 1000.0
    except OSError as error:
        raise HalError(f"no thermometer answers: {error.strerror}") from None


def topic(name: str) -> Any:
    return reading_topic(name, float, "degrees Celsius", "a temperature")


class TestStrangersThermometer(OnABus):
    def chip(self) -> Any:
        return ThermometerBus()

    def sensor(self, opened: Opened) -> Sensor[Any]:
        return Frames(topic("thermometer"), 0.02, lambda wait: degrees(opened, wait))


class Inattentive(TestStrangersThermometer):
    """It reads on a chip that was switched off."""

    def sensor(self, opened: Opened) -> Sensor[Any]:
        return Frames(topic("inattentive"), 0.02, lambda wait: degrees(opened, wait, attentive=False))


class Blocking:
    """It reads the bus in `read`, without a thread, and asks a silent chip at once."""

    period, simulated = 0.02, False

    def __init__(self, opened: Callable[[], SensorBus]) -> None:
        self.topic = topic("blocking")
        self._degrees: Callable[[], Iterator[float | None]] = lambda: degrees(opened, lambda seconds: None)
        self._last = -1.0

    async def open(self) -> None:
        self._found = self._degrees()

    async def close(self) -> None: ...

    def read(self, now: float) -> Reading[Any] | None:
        try:
            told = next(self._found)
        except HalError:
            self._found = self._degrees()
            raise
        if told is None or now <= self._last:
            return None
        self._last = now
        return Reading(now, told)


class Hasty(TestStrangersThermometer):
    def sensor(self, opened: Opened) -> Sensor[Any]:
        return Blocking(opened)


@pytest.mark.parametrize(
    ("suite", "name", "broken"),
    [
        (Inattentive, "chip_that_starts_again_in_its_first_mode_reads_on_as_before", "as before the outage, not 0"),
        (
            Hasty,
            "chip_that_is_silent_for_a_second_is_told_and_reads_on",
            "asks a chip that does not answer now and then",
        ),
        (Hasty, "bus_that_is_held_is_told_and_keeps_nobody_waiting", "never waits, also while the bus is held"),
    ],
)
def test_a_driver_that_fails_with_its_bus_is_noticed(suite: type[OnABus], name: str, broken: str) -> None:
    with pytest.raises(AssertionError, match=broken):
        getattr(suite(), f"test_a_{name}")()
