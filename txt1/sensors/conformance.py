"""Promises every sensor keeps: the suite that any sensor, ours or a stranger's, can be run through.

With pytest, which collects the `test_` methods of a subclass whose name starts with "Test"::

    from txt1.sensors.conformance import SensorConformance

    class TestMyThermometer(SensorConformance):
        speed = None  # it is real
        def make(self):
            return Thermometer("/dev/ttyUSB1")

From the command line, for one that is configured::

    txt1 sensor check inside --set sensors.inside.driver=thermometer

The promises themselves stand in `txt1.sensors.base`; a failure names the one that was broken.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from math import inf, isfinite
from statistics import median
from typing import Any, ClassVar, Final
from unittest import SkipTest

from txt1 import conformance
from txt1.conformance import Promises, named
from txt1.errors import HalError, Txt1Error
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.kernel.loop import Speed, run
from txt1.sensors.base import Reading, Sensor
from txt1.telemetry.topics import Rule, Topic

PROMPT: Final = 0.002
"""A call of `read` may take so long at the median, s, for the controller to keep its period."""

ROUNDING: Final = 1e-9

_PROMISES: Final = Promises("txt1.sensors.base")
promise, broken = _PROMISES.promise, _PROMISES.broken


class SensorConformance:
    """The promises, one test each. Override `make`, and `absent` and the settings where the defaults do not fit."""

    speed: ClassVar[Speed] = "max"
    """Virtual time. None is real time, for real hardware."""

    settle: ClassVar[float] = 3.0
    """Seconds in which the sensor has a reading."""

    def make(self) -> Sensor[Any]:
        """A new sensor, not opened yet; override this."""
        raise NotImplementedError("override SensorConformance.make: it returns a new sensor that is not opened yet")

    def absent(self) -> Sensor[Any] | None:
        """A new sensor whose hardware is not there; override this where there can be one. None skips what needs it."""
        return None

    # -- identity and life -------------------------------------------------------------------------------------

    def test_the_topic_says_how_its_values_are_told(self) -> None:
        """Sensor.topic."""
        topic = self.make().topic
        promise(isinstance(topic, Topic), "Sensor.topic", f"is a Topic, not {type(topic).__name__}")
        promise(topic.rule is Rule.EVENT, "Sensor.topic", f"is told as it comes (Rule.EVENT), not {topic.rule.value}")

    def test_the_period_is_a_time(self) -> None:
        """Sensor.period."""
        period = self.make().period
        promise(
            isinstance(period, float | int) and 0.0 < period < inf,
            "Sensor.period",
            f"is a positive number of seconds, not {period!r}",
        )

    def test_topic_and_period_are_constant(self) -> None:
        """Sensor.topic and Sensor.period."""

        async def body(bench: Bench) -> None:
            before = bench.sensor.topic, bench.sensor.period
            await bench.reading()
            await bench.sensor.close()
            promise((bench.sensor.topic, bench.sensor.period) == before, "Sensor.topic, Sensor.period", "are constant")

        self._run(body)

    def test_closing_twice_is_harmless(self) -> None:
        """Sensor.close."""

        async def body(bench: Bench) -> None:
            await bench.sensor.close()
            await _harmless(bench.sensor, "when closed already")

        self._run(body)

    def test_closing_what_was_never_opened_is_harmless(self) -> None:
        """Sensor.close."""

        async def main() -> None:
            await _harmless(self.make(), "when it was never opened")

        run(main(), speed=self.speed)

    def test_a_closed_sensor_opens_again(self) -> None:
        """Sensor.open."""

        async def body(bench: Bench) -> None:
            before = await bench.reading()
            await bench.sensor.close()
            try:
                await bench.sensor.open()
            except Exception as error:
                broken("Sensor.open", f"makes the hardware ready again after close, but raised {named(error)}")
            after = await bench.reading()
            promise(after.time > before.time, "Reading.time", "does not go backwards, but did after close and open")

        self._run(body)

    def test_hardware_that_is_not_there_is_told_in_one_line(self) -> None:
        """Sensor.open."""
        sensor = self.absent()
        if sensor is None:
            raise SkipTest("override SensorConformance.absent to check what it says when its hardware is not there")

        async def main() -> None:
            try:
                await sensor.open()
            except Txt1Error as error:
                text = str(error)
                clear = len(text) > len("not found") and "\n" not in text
                promise(clear, "Sensor.open", f"says in one line what to do, not {text!r}")
            except Exception as error:
                broken("Sensor.open", f"raises HalError when its hardware is not there, but raised {named(error)}")
            else:
                broken("Sensor.open", "raises HalError when its hardware is not there, but succeeded")
            await _harmless(sensor, "when it could not be opened")

        run(main(), speed=self.speed)

    # -- reading -----------------------------------------------------------------------------------------------

    def test_it_has_a_reading_when_it_is_open(self) -> None:
        """Sensor.read."""

        async def body(bench: Bench) -> None:
            await bench.reading()

        self._run(body)

    def test_reading_is_prompt(self) -> None:
        """Sensor.read."""

        async def body(bench: Bench) -> None:
            took = []
            for _ in range(25):
                await asyncio.sleep(bench.sensor.period)
                begun = stopwatch_ns()
                bench.read()
                took.append((stopwatch_ns() - begun) / NS_PER_S)
            promise(
                median(took) < PROMPT,
                "Sensor.read",
                f"never waits, but takes {1e3 * median(took):.1f} ms at the median",
            )

        self._run(body)

    def test_nothing_is_read_twice(self) -> None:
        """Sensor.read."""

        async def body(bench: Bench) -> None:
            first = await bench.reading()
            second = bench.read()
            promise(
                second is None or second.time > first.time,
                "Sensor.read",
                f"returns None when there is no reading since the last one, but the one of {first.time} s came twice",
            )

        self._run(body)

    def test_times_neither_go_backwards_nor_lie_in_the_future(self) -> None:
        """Reading.time."""

        async def body(bench: Bench) -> None:
            last = -inf
            for _ in range(max(10, round(min(self.settle / bench.sensor.period, 100)))):
                await asyncio.sleep(bench.sensor.period)
                reading = bench.read()
                if reading is None:
                    continue
                time = reading.time
                promise(isfinite(time), "Reading.time", f"is a time, not {time!r}")
                now = bench.now
                promise(time <= now + ROUNDING, "Reading.time", f"is not in the future, but {time} s at {now} s")
                promise(time >= last, "Reading.time", f"does not go backwards, but {time} s came after {last} s")
                last = time

        self._run(body)

    def test_values_are_immutable_and_of_the_topics_type(self) -> None:
        """Reading.value."""

        async def body(bench: Bench) -> None:
            value = (await bench.reading()).value
            kind = bench.sensor.topic.type
            promise(isinstance(value, kind), "Reading.value", f"is a {kind.__name__}, not a {type(value).__name__}")
            try:
                hash(value)
            except TypeError:
                broken("Reading.value", f"is immutable, but {value!r} has no hash; make it a NamedTuple or frozen")

        self._run(body)

    def test_the_topic_makes_a_message_of_a_value(self) -> None:
        """Sensor.topic."""

        async def body(bench: Bench) -> None:
            topic, value = bench.sensor.topic, (await bench.reading()).value
            made = topic.make(value)
            if topic.paths:
                fits = len(made) == len(topic.paths) and all(isinstance(number, float | int) for number in made)
                promise(fits, "Sensor.topic", f"makes a number for each of {topic.paths}, not {made!r}")

        self._run(body)

    # -- inside ------------------------------------------------------------------------------------------------

    def _run(self, body: Callable[[Bench], Awaitable[None]]) -> None:
        """Run a test on a new sensor that is open, and close it."""

        async def main() -> None:
            bench = Bench(self.make(), self.settle)
            await _PROMISES.waited(bench.sensor.open(), "Sensor.open")
            try:
                await body(bench)
            except BaseException:
                with suppress(Exception):  # what the test found matters more
                    await bench.sensor.close()
                raise
            await _PROMISES.waited(bench.sensor.close(), "Sensor.close")

        run(main(), speed=self.speed)


class Bench:
    """An open sensor and the time of its run, which starts now."""

    def __init__(self, sensor: Sensor[Any], settle: float) -> None:
        self.sensor = sensor
        self._settle = settle
        self._loop = asyncio.get_running_loop()
        self._started = self._loop.time()

    @property
    def now(self) -> float:
        """Seconds since the run started."""
        return self._loop.time() - self._started

    def read(self) -> Reading[Any] | None:
        """What there is to be read now."""
        try:
            reading = _PROMISES.called("Sensor.read", self.sensor.read, self.now)
        except HalError as error:
            broken("Sensor.read", f"reads sound hardware, but raised {named(error)}")
        if reading is not None and not isinstance(reading, Reading):
            broken("Sensor.read", f"returns a Reading or None, not {type(reading).__name__}")
        return reading

    async def reading(self) -> Reading[Any]:
        """The next reading."""
        ends = self.now + self._settle
        while self.now < ends:
            await asyncio.sleep(self.sensor.period)
            if (reading := self.read()) is not None:
                return reading
        return broken("Sensor.read", f"returns a reading when there is one, but there was none in {self._settle:g} s")


async def _harmless(sensor: Sensor[Any], when: str) -> None:
    try:
        await _PROMISES.waited(sensor.close(), "Sensor.close")
    except Exception as error:
        broken("Sensor.close", f"is harmless {when}, but raised {named(error)}")


def promises() -> list[str]:
    """The names of all tests, in order."""
    return conformance.promises(SensorConformance)


def verdicts(make: Callable[[], Sensor[Any]], speed: Speed) -> Iterator[tuple[str, str]]:
    """Every promise in words, and "ok", "skipped: ..." or "BROKEN: ...", for the sensor that `make` makes."""
    return conformance.verdicts(SensorConformance, make, speed=speed)
