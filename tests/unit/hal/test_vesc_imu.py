"""The VESC's own IMU: its answer as the firmware makes it, and what is told when there is none."""

from __future__ import annotations

import asyncio
from math import pi, radians
from struct import pack
from typing import Any

import pytest

from txt1.cars.vesc.driver import IMU_QUESTION, PacketId, Unpacker, imu_of, packet
from txt1.cars.vesc.virtual_vesc import Vesc
from txt1.config import load
from txt1.errors import ConfigError
from txt1.hal.registry import create
from txt1.kernel.loop import run
from txt1.robot import Robot
from txt1.sensors.base import Sensor, Setup
from txt1.sensors.conformance import SensorConformance
from txt1.sensors.registry import DRIVERS

CAR = ("vehicle=f1tenth", "hal=vesc", "serial.port=vesc", "sim.room.length=.inf", "sim.room.width=.inf")
WITH_IMU = (*CAR, "sensors.imu.driver=imu_vesc")
G = 9.80665
# as commands.c of the firmware 6.05 writes it: the command, the mask that was asked for, and each value whose bit is
# set, by buffer_append_float32_auto, which makes IEEE's float32
ANSWER = bytes.fromhex("41 01F8  3E800000 BF000000 3F800000  00000000 41200000 C2B40000")


def vesc_imu(*settings: str, **options: Any) -> Sensor[Any]:
    """A sensor on a line that nobody has opened yet."""
    config = load(None, [*CAR, *settings]).config
    made: Sensor[Any] = DRIVERS.make("driver", "imu_vesc", Setup("imu", options, config, None, create(config)))
    return made


class TestVescImu(SensorConformance):
    def make(self) -> Sensor[Any]:
        return vesc_imu()


def test_the_question_is_framed_as_the_firmware_reads_it() -> None:
    # accelerations and rates are bits 3 to 8
    assert Unpacker().feed(IMU_QUESTION) == [bytes.fromhex("41 01F8")]


def test_an_answer_of_the_firmware_is_read() -> None:
    (payload,) = Unpacker().feed(packet(ANSWER))
    assert imu_of(payload) == ((0.25, -0.5, 1.0), (0.0, 10.0, -90.0))


@pytest.mark.parametrize(
    "payload",
    [ANSWER[:-1], ANSWER + b"\0", b"\x41", pack(">BH3f", 65, 0x38, 0.0, 0.0, 1.0), ANSWER[:-4] + b"\x7f\xc0\0\0"],
    ids=["short", "long", "empty", "no rates", "not a number"],
)
def test_an_answer_that_lacks_a_value_is_none(payload: bytes) -> None:
    assert imu_of(payload) is None


def test_an_answer_with_more_values_is_read() -> None:
    more = pack(">BH16f", PacketId.GET_IMU_DATA, 0xFFFF, *range(16))
    assert imu_of(more) == ((3.0, 4.0, 5.0), (6.0, 7.0, 8.0))


def test_a_car_that_turns_tells_its_rate_and_its_weight() -> None:
    async def drive() -> Any:
        async with Robot.open(settings=[*WITH_IMU]) as robot:
            await robot.linked(5.0)
            robot.arm()
            await robot.drive(1.0, 0.8, 2.0)
            return robot.sensor("imu"), robot.odometry.omega

    reading, omega = run(drive(), speed="max")
    assert reading.value.acceleration[2] == pytest.approx(G)
    assert reading.value.rates[2] == pytest.approx(omega, rel=0.2)
    assert reading.value.rates[2] > 0.3
    assert reading.value.orientation is None


async def state_of_imu() -> Any:
    """Return the sensor's state after 2 s."""
    async with Robot.open(settings=[*WITH_IMU]) as robot:
        await asyncio.sleep(2.0)
        return robot.sensors["imu"].state()


def test_a_vesc_without_an_imu_is_missing_and_never_level(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Vesc.__init__

    def without(self: Vesc, *given: Any, **named: Any) -> None:
        made(self, *given, **named)
        self.imu = False

    monkeypatch.setattr(Vesc, "__init__", without)

    state = run(state_of_imu(), speed="max")
    assert not state.healthy
    assert state.readings == 0
    assert "an acceleration of 0: it has no IMU" in state.reason


@pytest.mark.parametrize(("g", "passes"), [(1.1, True), (0.5, False), (2.0, False)])
def test_the_first_acceleration_must_be_near_1_g(g: float, passes: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    tell = Vesc.send

    def heavy(self: Vesc, data: bytes) -> None:
        for payload in Unpacker().feed(data):
            if payload[0] == PacketId.GET_IMU_DATA:
                data = packet(pack(">BH6f", PacketId.GET_IMU_DATA, 0x1F8, 0.0, 0.0, g, 0.0, 0.0, 0.0))
        tell(self, data)

    monkeypatch.setattr(Vesc, "send", heavy)

    state = run(state_of_imu(), speed="max")
    assert state.healthy == passes
    assert passes or "g at first, and not 1: let the car stand still" in state.reason


def test_a_controller_that_is_mounted_turned_tells_the_vehicles_axes() -> None:
    sensor = vesc_imu(mount={"yaw": pi / 2})
    told = vars(type(sensor))["_reading"](sensor, imu_of(ANSWER))
    assert told.acceleration == pytest.approx((0.5 * G, 0.25 * G, G))
    assert told.rates == pytest.approx((radians(-10.0), 0.0, radians(-90.0)))


def test_the_imu_of_a_vesc_needs_a_vesc_that_drives() -> None:
    config = load(None, ["hal=sim"]).config
    with pytest.raises(ConfigError, match=r"sensors\.imu\.driver: imu_vesc .* use hal: vesc"):
        DRIVERS.make("driver", "imu_vesc", Setup("imu", {}, config))
