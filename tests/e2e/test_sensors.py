"""Sensors beside those of the hardware layer: opened, read, told, failing, and closed with the robot."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest

from tests.e2e.conftest import ENDLESS
from txt1.config import load
from txt1.config.schema import SensorConfig
from txt1.errors import ConfigError, HalError, TaskFault
from txt1.model.light_sensors import LUX_MAX, Readings
from txt1.robot import Robot
from txt1.runtime import Runtime
from txt1.sensors.base import SENSORS, Reading, reading_topic
from txt1.sensors.light import LIGHT, SimulatedLight
from txt1.sensors.registry import DRIVERS
from txt1.sim.view import distances
from txt1.telemetry.topics import Topic

INSTALLED = ", ".join(DRIVERS.names())
LIT = (*ENDLESS, "sensors.light.driver=sim_light", "sensors.light.options.seed=[1]")


class Thermometer:
    """A thermometer whose readings, or failures, are told beforehand."""

    period, simulated = 0.1, True

    def __init__(self, *readings: float | Exception | None) -> None:
        self.topic: Topic[float] = reading_topic("inside", float, "degrees Celsius", "the temperature inside")
        self.readings = list(readings)
        self.opened = self.closed = 0

    async def open(self) -> None:
        self.opened += 1

    async def close(self) -> None:
        self.closed += 1

    def read(self, now: float) -> Reading[float] | None:
        given = self.readings.pop(0) if self.readings else None
        if isinstance(given, Exception):
            raise given
        return None if given is None else Reading(now - 0.05, given)


async def test_a_configured_sensor_is_read_at_its_period_and_its_last_reading_is_at_hand() -> None:
    async with Robot.open("sim", seed=1, settings=LIT) as robot:
        before = robot.sensors["light"].readings
        await asyncio.sleep(1.0)
        reading = robot.sensor("light")
        assert reading is not None
        assert isinstance(reading.value, Readings)
        assert robot.now - reading.time <= 0.016
        assert robot.sensors["light"].readings - before == pytest.approx(62.5, abs=1.0)
        assert robot.sensors["light"].state().healthy


async def test_the_configured_period_takes_the_place_of_the_drivers() -> None:
    async with Robot.open("sim", seed=1, settings=(*LIT, "sensors.light.period=0.25")) as robot:
        before = robot.sensors["light"].readings
        await asyncio.sleep(2.0)
        assert robot.sensors["light"].readings - before == 8


async def test_readings_go_to_the_bus_with_their_own_time_stamps() -> None:
    told: list[tuple[Any, float]] = []
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        sensor = Thermometer(20.0, None, 21.0)
        robot.runtime.bus.subscribe(lambda topic, value, time: told.append((value, time)), [sensor.topic])
        await robot.add_sensor("inside", sensor)
        began = robot.now
        await asyncio.sleep(1.0)
        assert [value for value, _ in told] == [20.0, 21.0]
        assert told[0][1] == pytest.approx(began + 0.05, abs=0.05)
        assert told[1][1] - told[0][1] == pytest.approx(0.2)
        last = robot.sensor("inside")
        assert last is not None and last.value == 21.0
    assert (sensor.opened, sensor.closed) == (1, 1)


async def test_every_reading_can_be_streamed_until_the_run_ends() -> None:
    async def listen(robot: Robot) -> list[float]:
        return [reading.value async for reading in robot.sensor_stream("inside")]

    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        await robot.add_sensor("inside", Thermometer(*map(float, range(5))))
        listener = asyncio.ensure_future(listen(robot))
        await asyncio.sleep(1.0)
    assert await listener == [0.0, 1.0, 2.0, 3.0, 4.0]


async def test_failing_hardware_is_told_once_counted_and_does_not_stop_the_robot() -> None:
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        failures = [HalError("the probe does not answer"), OSError("unplugged"), HalError("still not")]
        await robot.add_sensor("inside", Thermometer(20.0, *failures))
        await asyncio.sleep(0.45)
        state = robot.sensors["inside"].state()
        assert (state.healthy, state.failures, state.readings) == (False, 3, 1)
        assert state.reason == "still not"
        assert state.values == {"value": 20.0}, "the last one that there was, with its time"
        assert robot.armed
        said = [text for _, text in robot.runtime.state.events if "inside" in text]
        assert said == ["sensor 'inside' fails: the probe does not answer"]


async def test_a_sensor_that_is_heard_again_is_healthy_again() -> None:
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        await robot.add_sensor("inside", Thermometer(20.0, HalError("gone"), 21.0))
        await asyncio.sleep(0.45)
        state = robot.sensors["inside"].state()
        assert (state.healthy, state.reason, state.failures) == (True, "", 1)
        assert any("healthy again" in text for _, text in robot.runtime.state.events)


async def test_a_sensor_that_falls_silent_is_unhealthy_after_two_seconds() -> None:
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        await robot.add_sensor("inside", Thermometer(20.0))
        await asyncio.sleep(1.9)
        assert robot.sensors["inside"].state().healthy
        await asyncio.sleep(0.4)
        assert robot.sensors["inside"].state().reason == "no reading for 2 s"


async def test_a_sensor_that_sends_once_a_second_is_healthy() -> None:
    # 1.2 s from one reading to the next, as the receiver's clock and the line have it
    silence = [None] * 11
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        await robot.add_sensor("gps", Thermometer(20.0, *silence, 21.0, *silence, 22.0, *silence))
        await asyncio.sleep(3.0)
        assert robot.sensors["gps"].state().readings == 3
        assert not [text for _, text in robot.runtime.state.events if "gps" in text]


async def test_a_sensor_that_has_never_been_heard_is_not_healthy() -> None:
    async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
        state = (await robot.add_sensor("inside", Thermometer())).state()
        assert robot.sensor("inside") is None
        assert (state.healthy, state.time, state.values) == (False, None, {})


async def test_a_mistake_in_a_driver_stops_the_robot_and_is_told() -> None:
    with pytest.raises(TaskFault, match="task 'sensor inside' failed: ZeroDivisionError"):
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.add_sensor("inside", Thermometer(20.0, ZeroDivisionError("division by zero")))
            await asyncio.sleep(1.0)
    assert not robot.armed


async def test_a_sensor_that_nobody_needs_is_left_alone() -> None:
    async with Robot.open("sim", seed=1, settings=LIT) as robot:
        await asyncio.sleep(0.5)
        robot.sensors["light"].needed = lambda: False
        before = robot.sensors["light"].readings
        await asyncio.sleep(5.0)
        assert robot.sensors["light"].readings == before
        assert robot.sensors["light"].state().healthy


async def test_hardware_that_cannot_be_opened_names_the_sensor_and_everything_is_closed() -> None:
    class Broken(Thermometer):
        async def open(self) -> None:
            raise ValueError("no such address")

    sound, broken = Thermometer(), Broken()
    with pytest.raises(HalError, match="sensor 'outside' cannot be opened: ValueError: no such address"):
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.add_sensor("inside", sound)
            await robot.add_sensor("outside", broken)
    assert sound.closed == broken.closed == 1


async def test_hardware_that_does_not_answer_in_its_own_time_is_told_as_any_other_failure() -> None:
    class Slow(Thermometer):
        async def open(self) -> None:
            raise TimeoutError("no answer in 2 s")

    with pytest.raises(HalError, match="sensor 'inside' cannot be opened: TimeoutError: no answer in 2 s"):
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.add_sensor("inside", Slow())


async def test_a_sensor_that_does_not_close_is_told_and_the_hardware_is_closed() -> None:
    class Stuck(Thermometer):
        async def close(self) -> None:
            await asyncio.sleep(3600.0)

    with pytest.raises(HalError, match="sensor 'inside' is not closed after 5 s"):
        async with Robot.open("sim", seed=1, settings=ENDLESS) as robot:
            await robot.add_sensor("inside", Stuck())
            robot.command(1.0, 0.0)
            await asyncio.sleep(0.1)
    assert robot.hal.outputs.motor == 0  # type: ignore[attr-defined]


async def test_a_name_that_is_taken_or_unknown_is_refused_with_those_there_are() -> None:
    async with Robot.open("sim", seed=1, settings=LIT) as robot:
        with pytest.raises(ValueError, match="there is a sensor 'light' already"):
            await robot.add_sensor("light", Thermometer())
        with pytest.raises(ConfigError, match=r"sensors\.smoke: there is no such sensor; there are: light"):
            robot.sensor("smoke")


async def test_an_unknown_driver_lists_those_that_are_installed() -> None:
    with pytest.raises(ConfigError) as error:
        async with Robot.open("sim", settings=["sensors.eye.driver=sim_ligth"]):
            pass
    assert str(error.value) == (
        f"sensors.eye.driver: there is no sensor driver 'sim_ligth'; installed: {INSTALLED}; did you mean 'sim_light'?"
    )


@pytest.mark.parametrize(
    ("setting", "problem"),
    [
        ("sensors.light.options.colour=red", "sensors.light.options.colour: unknown; known here: seed, faults"),
        ("sensors.light.options.faults=[dead]", "sensors.light.options: one fault for each of FL, FR, RL, RR"),
        ("sensors.light.options.faults=[none, none, none, blind]", "'blind' is not a valid SensorFault"),
    ],
)
async def test_a_wrong_option_names_its_key(setting: str, problem: str) -> None:
    with pytest.raises(ConfigError) as error:
        async with Robot.open("sim", settings=[*LIT, setting]):
            pass
    assert problem in str(error.value)


async def test_simulated_light_needs_a_simulated_robot() -> None:
    with pytest.raises(HalError, match=r"sensors\.light: .* which the HAL 'serial' does not know"):
        async with Robot.open("serial", settings=[*LIT, "serial.port=virtual"]):
            pass


async def test_real_hardware_is_refused_in_virtual_time() -> None:
    with pytest.raises(ConfigError, match="--speed: the sensor 'light' is not simulated and runs in real time only"):
        async with Robot.open("sim", settings=["sensors.light.driver=phidgets_light"]):
            pass


async def test_simulated_sensors_break_as_configured() -> None:
    settings = [*LIT, "sensors.light.options.faults=[none, dead, none, none]"]
    async with Robot.open("sim", settings=settings) as robot:
        await asyncio.sleep(0.1)
        reading = robot.sensor("light")
        assert reading is not None
        assert reading.value.front_right == 0.0
        assert 0.0 < reading.value.front_left <= LUX_MAX


async def test_readings_come_late_and_some_never_with_the_times_at_which_they_were_taken() -> None:
    settings = [*LIT, "sensors.light.delay=0.2", "sensors.light.drop_out=0.3"]
    told: list[tuple[float, float]] = []
    async with Robot.open("sim", seed=1, settings=settings) as robot:
        robot.runtime.bus.subscribe(lambda _, value, time: told.append((time, robot.now)), [LIGHT])
        await asyncio.sleep(16.0)
    lags = [arrived - taken for taken, arrived in told]
    assert min(lags) >= 0.2 and max(lags) < 0.25
    assert len(told) == pytest.approx(0.7 * 16.0 / 0.016, rel=0.1)


async def test_simulated_readings_repeat_from_the_seed() -> None:
    async def values(seed: int) -> list[Any]:
        told: list[Any] = []
        async with Robot.open("sim", seed=seed, settings=[*ENDLESS, "sensors.light.driver=sim_light"]) as robot:
            robot.runtime.bus.subscribe(lambda _, value, time: told.append(value), [LIGHT])
            await robot.load_gains()
            await robot.drive(0.5, 0.5, 2.0)
        return told

    assert await values(1) == await values(1) != await values(2)


async def test_two_light_sensors_have_topics_of_their_own() -> None:
    async with Robot.open("sim", settings=[*LIT, "sensors.second.driver=sim_light"]) as robot:
        assert [polled.sensor.topic.name for polled in robot.sensors.values()] == ["/light", "/sensors/second"]


async def test_a_list_of_all_sensors_with_their_health_is_a_topic_of_its_own() -> None:
    told: list[Any] = []
    async with Robot.open("sim", seed=1, settings=LIT) as robot:
        robot.runtime.bus.subscribe(lambda _, value, time: told.append(value), [SENSORS])
        await asyncio.sleep(2.5)
        assert len(told) >= 2, "once a second"
        (light,) = told[-1]
        assert (light.name, light.units, light.healthy) == ("light", "lux", True)
        status = SENSORS.make(told[-1])["status"][0]  # type: ignore[index,call-overload]
        assert (status["name"], status["message"]) == ("light", "healthy")
        assert {value["key"] for value in status["values"]} >= {"lux.0", "time", "readings"}


async def test_a_robot_without_sensors_tells_none() -> None:
    async with Robot.open("sim", settings=ENDLESS) as robot:
        assert robot.runtime.bus.read(SENSORS) is None
        assert dict(robot.sensors) == {}


async def test_a_board_has_no_sensors_of_the_hosts() -> None:
    from txt1.hal.registry import create

    config = load(overrides=LIT).config
    runtime = Runtime(config, lambda _: None, create(config))
    await runtime.start()
    assert dict(runtime.sensors) == {}
    await runtime.stop()


# -- pictures, which a thread draws -------------------------------------------------------------------------------


EYES = ("sensors.camera.driver=sim_camera", "sensors.depth.driver=sim_depth")


async def pictures() -> list[tuple[str, float, float, bytes]]:
    """What the cameras of a robot that drives a curve tell: their names, exposure, arrival, pixels."""
    pytest.importorskip("PIL", reason="JPEG needs the extra 'camera'")
    told: list[tuple[str, float, float, bytes]] = []
    async with Robot.open("sim", seed=1, settings=EYES) as robot:
        for name, polled in robot.sensors.items():
            polled.listeners.append(lambda seen, name=name: told.append((name, seen.time, robot.now, seen.value.data)))
        await robot.load_gains()
        await robot.drive(0.5, 0.5, 2.0)
    return told


async def test_pictures_repeat_to_the_last_bit_however_long_a_thread_draws_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = await pictures()
    drawn = 0

    def dawdling(*arguments: Any) -> Any:
        nonlocal drawn
        drawn += 1
        sum(range(1_000_000 * (drawn % 3)))
        return distances(*arguments)

    monkeypatch.setattr("txt1.sensors.sim_camera.distances", dawdling)
    assert await pictures() == first
    assert drawn > 20
    assert len({data for *_, data in first}) > 20


async def test_a_picture_is_a_period_old_when_it_arrives() -> None:
    ages = [arrival - exposure for _, exposure, arrival, _ in await pictures()]
    assert ages == pytest.approx([0.1] * len(ages))


async def test_no_thread_outlives_the_robot_that_draws() -> None:
    async with Robot.open("sim", settings=[*ENDLESS, "sensors.depth.driver=sim_depth"]):
        await asyncio.sleep(0.5)
        assert "txt1 camera" in {each.name.partition("_")[0] for each in threading.enumerate()}
    assert "txt1 camera" not in {each.name.partition("_")[0] for each in threading.enumerate()}


async def test_a_depth_camera_draws_no_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("txt1.sensors.sim_camera.draw")
    async with Robot.open("sim", settings=[*ENDLESS, "sensors.depth.driver=sim_depth"]) as robot:
        await asyncio.sleep(0.5)
        assert robot.sensors["depth"].state().healthy


async def test_a_picture_that_cannot_be_drawn_is_a_failure_of_the_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    async with Robot.open("sim", settings=[*ENDLESS, "sensors.depth.driver=sim_depth"]) as robot:
        await asyncio.sleep(0.5)
        with monkeypatch.context() as broken:
            broken.delattr("txt1.sensors.sim_camera.distances")
            await asyncio.sleep(0.5)
        state = robot.sensors["depth"].state()
        assert not state.healthy
        assert "the picture cannot be drawn: NameError: name 'distances' is not defined" in state.reason
        await asyncio.sleep(0.5)
        assert robot.sensors["depth"].state().healthy


# -- made by a program -------------------------------------------------------------------------------------------


async def test_a_program_makes_a_sensor_of_its_own_from_a_driver() -> None:
    async with Robot.open("sim", settings=ENDLESS) as robot:
        sensor = robot.runtime.make_sensor("eye", SensorConfig(driver="sim_light"))
        assert isinstance(sensor, SimulatedLight)
        await robot.add_sensor("eye", sensor)
        await asyncio.sleep(0.1)
        assert robot.sensor("eye") is not None
