"""Every sensor keeps the promises of `txt1.sensors.base`, and the suite notices when one does not."""

from __future__ import annotations

import sys
import time
from random import Random
from typing import Any

import numpy as np
import pytest

from txt1.cli import execute
from txt1.config import load
from txt1.conformance import promises, verdicts
from txt1.errors import HalError
from txt1.sensors.base import Reading, Sensor, Setup, reading_topic
from txt1.sensors.camera import jpeg
from txt1.sensors.conformance import SensorConformance
from txt1.sensors.light import SimulatedLight, eyes
from txt1.sensors.registry import DRIVERS, Impaired
from txt1.telemetry.topics import Rule, Topic


class Thermometer:
    """A sound one."""

    period, simulated = 0.25, True

    def __init__(self) -> None:
        self.topic: Topic[Any] = reading_topic("checked", float, "degrees Celsius", "a temperature")
        self._last = -1.0

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    def read(self, now: float) -> Reading[Any] | None:
        if now <= self._last:
            return None
        self._last = now
        return Reading(now, 20.0)


class Absent(Thermometer):
    async def open(self) -> None:
        raise HalError("no thermometer answers at address 0x48: is it plugged in?")


# what rpicam-vid writes: a picture, then its metadata; it imports little, so that it starts at once
RPICAM = """
import sys, time
picture, metadata = bytes.fromhex(sys.argv[1]), open(sys.argv[sys.argv.index("--metadata") + 1], "w")
while True:
    exposed = time.monotonic_ns()
    time.sleep(0.02)
    sys.stdout.buffer.write(picture)
    sys.stdout.flush()
    print(f"SensorTimestamp={exposed}", end="\\n\\n", file=metadata, flush=True)
"""


class TestRpiCamera(SensorConformance):
    speed = None

    def make(self) -> Sensor[Any]:
        pytest.importorskip("PIL", reason="JPEG needs the extra 'camera'")
        picture = jpeg(np.zeros((8, 8, 3), np.uint8)).hex()
        return self.filming(sys.executable, "-S", "-c", RPICAM, picture)

    def absent(self) -> Sensor[Any]:
        return self.filming("/nowhere/rpicam-vid")

    def filming(self, *program: str) -> Sensor[Any]:
        sensor: Sensor[Any] = DRIVERS.make(
            "driver", "camera_rpi", Setup("rpi_filming", {"program": program}, load().config)
        )
        return sensor


class TestThermometer(SensorConformance):
    def make(self) -> Sensor[Any]:
        return Thermometer()

    def absent(self) -> Sensor[Any]:
        return Absent()


class TestSimulatedLight(SensorConformance):
    def make(self) -> Sensor[Any]:
        return SimulatedLight(eyes(load().config, np.random.default_rng(1)), lambda: (1.0, 0.5, 0.2))


class TestImpaired(SensorConformance):
    def make(self) -> Sensor[Any]:
        return Impaired(Thermometer(), 0.3, 0.1, Random(1))


def mutant(**methods: Any) -> type[Thermometer]:
    return type("Mutant", (Thermometer,), methods)


async def refuse(self: Thermometer) -> None:
    raise RuntimeError("not again")


def slow(self: Thermometer, now: float) -> Reading[float]:
    time.sleep(0.004)
    return Reading(now, 20.0)


def busy(self: Thermometer, now: float) -> Reading[float]:
    return Reading(now, float(sum(range(200_000))))


async def late(self: Thermometer, now: float) -> Reading[float]:
    return Reading(now, 20.0)


def wrong_rule(self: Thermometer) -> None:
    self.topic = Topic("/sampled", float, "", "txt1_msgs/Value", Rule.SECOND, "")
    self._last = -1.0


def short(self: Thermometer) -> None:
    self.topic = Topic("/short", float, "", "txt1_msgs/Value", Rule.EVENT, "", {}, ("value",), lambda value: ())
    self._last = -1.0


def backwards(self: Thermometer, now: float) -> Reading[float]:
    return Reading(10.0 - now, 20.0)


class Vague(Thermometer):
    async def open(self) -> None:
        raise HalError("no\nluck")


class Crash(Thermometer):
    async def open(self) -> None:
        raise FileNotFoundError("/dev/ttyUSB1")


MUTANTS = [
    (mutant(__init__=wrong_rule), "the_topic_says_how_its_values_are_told", "is told as it comes"),
    (mutant(period=0.0), "the_period_is_a_time", "positive number of seconds, not 0.0"),
    (
        mutant(period=property(lambda self: 0.25 + 0.01 * self._last)),
        "topic_and_period_are_constant",
        "are constant",
    ),
    (mutant(close=refuse), "closing_what_was_never_opened_is_harmless", "RuntimeError: not again"),
    (mutant(read=lambda self, now: None), "it_has_a_reading_when_it_is_open", "there was none in 3 s"),
    (mutant(read=late), "it_has_a_reading_when_it_is_open", "returns at once, but must be awaited"),
    (mutant(read=lambda self, now: 20.0), "it_has_a_reading_when_it_is_open", "returns a Reading or None, not float"),
    (mutant(read=slow), "reading_is_prompt", "never waits, but waits"),
    (mutant(read=busy), "reading_is_prompt", "takes less than"),
    (mutant(read=lambda self, now: Reading(now, 20.0)), "nothing_is_read_twice", "came twice"),
    (
        mutant(read=lambda self, now: Reading(now + 1.0, 20.0)),
        "times_neither_go_backwards_nor_lie_in_the_future",
        "is not in the future",
    ),
    (mutant(read=backwards), "times_neither_go_backwards_nor_lie_in_the_future", "Reading.time"),
    (
        mutant(read=lambda self, now: Reading(now, [20.0])),
        "values_are_immutable_and_of_the_topics_type",
        "is a float, not a list",
    ),
    (mutant(__init__=short), "the_topic_makes_a_message_of_a_value", "makes a number for each of"),
]


@pytest.mark.parametrize(
    ("sensor", "name", "message"), MUTANTS, ids=[f"{n}-{k}" for k, (_, n, _) in enumerate(MUTANTS)]
)
def test_a_promise_that_is_broken_is_noticed(sensor: type[Thermometer], name: str, message: str) -> None:
    class Suite(SensorConformance):
        def make(self) -> Sensor[Any]:
            return sensor()

    with pytest.raises(AssertionError) as failure:
        getattr(Suite(), f"test_{name}")()
    assert message in str(failure.value)
    assert "txt1.sensors.base" in str(failure.value)


def test_a_slow_computer_breaks_no_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    """A read of 0.05 ms takes 2 ms where the processor is forty times slower."""

    def modest(self: Thermometer, now: float) -> Reading[float]:
        return Reading(now, float(sum(k * k for k in range(2000))))

    monkeypatch.setattr("txt1.conformance.processor_ns", lambda: 40 * time.thread_time_ns())
    found = dict(verdicts(SensorConformance, mutant(read=modest)))
    assert found["reading is prompt"] == "ok"


@pytest.mark.parametrize(("sensor", "message"), [(Vague, "says in one line"), (Crash, "but raised FileNotFoundError")])
def test_hardware_that_is_not_there_has_to_be_told_well(sensor: type[Thermometer], message: str) -> None:
    class Suite(SensorConformance):
        def absent(self) -> Sensor[Any]:
            return sensor()

    with pytest.raises(AssertionError, match=message):
        Suite().test_hardware_that_is_not_there_is_told_in_one_line()


def test_a_sensor_that_opens_only_once_is_noticed() -> None:
    class Once(Thermometer):
        opened = False

        async def open(self) -> None:
            if self.opened:
                raise HalError("it is busy")
            self.opened = True

    found = dict(verdicts(SensorConformance, Once))
    assert "BROKEN" in found["a closed sensor opens again"]
    assert [verdict for verdict in found.values() if verdict.startswith("BROKEN")] == [
        found["a closed sensor opens again"]
    ]


def test_the_command_checks_a_driver_or_a_configured_sensor(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["sensor", "check", "sim_light"]) == 0
    assert execute(["sensor", "check", "eye", "--set", "sensors.eye.driver=sim_light"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 * (len(promises(SensorConformance)) + 1), "and a verdict"
    assert "nothing is read twice: ok" in lines


def test_the_command_says_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["sensor", "list", "--set", "sensors.eye.driver=sim_light"]) == 0
    *drivers, sensor = capsys.readouterr().out.splitlines()
    assert drivers == [f"driver {name}" for name in DRIVERS.names()]
    assert {"driver phidgets_light", "driver sim_light"} <= set(drivers)
    assert sensor == "sensor eye: sim_light"
    assert execute(["sensor", "check", "sonar"]) == 2
    assert f"there is no sensor driver 'sonar'; installed: {', '.join(DRIVERS.names())}" in capsys.readouterr().err
