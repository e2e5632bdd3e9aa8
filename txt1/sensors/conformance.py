"""The promises of every sensor, as a suite of tests for any sensor.

Use it in your own test class (see `txt1.conformance`), or from the command line for a configured sensor::

    txt1 sensor check inside --set sensors.inside.driver=thermometer

`txt1.sensors.base` states the promises.

A device behind a port has promises about silence, too. They are tried if `behind` returns a sensor whose port is
wrapped, with its virtual device behind the port: the outages are put on the bytes. Those of a chip on an I2C bus are
tried in the same way if `on_bus` returns a sensor whose bus is wrapped. Those of a camera, or of another device without
a port, are tried if `filmed` returns a sensor and what stands for its device.
"""

import asyncio
from collections.abc import Callable, Coroutine
from functools import wraps
from math import inf, isfinite
from statistics import fmean, median
from typing import Any, Final, Protocol
from unittest import SkipTest

from txt1.conformance import Conformance, broken, kept, named, opened, promise, unopened
from txt1.errors import HalError, Txt1Error
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.link.base import Port
from txt1.link.outages import Outage, OutagePort
from txt1.link.silence import LONGEST_PAUSE
from txt1.sensors.base import Reading, Sensor, numbers
from txt1.sensors.cut_bus import GIVES_UP, CutBus
from txt1.telemetry.topics import Rule, Topic

# s from opening to an outage
OUTAGE_BEGINS: Final = 4.0
# s within which a sensor reads again when its device is back: the longest pause, and the time to begin
BACK: Final = LONGEST_PAUSE + 5.0
# the most times a second that anything is written to a device that does not answer, on the average
ASKS: Final = 5.0
# readings whose mean is compared, and the share of the largest number by which a restart may change it
COMPARED_READINGS: Final = 5
RESTART_SHARE: Final = 0.1


def in_an_outage(
    outage: Outage, lasts: float
) -> Callable[[Callable[..., Coroutine[Any, Any, None]]], Callable[..., None]]:
    """Run a test on a new sensor whose port has this outage; skip it for a sensor without a port."""

    def decorate(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
        tested = opened(test)

        @wraps(test)
        def out(self: Any) -> None:
            ports: list[OutagePort] = []

            def wrapped(port: Port) -> Port:
                ports.append(OutagePort(port, outage, OUTAGE_BEGINS, lasts))
                return ports[-1]

            sensor = self.behind(wrapped)
            if sensor is None:
                raise SkipTest("override SensorConformance.behind to try outages, where there is a port")
            self.part, self.outage, self.lasts = sensor, ports[0], lasts
            tested(self)

        return out

    return decorate


class CutSource(Protocol):
    """What stands for a device without a port, such as a camera: its pictures can be cut off."""

    def cut(self, outage: Outage) -> None:
        """Send nothing more: SILENT, or UNPLUGGED, so that it cannot be opened."""

    def restore(self) -> None:
        """Send again."""


def cut_off(
    outage: Outage,
) -> Callable[[Callable[..., Coroutine[Any, Any, None]]], Callable[..., None]]:
    """Run a test on a new sensor whose source can be cut off; skip it for a sensor without one."""

    def decorate(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
        tested = opened(test)

        @wraps(test)
        def off(self: Any) -> None:
            made = self.filmed()
            if made is None:
                raise SkipTest("override SensorConformance.filmed to try outages of a device without a port")
            self.part, self.source = made
            self.kind = outage
            tested(self)

        return off

    return decorate


def on_its_bus(
    outage: Outage, lasts: float
) -> Callable[[Callable[..., Coroutine[Any, Any, None]]], Callable[..., None]]:
    """Run a test on a new sensor whose I2C bus can be cut off; skip it for a sensor without one."""

    def decorate(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
        tested = opened(test)

        @wraps(test)
        def cut(self: Any) -> None:
            buses: list[CutBus] = []

            def wrapped(make: Callable[[], Any]) -> Callable[[], Any]:
                buses.append(CutBus(make))
                return buses[-1].open

            sensor = self.on_bus(wrapped)
            if sensor is None:
                raise SkipTest("override SensorConformance.on_bus to try outages of an I2C bus, where there is one")
            self.part, self.bus, self.kind, self.lasts = sensor, buses[0], outage, lasts
            tested(self)

        return cut

    return decorate


# s of the processor that a simulated sensor may take: it computes what a device measures
COMPUTED: Final = 0.0003


class SensorConformance(Conformance[Sensor[Any]]):
    """The promises, a test for each. Override `make`; override `absent` and the settings if the defaults do not fit."""

    interface = Sensor
    outage: OutagePort
    lasts: float
    source: CutSource
    kind: Outage
    bus: CutBus
    # s without a picture after which a camera has to be told
    patience = 40.0

    def behind(self, wrap: Callable[[Port], Port]) -> Sensor[Any] | None:
        """Return a new sensor whose port is `wrap` of the port of its virtual device; None if it has no port."""
        return None

    def on_bus(self, wrap: Callable[[Callable[[], Any]], Callable[[], Any]]) -> Sensor[Any] | None:
        """Return a new sensor whose I2C bus is opened by `wrap` of what makes its virtual bus; None if it has no bus.

        What is given to `wrap` makes the bus with chips that have just got power. Its methods are those of smbus2, or
        whichever the driver calls; they are called in the driver's thread.
        """
        return None

    def filmed(self) -> tuple[Sensor[Any], CutSource] | None:
        """Return a new sensor of a device without a port, and what stands for the device; None if there is none."""
        return None

    def absent(self) -> Sensor[Any] | None:
        """Return a new sensor whose hardware is missing; override this if that is possible.

        None skips the tests that need it.
        """
        return None

    @opened
    async def test_the_topic_says_how_its_values_are_told(self) -> None:
        topic = self.part.topic
        promise(isinstance(topic, Topic), "Sensor.topic", f"is a Topic, not {type(topic).__name__}")
        promise(topic.rule is Rule.EVENT, "Sensor.topic", f"is told as it comes (Rule.EVENT), not {topic.rule.value}")

    @opened
    async def test_the_period_is_a_time(self) -> None:
        period = self.part.period
        fine = isinstance(period, float | int) and 0.0 < period < inf
        promise(fine, "Sensor.period", f"is a positive number of seconds, not {period!r}")

    @opened
    async def test_topic_and_period_are_constant(self) -> None:
        before = self.part.topic, self.part.period
        await self.reading()
        await self.part.close()
        promise((self.part.topic, self.part.period) == before, "Sensor.topic, Sensor.period", "are constant")

    @unopened
    async def test_closing_what_was_never_opened_is_harmless(self) -> None:
        await self.closes(self.part, "when it was never opened")

    @opened
    async def test_a_closed_sensor_opens_again(self) -> None:
        before = await self.reading()
        await self.reopen()
        after = await self.reading()
        promise(after.time > before.time, "Reading.time", "does not go backwards, but did after close and open")

    @unopened
    async def test_hardware_that_is_not_there_is_told_in_one_line(self) -> None:
        sensor = self.absent()
        if sensor is None:
            raise SkipTest("override SensorConformance.absent to check what it says when its hardware is not there")
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
        await self.closes(sensor, "when it could not be opened")

    @opened
    async def test_it_has_a_reading_when_it_is_open(self) -> None:
        await self.reading()

    @opened
    async def test_reading_is_prompt(self) -> None:
        await self.expect_prompt("Sensor.read", self.part.period, self.read)

    @opened
    async def test_nothing_is_read_twice(self) -> None:
        first = await self.reading()
        second = self.read()
        told = f"returns None when there is no reading since the last one, but the one of {first.time} s came twice"
        promise(second is None or second.time > first.time, "Sensor.read", told)

    @opened
    async def test_times_neither_go_backwards_nor_lie_in_the_future(self) -> None:
        last = -inf
        for _ in range(max(10, round(min(self.settle / self.part.period, 100)))):
            await asyncio.sleep(self.part.period)
            if (reading := self.read()) is None:
                continue
            time, now = reading.time, self.now
            promise(isfinite(time), "Reading.time", f"is a time, not {time!r}")
            promise(time <= now + 1e-9, "Reading.time", f"is not in the future, but {time} s at {now} s")
            promise(time >= last, "Reading.time", f"does not go backwards, but {time} s came after {last} s")
            last = time

    @opened
    async def test_values_are_immutable_and_of_the_topics_type(self) -> None:
        value, kind = (await self.reading()).value, self.part.topic.type
        promise(isinstance(value, kind), "Reading.value", f"is a {kind.__name__}, not a {type(value).__name__}")
        try:
            hash(value)
        except TypeError:
            broken("Reading.value", f"is immutable, but {value!r} has no hash; make it a NamedTuple or frozen")

    @opened
    async def test_the_topic_makes_a_message_of_a_value(self) -> None:
        topic = self.part.topic
        made = topic.make((await self.reading()).value)
        if topic.paths:
            fits = len(made) == len(topic.paths) and all(isinstance(number, float | int) for number in made)
            promise(fits, "Sensor.topic", f"makes a number for each of {topic.paths}, not {made!r}")

    # -- promises about silence --------------------------------------------------------------------------------

    @in_an_outage(Outage.SILENT, 1.0)
    async def test_a_device_that_is_silent_for_a_second_reads_on(self) -> None:
        await self.reads_on()

    @in_an_outage(Outage.SILENT, 60.0)
    async def test_a_device_that_is_silent_for_a_minute_reads_on(self) -> None:
        await self.reads_on()

    @in_an_outage(Outage.UNPLUGGED, 20.0)
    async def test_a_device_that_is_unplugged_reads_on_when_it_is_back(self) -> None:
        await self.reads_on()

    @in_an_outage(Outage.POWER, 10.0)
    async def test_a_device_without_power_behind_its_adapter_reads_on(self) -> None:
        await self.reads_on()

    @in_an_outage(Outage.POWER, 0.0)
    async def test_a_device_that_starts_again_in_its_first_mode_reads_on(self) -> None:
        await self.reads_on()

    @in_an_outage(Outage.HALF_OPEN, 0.0)
    async def test_a_connection_that_is_half_open_is_made_again(self) -> None:
        await self.reads_on()

    @in_an_outage(Outage.NONSENSE, 10.0)
    async def test_a_device_that_makes_no_sense_is_not_asked_at_once(self) -> None:
        await self.reads_on("makes no sense")

    @cut_off(Outage.SILENT)
    async def test_a_camera_that_is_silent_is_told_and_reads_on(self) -> None:
        await self.is_told_and_reads_on()

    @cut_off(Outage.UNPLUGGED)
    async def test_a_camera_that_is_unplugged_is_told_and_reads_on(self) -> None:
        await self.is_told_and_reads_on()

    @on_its_bus(Outage.SILENT, 1.0)
    async def test_a_chip_that_is_silent_for_a_second_is_told_and_reads_on(self) -> None:
        await self.chip_reads_on()

    @on_its_bus(Outage.SILENT, 60.0)
    async def test_a_chip_that_is_silent_for_a_minute_is_told_and_reads_on(self) -> None:
        await self.chip_reads_on()

    @on_its_bus(Outage.UNPLUGGED, 2.0)
    async def test_a_bus_that_is_unplugged_is_told_and_reads_on_when_it_is_back(self) -> None:
        await self.chip_reads_on()

    @on_its_bus(Outage.POWER, 2.0)
    async def test_a_chip_without_power_is_told_and_reads_on_as_before(self) -> None:
        await self.chip_reads_on()

    @on_its_bus(Outage.POWER, 0.0)
    async def test_a_chip_that_starts_again_in_its_first_mode_reads_on_as_before(self) -> None:
        await self.chip_reads_on()

    @on_its_bus(Outage.HELD, 3.0)
    async def test_a_bus_that_is_held_is_told_and_keeps_nobody_waiting(self) -> None:
        await self.chip_reads_on()

    # -- for the tests -----------------------------------------------------------------------------------------

    async def chip_reads_on(self) -> None:
        """Check that a bus that is cut is told, asked now and then and waited for by nobody, and read on as before."""
        before = await self.means()
        self.bus.cut(self.kind)
        if self.lasts > 0.0:
            await self.is_told()
            begun, asked = self.now, self.bus.transfers
            waited = []
            while self.now < begun + self.lasts:
                await asyncio.sleep(self.part.period)
                since = stopwatch_ns()
                self.try_to_read()
                waited.append((stopwatch_ns() - since) / NS_PER_S)
            promise(median(waited) < 0.5 * GIVES_UP, "Sensor.read", "never waits, also while the bus is held")
            often = (self.bus.transfers - asked) / (self.now - begun)
            told = f"asks a chip that does not answer now and then, but did so {often:.0f} times a second"
            promise(often <= ASKS, "Sensor", told)
        self.bus.restore()
        begun = self.now
        while self.try_to_read() is None or self.now < begun + COMPARED_READINGS * self.part.period:
            await asyncio.sleep(self.part.period)
            promise(self.now < begun + BACK, "Sensor.read", "returns readings when the device is back")
        after = await self.means()
        limit = RESTART_SHARE * max(map(abs, before.values()), default=0.0)
        for name, number in before.items():
            told = f"has {name} {number:.4g} as before the outage, not {after.get(name, 0.0):.4g}: the chip is at rest"
            promise(abs(after.get(name, 0.0) - number) <= limit, "Reading.value", told)

    async def means(self) -> dict[str, float]:
        """Return the means of the next readings' numbers."""
        read = [numbers(self.part.topic, (await self.reading()).value) for _ in range(COMPARED_READINGS)]
        return {name: fmean(each[name] for each in read) for name in read[0] if all(name in each for each in read)}

    async def is_told_and_reads_on(self) -> None:
        """Check that a cut source is told as a failure, and read again once it is restored."""
        await self.reading()
        self.source.cut(self.kind)
        await self.is_told()
        self.source.restore()
        begun = self.now
        while self.try_to_read() is None:
            await asyncio.sleep(self.part.period)
            promise(self.now < begun + self.patience, "Sensor.read", "returns readings when the device is back")

    async def is_told(self) -> None:
        """Wait until the sensor tells that its device fails."""
        begun = self.now
        failed = False
        while not failed:
            await asyncio.sleep(self.part.period)
            promise(self.now < begun + self.patience, "Sensor.read", "raises HalError when its device is silent")
            try:
                self.part.read(self.now)
            except (HalError, OSError) as error:
                text, failed = str(error), True
                told = f"says in one line what is wrong, not {text!r}"
                promise(bool(text) and "\n" not in text, "Sensor.read", told)

    async def reads_on(self, does: str = "is silent") -> None:
        """Check that the sensor reads until the outage and again after it, and does not flood a silent device."""
        await self.reading()
        while self.now < OUTAGE_BEGINS + self.part.period:
            await asyncio.sleep(self.part.period)
            self.try_to_read()
        wrote, ends = len(self.outage.written), OUTAGE_BEGINS + self.lasts
        last = None
        while last is None or last.time <= ends:
            await asyncio.sleep(self.part.period)
            last = self.try_to_read()
            told = f"but there was none in {BACK:g} s after the outage"
            promise(self.now < ends + BACK, "Sensor.read", f"returns readings when the device is back, {told}")
        often = (len(self.outage.written) - wrote) / max(self.now - OUTAGE_BEGINS, 1.0)
        told = f"asks a device that {does} now and then, but wrote {often:.0f} times a second"
        promise(often <= ASKS, "Sensor", told)

    def try_to_read(self) -> Reading[Any] | None:
        """Return the present reading; None if there is none, or the sensor says that its device is not well."""
        try:
            return self.part.read(self.now)
        except (HalError, OSError) as error:
            text = str(error)
            promise(bool(text) and "\n" not in text, "Sensor.read", f"says in one line what is wrong, not {text!r}")
        return None

    def read(self) -> Reading[Any] | None:
        """Return the sensor's present reading; None if there is none."""
        with kept("Sensor.read", "reads sound hardware"):
            reading = self.called("read", self.now)
        if reading is not None and not isinstance(reading, Reading):
            broken("Sensor.read", f"returns a Reading or None, not {type(reading).__name__}")
        return reading

    async def reading(self) -> Reading[Any]:
        """Return the next reading."""
        ends = self.now + self.settle
        while self.now < ends:
            await asyncio.sleep(self.part.period)
            if (reading := self.read()) is not None:
                return reading
        return broken("Sensor.read", f"returns a reading when there is one, but there was none in {self.settle:g} s")
