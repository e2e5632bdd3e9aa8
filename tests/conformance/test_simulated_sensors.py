"""The simulated sensors keep the promises of every sensor."""

from typing import Any

import pytest

from txt1.config import load
from txt1.hal.registry import create as create_hal
from txt1.sensors.base import Sensor, Setup
from txt1.sensors.conformance import SensorConformance
from txt1.sensors.registry import DRIVERS


def twin(driver: str, **options: Any) -> Sensor[Any]:
    """A simulated sensor of a robot that stands in its room."""
    config = load().config
    setup = Setup("checked_" + driver, options, config, lambda: (1.0, 0.5, 0.2), create_hal(config))
    sensor: Sensor[Any] = DRIVERS.make("driver", driver, setup)
    return sensor


class TestImu(SensorConformance):
    def make(self) -> Sensor[Any]:
        return twin("sim_imu")


class TestGps(SensorConformance):
    def make(self) -> Sensor[Any]:
        pytest.importorskip("utm", reason="the UTM grid needs the extra 'devices'")
        return twin("sim_gps")


class TestTracker(SensorConformance):
    def make(self) -> Sensor[Any]:
        return twin("sim_vicon")


class TestLaser(SensorConformance):
    # 682 rays take 0.1 ms of a processor, and twice as long where others use its cache
    processor = 0.0003

    def make(self) -> Sensor[Any]:
        return twin("sim_laser")


class TestCamera(SensorConformance):
    def make(self) -> Sensor[Any]:
        pytest.importorskip("PIL", reason="JPEG needs the extra 'camera'")
        return twin("sim_camera")


class TestDepth(SensorConformance):
    def make(self) -> Sensor[Any]:
        return twin("sim_depth")
