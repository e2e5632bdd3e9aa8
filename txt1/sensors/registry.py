"""Sensor drivers by name: the package's own from a table, others through the entry-point group ``txt1.sensors``.

A package announces its driver in its pyproject.toml::

    [project.entry-points."txt1.sensors"]
    thermometer = "mypackage.thermometer:create"

where ``create(setup: txt1.sensors.Setup) -> txt1.sensors.Sensor``; ``setup.options`` are its own settings.
"""

from collections import deque
from random import Random
from typing import Any, Final, Generic, TypeVar

from txt1.config.schema import SensorConfig
from txt1.errors import HalError
from txt1.plugins import Registry
from txt1.sensors.base import Reading, Sensor, Setup
from txt1.sim.random_streams import random_stream

T = TypeVar("T")

DRIVERS: Final = Registry(
    "sensor driver",
    "txt1.sensors",
    {
        "sim_light": "txt1.sensors.light:simulated",
        "phidgets_light": "txt1.sensors.light:phidgets",
        "camera": "txt1.sensors.camera:create",
        "camera_rpi": "txt1.sensors.camera_rpi:create",
        "depth_realsense": "txt1.sensors.depth:realsense",
        "depth_player": "txt1.sensors.depth:player",
        "sim_camera": "txt1.sensors.sim_camera:simulated",
        "sim_depth": "txt1.sensors.sim_camera:simulated_depth",
        "imu_3dmgx2": "txt1.sensors.imu_3dmgx2:create",
        "imu_bno08x_rvc": "txt1.sensors.imu_bno08x:create",
        "imu_mpu6050": "txt1.sensors.imu_mpu6050:create",
        "imu_icm20948": "txt1.sensors.imu_icm20948:create",
        "imu_bno055": "txt1.sensors.imu_bno055:create",
        "gps_gpsd": "txt1.sensors.gps_gpsd:create",
        "mocap_vrpn": "txt1.sensors.mocap_vrpn:create",
        "laser_scip": "txt1.sensors.laser_scip:create",
        "laser_ld19": "txt1.sensors.laser_ld19:create",
        "laser_rplidar": "txt1.sensors.laser_rplidar:create",
        "laser_ydlidar": "txt1.sensors.laser_ydlidar:create",
        "sim_imu": "txt1.sensors.sim_imu:simulated",
        "sim_gps": "txt1.sensors.sim_gps:simulated",
        "sim_vicon": "txt1.sensors.sim_vicon:simulated",
        "sim_laser": "txt1.sensors.sim_laser:simulated",
    },
    HalError,
)


def create(given: SensorConfig, setup: Setup) -> Sensor[Any]:
    """Return a sensor as configured, not opened yet; raises as `Registry.make`."""
    sensor: Sensor[Any] = DRIVERS.make(f"sensors.{setup.name}.driver", given.driver, setup)
    if given.delay or given.drop_out:
        rng = random_stream(setup.config.own_seed, "drop-outs", setup.name)
        return Impaired(sensor, given.delay, given.drop_out, rng)
    return sensor


class Impaired(Generic[T]):
    """A sensor whose readings are delayed (s) or lost (a share); they keep the times at which they were taken."""

    def __init__(self, sensor: Sensor[T], delay: float, drop_out: float, rng: Random) -> None:
        self.topic, self.period, self.simulated = sensor.topic, sensor.period, sensor.simulated
        self.close = sensor.close
        self._sensor, self._delay, self._drop_out, self._rng = sensor, delay, drop_out, rng
        self._under_way: deque[Reading[T]] = deque()

    async def open(self) -> None:
        """Open the sensor."""
        self._under_way.clear()
        await self._sensor.open()

    def read(self, now: float) -> Reading[T] | None:
        """Return the newest reading that has arrived by `now`."""
        reading = self._sensor.read(now)
        if reading is not None and self._rng.random() >= self._drop_out:
            self._under_way.append(reading)
        arrived = None
        while self._under_way and self._under_way[0].time + self._delay <= now:
            arrived = self._under_way.popleft()
        return arrived
