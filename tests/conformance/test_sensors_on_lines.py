"""Drivers of devices on a line or a socket keep the promises of every sensor, also when their device falls silent."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, ClassVar

import pytest

from tests.conformance.test_simulated_sensors import twin
from txt1.config import load
from txt1.link.base import Port
from txt1.sensors.base import Sensor, Setup
from txt1.sensors.conformance import SensorConformance
from txt1.sensors.laser_scip import ScipDecoder
from txt1.sensors.readings import Scan
from txt1.sensors.registry import DRIVERS
from txt1.sensors.stream import Measured, Streamed
from txt1.sensors.virtual_bno08x import bno08x
from txt1.sensors.virtual_gps import VirtualGpsd
from txt1.sensors.virtual_imu import VirtualImu
from txt1.sensors.virtual_lasers import VirtualScip, ld19
from txt1.sensors.virtual_mocap import VirtualVicon
from txt1.sensors.virtual_rplidar import a1, a3, s2
from txt1.sensors.virtual_sensor import DeskPort, VirtualSensor
from txt1.sensors.virtual_ydlidar import VirtualYdlidar


class OnALine(SensorConformance):
    """A driver with its virtual device behind a port in memory."""

    driver: ClassVar[str]
    shown: ClassVar[tuple[str, dict[str, Any]]]
    options: ClassVar[dict[str, Any]] = {}
    # decoding a scan takes longer than the loop of the suite
    processor = 0.0004

    def device(self) -> VirtualSensor:
        raise NotImplementedError

    def behind(self, wrap: Callable[[Port], Port]) -> Sensor[Any]:
        setup = Setup(f"on_{self.driver}", self.options, load().config)
        sensor: Streamed[Any] = DRIVERS.make("driver", self.driver, setup)
        name, given = self.shown
        sensor.port = wrap(DeskPort("desk", self.device, twin(name, **given)))
        return sensor

    def make(self) -> Sensor[Any]:
        return self.behind(lambda port: port)


class TestImu(OnALine):
    driver, shown = "imu_3dmgx2", ("sim_imu", {})

    def device(self) -> VirtualSensor:
        return VirtualImu()


class TestBno08x(OnALine):
    driver, shown = "imu_bno08x_rvc", ("sim_imu", {})

    def device(self) -> VirtualSensor:
        return bno08x()


class TestGps(OnALine):
    driver, shown = "gps_gpsd", ("sim_gps", {})

    def device(self) -> VirtualSensor:
        return VirtualGpsd()

    def make(self) -> Sensor[Any]:
        pytest.importorskip("utm", reason="the UTM grid needs the extra 'devices'")
        return super().make()


class TestTracker(OnALine):
    driver, shown = "mocap_vrpn", ("sim_vicon", {})

    def device(self) -> VirtualSensor:
        return VirtualVicon()


class TestScip(OnALine):
    driver, shown = "laser_scip", ("sim_laser", {"range_max": 5.6})

    def device(self) -> VirtualSensor:
        return VirtualScip(old=True)


class TestLd19(OnALine):
    driver, shown = "laser_ld19", ("sim_laser", {"steps": 450, "beams": 450, "range_max": 12.0})

    def device(self) -> VirtualSensor:
        return ld19()


class TestRplidarExpress(OnALine):
    driver, shown = "laser_rplidar", ("sim_laser", {"steps": 720, "beams": 720})

    def device(self) -> VirtualSensor:
        return a1()


class TestRplidarUltra(TestRplidarExpress):
    def device(self) -> VirtualSensor:
        return a3()


class TestRplidarDense(TestRplidarExpress):
    def device(self) -> VirtualSensor:
        return s2()


class TestYdlidarX2(OnALine):
    driver, shown = "laser_ydlidar", ("sim_laser", {"steps": 720, "beams": 720})
    options: ClassVar[dict[str, Any]] = {"model": "x2"}

    def device(self) -> VirtualSensor:
        return VirtualYdlidar(self.options["model"])


class TestYdlidarX4(TestYdlidarX2):
    options: ClassVar[dict[str, Any]] = {"model": "x4"}


class TestYdlidarTg30(TestYdlidarX2):
    options: ClassVar[dict[str, Any]] = {"model": "tg30"}


@pytest.mark.parametrize(
    "name",
    [
        "test_a_device_that_starts_again_in_its_first_mode_reads_on",
        "test_a_connection_that_is_half_open_is_made_again",
        "test_a_device_that_is_unplugged_reads_on_when_it_is_back",
    ],
)
def test_a_driver_that_does_not_answer_silence_is_noticed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("txt1.link.silence.Ladder.due", property(lambda ladder: inf))
    with pytest.raises(AssertionError, match="returns readings when the device is back"):
        getattr(TestImu(), name)()


def test_a_driver_that_asks_again_at_once_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    class Impatient(ScipDecoder):
        def feed(self, data: bytes) -> list[Measured[Scan]]:
            if data.endswith(b"PP\n\n"):
                self._out = b"PP\n"
            return super().feed(data)

    monkeypatch.setattr("txt1.sensors.laser_scip.ScipDecoder", Impatient)
    with pytest.raises(AssertionError, match="asks a device that makes no sense now and then"):
        TestScip().test_a_device_that_makes_no_sense_is_not_asked_at_once()
