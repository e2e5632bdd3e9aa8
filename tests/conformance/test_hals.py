"""Every hardware layer keeps the promises of `txt1.hal.base`, and the suite notices when one does not."""

from __future__ import annotations

import os
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from io import StringIO
from math import inf, isfinite
from threading import Event, Thread
from typing import Any, Literal, NoReturn
from unittest import SkipTest

import pytest

from tests.patience import S
from txt1.cars.vesc.driver import Unpacker, VescHal
from txt1.cars.vesc.virtual_vesc import Vesc
from txt1.cli import execute
from txt1.commands import FAULT
from txt1.config import Config, load
from txt1.config.schema import RoomConfig, SerialConfig, SimConfig
from txt1.conformance import promises
from txt1.errors import HalError, NotCapable
from txt1.hal.base import Button, Capabilities, Hal, Inputs, Outputs
from txt1.hal.channels import rewired
from txt1.hal.conformance import HalConformance
from txt1.hal.plain_hal import PlainHal
from txt1.hal.registry import create
from txt1.hal.sim import SimHal
from txt1.link.base import Port
from txt1.model.channels import Channel, Channels
from txt1.model.odometry import Odometry, advance
from txt1.model.vehicle import sides
from txt1.protocol.messages import Switch
from txt1.sim.parameters import LineFaults


def sim() -> SimHal:
    """The simulated TXT-1 where no wall stops it."""
    hal = create(Config(sim=SimConfig(room=RoomConfig(length=inf, width=inf))))
    assert isinstance(hal, SimHal)
    return hal


class TestSim(HalConformance):
    """The simulated TXT-1."""

    def make(self) -> Hal:
        return sim()

    def held(self, hal: Hal) -> Outputs:
        assert isinstance(hal, SimHal)
        return hal.outputs


class TestRewired(HalConformance):
    """The simulated TXT-1 wired wrongly throughout, and put right by its channels."""

    def make(self) -> Hal:
        servo = Channel(-1, 1500.0, 0.8)
        wiring = Channels(Channel(-1, 100.0), servo, servo, right_encoder=-1, encoders_swapped=True)
        config = Config(sim=SimConfig(room=ENDLESS, channels=wiring), channels=wiring)
        return rewired(create(config), config.channels, skids=False)


class ToyHal(PlainHal):
    """A stranger's simulated car that closes its own velocity loops: odometry and set-points, no ticks, no PWM."""

    name = "toy"
    capabilities = Capabilities(place=True, pose=True, simulated=True)

    def __init__(self) -> None:
        self.time = 0.0
        self.outputs = Outputs()
        self.odometry = Odometry()
        self.placed = Odometry()

    async def open(self) -> None:
        self.outputs = Outputs()

    async def close(self) -> None:
        self.outputs = Outputs()

    def read(self, now: float) -> Inputs:
        self._advance_to(now)
        return Inputs(odometry=self.odometry, odometry_time=now, pose=self.placed[:3])

    def write(self, outputs: Outputs, now: float) -> None:
        self._advance_to(now)
        self.outputs = outputs

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        if not (isfinite(x) and isfinite(y) and isfinite(theta)):
            raise ValueError(f"cannot stand at ({x}, {y}, {theta})")
        self._advance_to(now)
        self.placed = Odometry(x, y, theta)

    def _advance_to(self, now: float) -> None:
        v, omega = self.outputs.v, self.outputs.omega
        self.odometry = advance(self.odometry, v, omega, now - self.time)
        self.placed = advance(self.placed, v, omega, now - self.time)
        self.time = now


class TestToy(HalConformance):
    """A HAL with the fewest capabilities that drives."""

    def make(self) -> Hal:
        return ToyHal()

    def held(self, hal: Hal) -> Outputs:
        assert isinstance(hal, ToyHal)
        return hal.outputs


class RealHal(ToyHal):
    """A real car, as far as the suite can tell: it is not simulated and its battery takes two seconds to report."""

    name = "real"
    capabilities = Capabilities(battery=True, power=True)

    def __init__(self) -> None:
        super().__init__()
        self.switched_off: list[Switch] = []
        self.fastest = 0.0

    def read(self, now: float) -> Inputs:
        batteries = (12.1, 0.0) if now > 2.0 else None
        return super().read(now)._replace(pose=None, batteries=batteries)

    def _advance_to(self, now: float) -> None:
        if now > self.time:  # an instant of full throttle moves nothing
            self.fastest = max(self.fastest, abs(self.outputs.v))
        super()._advance_to(now)

    def switch(self, switch: Switch, on: bool, now: float) -> None:
        if not on:
            self.switched_off.append(switch)

    def place(self, x: float, y: float, theta: float, now: float) -> None:
        raise NotCapable(self.name, "place")


class TestReal(HalConformance):
    """A HAL that drives something real, and reports late."""

    def make(self) -> Hal:
        return RealHal()


@pytest.mark.parametrize("name", promises(HalConformance))
def test_the_suite_neither_drives_a_real_car_nor_cuts_its_power(name: str) -> None:
    hal = RealHal()

    class Once(HalConformance):
        def make(self) -> Hal:
            return hal

    # a skipped promise is as good as a kept one here
    with suppress(SkipTest):
        getattr(Once(), name)()
    assert (hal.fastest, hal.switched_off) == (0.0, [])


def test_what_is_real_is_given_a_little_at_first_and_neutral_in_the_end() -> None:
    given: list[Outputs] = []

    class Watched(RealHal):
        def write(self, outputs: Outputs, now: float) -> None:
            given.append(outputs)
            super().write(outputs, now)

    class Suite(HalConformance):
        def make(self) -> Hal:
            return Watched()

    Suite().test_writing_accepts_everything_between_the_ends()
    moving = [abs(outputs.motor) for outputs in given if outputs.motor]
    assert moving == sorted(moving)
    assert moving[0] == 480, "2 % of full power"
    assert given[-1] == Outputs()


@pytest.mark.parametrize("answer", ["\n", "n\n", "what?\n", ""])
def test_the_command_asks_before_anything_real_moves(
    answer: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Terminal(StringIO):
        def isatty(self) -> bool:
            return True

    opened: list[str] = []

    class Watched(RealHal):
        async def open(self) -> None:
            opened.append("open")

    monkeypatch.setattr("txt1.cli.hal.create", lambda config: Watched())
    monkeypatch.setattr("sys.stdin", Terminal(answer))
    assert execute(["hal", "check", "sim", "--wheels-up"]) == 2
    told = capsys.readouterr()
    assert ("Does nothing touch them? [y/N]" in told.out, "nothing was moved" in told.err) == (True, True)
    assert not opened


# -- a broken promise is noticed -------------------------------------------------------------------------------


def mutant(**methods: Any) -> Callable[[], Hal]:
    """A maker of simulated TXT-1s with some methods or capabilities replaced."""
    kind = type("Mutant", (SimHal,), methods)
    return lambda: kind(sim().vehicle)


class Secretive(ToyHal):
    """Does not say what moves in its world."""

    @property
    def movers(self) -> NoReturn:  # type: ignore[override]
        raise AttributeError("movers")


def able(**changes: bool) -> Capabilities:
    """The simulated robot's capabilities, but for these."""
    return Capabilities(**{**vars(SimHal.capabilities), **changes})


def reading(**changes: Callable[[Inputs], Any]) -> Callable[..., Inputs]:
    """A `read` with some fields replaced by a function of the true inputs."""

    def read(self: SimHal, now: float) -> Inputs:
        inputs = SimHal.read(self, now)
        return inputs._replace(**{field: change(inputs) for field, change in changes.items()})

    return read


def writing(change: Callable[[Outputs], Outputs]) -> Callable[..., None]:
    """A `write` of changed outputs."""
    return lambda self, outputs, now: SimHal.write(self, change(outputs), now)


async def async_read(self: SimHal, now: float) -> Inputs:
    return SimHal.read(self, now)


def slow_read(self: SimHal, now: float) -> Inputs:
    ends = time.perf_counter() + 0.008
    while time.perf_counter() < ends:
        pass
    return SimHal.read(self, now)


def waiting_read(self: SimHal, now: float) -> Inputs:
    time.sleep(0.008)
    return SimHal.read(self, now)


def jumping_read(self: SimHal, now: float) -> Inputs:
    self.reads = getattr(self, "reads", 0) + 1
    inputs = SimHal.read(self, now)
    assert inputs.ticks is not None
    return inputs._replace(ticks=(inputs.ticks[0] + self.reads, inputs.ticks[1] + self.reads))


async def close_and_forget(self: SimHal) -> None:
    pass


async def close_once(self: SimHal) -> None:
    del self.indicators  # the second time there are none
    await SimHal.close(self)


async def never_again(self: SimHal) -> None:
    if getattr(self, "used", False):
        raise RuntimeError("device busy")
    self.used = True


def refuse(self: SimHal, *arguments: object) -> None:
    raise NotCapable(self.name, "power")


def complain(self: SimHal, *arguments: object) -> None:
    raise ValueError("out of range")


def ignore(self: SimHal, *arguments: object) -> None:
    pass


def place_anywhere(self: SimHal, x: float, y: float, theta: float, now: float) -> None:
    if isfinite(x) and isfinite(y):
        SimHal.place(self, x, y, theta, now)


def place_rolling(self: SimHal, x: float, y: float, theta: float, now: float) -> None:
    v = self.vehicle.state.v
    SimHal.place(self, x, y, theta, now)
    self.vehicle.state = self.vehicle.state._replace(v=v)


def write_latched(self: SimHal, outputs: Outputs, now: float) -> None:
    if outputs != Outputs():
        SimHal.write(self, outputs, now)


class Liar(SimHal):
    """Capabilities that come with opening."""

    opened = False

    async def open(self) -> None:
        self.opened = True

    @property
    def capabilities(self) -> Capabilities:  # type: ignore[override]
        return able(buttons=self.opened)


MUTANTS: list[tuple[str, Callable[[], Hal], str, str]] = [
    # what is broken, the HAL, the test that must notice, what it must say
    ("no name", mutant(name=""), "the_name_is_text", "Hal.name is text"),
    ("a member is missing", Secretive, "it_has_every_member", "Hal.movers is there, also for a HAL that needs none"),
    (
        "attitude unknown",
        mutant(attitude=lambda self: (float("nan"), 0.0)),
        "the_optional_members_are_as_described",
        "Hal.attitude is roll and pitch in rad",
    ),
    (
        "a wall that is no text",
        mutant(blocked_by=lambda self: True),
        "the_optional_members_are_as_described",
        "Hal.blocked_by is text or None",
    ),
    (
        "capability unknown",
        mutant(capabilities=able(ticks=None)),
        "every_field_of_the_capabilities_is_true_or_false",
        "Capabilities.ticks is True or False",
    ),
    (
        "capabilities change",
        lambda: Liar(sim().vehicle),
        "capabilities_and_name_are_constant",
        "opening the HAL changed it",
    ),
    ("closes once", mutant(close=close_once), "closing_twice_is_harmless", "AttributeError"),
    ("opens once", mutant(open=never_again), "a_closed_hal_opens_again", "RuntimeError: device busy"),
    (
        "not neutral after close",
        mutant(close=close_and_forget),
        "closing_leaves_the_outputs_neutral",
        "Hal.close leaves the outputs neutral",
    ),
    ("async read", mutant(read=async_read), "reading_returns_inputs_at_once", "Hal.read returns at once"),
    (
        "read returns a tuple",
        mutant(read=lambda self, now: tuple(SimHal.read(self, now))),
        "reading_returns_inputs_at_once",
        "returns Inputs, not tuple",
    ),
    ("read waits", mutant(read=waiting_read), "reading_and_writing_are_prompt", "Hal.read never waits"),
    ("read computes", mutant(read=slow_read), "reading_and_writing_are_prompt", "Hal.read takes less than"),
    (
        "ticks are floats",
        mutant(read=reading(ticks=lambda i: tuple(map(float, i.ticks)))),
        "every_input_agrees_with_the_capabilities",
        "Inputs.ticks is a pair of ints",
    ),
    (
        "no ticks after all",
        mutant(read=reading(ticks=lambda i: None)),
        "every_input_agrees_with_the_capabilities",
        "Inputs.ticks is a pair of ints by the capabilities, but None",
    ),
    (
        "ticks kept secret",
        mutant(capabilities=able(ticks=False)),
        "every_input_agrees_with_the_capabilities",
        "Inputs.ticks is None without the capability",
    ),
    (
        "battery kept secret",
        mutant(capabilities=able(battery=False)),
        "every_input_agrees_with_the_capabilities",
        "Inputs.batteries is None without the capability",
    ),
    (
        "neither ticks nor odometry",
        mutant(capabilities=able(ticks=False, pwm=False), read=reading(ticks=lambda i: None)),
        "every_input_agrees_with_the_capabilities",
        "Inputs.odometry is reported by a HAL without ticks",
    ),
    (
        "voltage not a number",
        mutant(read=reading(batteries=lambda i: (float("nan"), 0.0))),
        "every_input_agrees_with_the_capabilities",
        "Inputs.batteries is a pair of voltages",
    ),
    (
        "pose not finite",
        mutant(read=reading(pose=lambda i: (0.0, 0.0, float("inf")))),
        "every_input_agrees_with_the_capabilities",
        "Inputs.pose is finite",
    ),
    (
        "odometry from the future",
        mutant(read=reading(odometry=lambda i: Odometry(), odometry_time=lambda i: 1e9)),
        "every_input_agrees_with_the_capabilities",
        "Inputs.odometry_time is when it arrived",
    ),
    (
        "a button without a joystick",
        mutant(read=reading(buttons=lambda i: Button.UP)),
        "every_input_agrees_with_the_capabilities",
        "Inputs.buttons is NONE without",
    ),
    (
        "backlight in percent",
        mutant(read=reading(backlight=lambda i: 50.0)),
        "every_input_agrees_with_the_capabilities",
        "Inputs.backlight is None or from 0 to 1",
    ),
    (
        "ticks with every read",
        mutant(read=jumping_read),
        "reading_twice_at_one_instant_changes_nothing",
        "while time stood still",
    ),
    ("write complains", mutant(write=refuse), "writing_accepts_everything_between_the_ends", "Hal.write takes Outputs"),
    ("write ignored", mutant(write=ignore), "what_was_written_is_held", "Hal.write holds the outputs"),
    (
        "creeps at neutral",
        mutant(write=writing(lambda o: o._replace(motor=o.motor + 900))),
        "neutral_outputs_do_not_move_the_robot",
        "Outputs are neutral when all are 0",
    ),
    ("latches the throttle", mutant(write=write_latched), "neutral_outputs_stop_the_robot", "neutral stops the robot"),
    (
        "motor the wrong way round",
        mutant(write=writing(lambda o: o._replace(motor=-o.motor))),
        "forward_is_positive_and_backward_negative",
        "Inputs.ticks are forward positive, but motor 3000",
    ),
    (
        "motor knows no reverse",
        mutant(write=writing(lambda o: o._replace(motor=abs(o.motor)))),
        "forward_is_positive_and_backward_negative",
        "motor -3000",
    ),
    (
        "one encoder the wrong way round",
        mutant(read=reading(ticks=lambda i: (i.ticks[0], -i.ticks[1]))),
        "forward_is_positive_and_backward_negative",
        "Inputs.ticks are forward positive",
    ),
    (
        "steering the wrong way round",
        mutant(write=writing(lambda o: o._replace(front=o.rear, rear=o.front))),
        "front_to_the_left_and_rear_to_the_right_turn_left",
        "Outputs.front, Outputs.rear turn left",
    ),
    (
        "encoders exchanged",
        mutant(read=reading(ticks=lambda i: i.ticks[::-1])),
        "front_to_the_left_and_rear_to_the_right_turn_left",
        "the right wheel goes further",
    ),
    ("switches missing", mutant(switch=refuse), "the_switches_work_or_are_refused", "works with the capability"),
    (
        "switches hidden",
        mutant(capabilities=able(power=False)),
        "the_switches_work_or_are_refused",
        "raises NotCapable without the capability 'power'",
    ),
    (
        "switches fail",
        mutant(capabilities=able(power=False), switch=complain),
        "the_switches_work_or_are_refused",
        "raises NotCapable without the capability 'power', but raised ValueError",
    ),
    ("ESC does nothing", mutant(switch=ignore), "without_the_esc_nothing_moves", "ESC off lets nothing move"),
    (
        "gains swallowed",
        mutant(load_gains=ignore),
        "gains_are_taken_or_refused",
        "raises NotCapable without the capability 'gains'",
    ),
    (
        "combined odometry swallowed",
        mutant(offer_odometry=ignore),
        "combined_odometry_is_taken_or_refused",
        "raises NotCapable without the capability 'combined'",
    ),
    ("no buzzer", mutant(indicate=refuse), "indicators_are_set_or_ignored", "Hal.indicate does nothing where"),
    (
        "wrong refusal",
        mutant(capabilities=able(place=False), place=refuse),
        "the_robot_is_placed_or_it_is_refused",
        "names HAL and capability",
    ),
    ("placing ignored", mutant(place=ignore), "the_robot_is_placed_or_it_is_refused", "but it stands at"),
    ("placed rolling", mutant(place=place_rolling), "a_robot_put_down_is_at_rest", "puts the robot down at rest"),
    (
        "placed in the clouds",
        mutant(place=place_anywhere),
        "the_robot_is_not_placed_where_it_cannot_stand",
        "raises ValueError",
    ),
]


@pytest.mark.parametrize(("make", "name", "message"), [m[1:] for m in MUTANTS], ids=[m[0] for m in MUTANTS])
def test_a_broken_promise_is_noticed_and_named(make: Callable[[], Hal], name: str, message: str) -> None:
    class Suite(TestSim):
        def make(self) -> Hal:
            return make()

    getattr(TestSim(), f"test_{name}")()  # the healthy HAL passes the very same test
    with pytest.raises(AssertionError) as failure:
        getattr(Suite(), f"test_{name}")()
    assert message in str(failure.value)
    assert "txt1.hal.base" in str(failure.value)  # where the promise stands


class Forgetful(Unpacker):
    """Takes every piece for whole packets."""

    def feed(self, data: bytes) -> list[bytes]:
        self._buffer = b""
        return super().feed(data)


class OneAtATime(Unpacker):
    """Understands no piece with two packets."""

    def feed(self, data: bytes) -> list[bytes]:
        payloads = super().feed(data)
        return payloads if len(payloads) == 1 else []


class Credulous(Unpacker):
    """Believes every check sum."""

    def _at(self, start: int) -> bytes | None:
        buffer, kind = self._buffer, self._buffer[start]
        begin, size = start + kind, int.from_bytes(self._buffer[start + 1 : start + kind])
        if kind not in (2, 3):
            return None
        return buffer[begin : begin + size] if len(buffer) >= begin + size + 3 else b""


class Frightened(VescHal):
    """Believes every check sum, and is frightened by each answer about old firmware."""

    def _greet(self) -> None:
        super()._greet()
        self._unpacker = Credulous()

    def _take_firmware(self, major: int, minor: int) -> None:
        if major < 5:
            self.line.fail(HalError(f"the VESC has firmware {major}.{minor:02d}"))
        super()._take_firmware(major, minor)


class Untroubled(VescHal):
    """Counts no loss of its line."""

    def read(self, now: float) -> Inputs:
        inputs = super().read(now)
        return inputs._replace(link=None if inputs.link is None else inputs.link._replace(losses=0))


ON_BAD_LINES = [
    ("tears", "txt1.cars.vesc.driver.Unpacker", Forgetful, "BoardLink.ready comes true"),
    ("merges", "txt1.cars.vesc.driver.Unpacker", OneAtATime, "BoardLink.ready comes true"),
    ("corrupts", "txt1.cars.vesc.driver.VescHal", Frightened, "has firmware 0"),
    ("is_late", "txt1.hal.line.ANSWER_SILENCE", 0.05, "it leapt by"),
    ("loses_and_doubles", "txt1.hal.line.ANSWER_SILENCE", 0.03, "BoardLink.ready comes true"),
    ("is_cut", "txt1.cars.vesc.driver.VescHal", Untroubled, "counts a line that is cut"),
]


@pytest.mark.parametrize(
    ("line", "what", "broken", "message"),
    [
        pytest.param(*each, id=each[0], marks=[pytest.mark.long] if each[0] in ("tears", "merges") else [])
        for each in ON_BAD_LINES
    ],
)
def test_a_promise_that_a_bad_line_breaks_is_noticed(
    line: str, what: str, broken: Any, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (name,) = (each for each in promises(HalConformance) if f"_line_that_{line}_" in each)
    assert Vesc  # its own unpacker stays sound: it is imported before
    monkeypatch.setattr(what, broken)
    # a line of few faults may spare the bytes that matter; one of so many does not
    with pytest.raises((AssertionError, HalError), match=message):
        for seed in range(1, 9):
            monkeypatch.setattr(TestVesc, "seed", seed)
            getattr(TestVesc(), name)()


NEVER = property(lambda ladder: inf)
IN_OUTAGES = [
    ("device_that_is_silent_for_a_second", "txt1.cars.vesc.driver.VescHal", Untroubled, "counts a device"),
    ("device_that_is_silent_for_a_minute", "txt1.cars.vesc.driver.VescHal", Untroubled, "counts a device"),
    ("device_without_power", "txt1.cars.vesc.driver.VescHal", Untroubled, "counts a device"),
    ("device_that_is_unplugged", "txt1.link.silence.Ladder.due", NEVER, "BoardLink.ready comes true"),
    ("connection_that_is_half_open", "txt1.link.silence.Ladder.due", NEVER, "BoardLink.ready comes true"),
]


@pytest.mark.parametrize(("device", "what", "broken", "message"), IN_OUTAGES, ids=[each[0] for each in IN_OUTAGES])
def test_a_promise_that_is_broken_in_an_outage_is_noticed(
    device: str, what: str, broken: Any, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (name,) = (each for each in promises(HalConformance) if f"test_a_{device}" in each)
    monkeypatch.setattr(what, broken)
    with pytest.raises(AssertionError, match=message):
        getattr(TestVesc(), name)()


def test_every_promise_that_a_simulated_hal_can_break_has_a_mutant() -> None:
    covered = {f"test_{name}" for _, _, name, _ in MUTANTS}
    covered |= {each for each in promises(HalConformance) if any(f"test_a_{of[0]}" in each for of in IN_OUTAGES)}
    covered |= {name for name in promises(HalConformance) if "_line_that_" in name}
    assert len(ON_BAD_LINES) == len([name for name in covered if "_line_that_" in name])
    # opening: SimHal starts neutral, so breaking it takes another HAL; survival: any exception at all fails it
    assert set(promises(HalConformance)) - covered == {
        "test_opening_leaves_the_outputs_neutral",
        "test_it_survives_many_reads_and_gaps",
        # a rover's, below
        "test_sides_that_run_at_two_speeds_come_of_the_outputs_as_written",
    }


@pytest.mark.parametrize("factor", [3.0, 0.5, -1.0])
def test_another_formula_for_the_sides_is_noticed(factor: float, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "test_sides_that_run_at_two_speeds_come_of_the_outputs_as_written"
    getattr(TestPiOnARover(), name)()
    monkeypatch.setattr("txt1.cars.pi.driver.sides", lambda motor, rear: sides(motor, factor * rear))
    with pytest.raises(AssertionError, match=r"as txt1\.model\.vehicle\.sides says"):
        getattr(TestPiOnARover(), name)()


def test_a_wrong_set_point_sign_is_noticed() -> None:
    class Backwards(ToyHal):
        def write(self, outputs: Outputs, now: float) -> None:
            super().write(outputs._replace(v=-outputs.v, omega=-outputs.omega), now)

    class Suite(HalConformance):
        def make(self) -> Hal:
            return Backwards()

    with pytest.raises(AssertionError, match=r"Inputs.odometry is forward positive, but v 0.5 m/s"):
        Suite().test_forward_is_positive_and_backward_negative()
    with pytest.raises(AssertionError, match=r"Outputs.omega is left positive"):
        Suite().test_front_to_the_left_and_rear_to_the_right_turn_left()


def test_a_subclass_without_make_is_told_what_to_override() -> None:
    with pytest.raises(NotImplementedError, match=r"override HalConformance\.make"):
        HalConformance().test_the_name_is_text()


# -- the command -----------------------------------------------------------------------------------------------


def test_the_command_checks_a_registered_hal(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["hal", "check", "sim", "--set", "seed=3"]) == 0
    *lines, verdict = capsys.readouterr().out.splitlines()
    assert len(lines) == len(promises(HalConformance))
    skipped = sum(": skipped: " in line for line in lines)
    assert "closing twice is harmless: ok" in lines
    assert verdict == f"PASSED: {len(lines) - skipped} checks; {skipped} skipped, for the reasons above"


def test_the_command_fails_for_a_broken_hal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("txt1.cli.hal.create", lambda config: mutant(indicate=refuse)())
    assert execute(["hal", "check", "sim"]) == 1
    *lines, verdict = capsys.readouterr().out.splitlines()
    broken = [line for line in lines if "BROKEN" in line]
    assert len(broken) == 1 and verdict.startswith("FAILED: 1 of ")
    assert broken[0].startswith("indicators are set or ignored: BROKEN: Hal.indicate does nothing")


def test_the_command_lists_what_is_installed(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["hal", "list"]) == 0
    assert "sim" in capsys.readouterr().out.splitlines()


ENDLESS = RoomConfig(length=inf, width=inf)
CLEAN = LineFaults()
NOISY = LineFaults(drop=0.1, flip=1e-4, split=True, delay=0.02, jitter=0.02)


def on_a_line(name: str, vehicle: str, fault: LineFaults = CLEAN) -> Config:
    """One of our HALs with its device on the desk, in the same process and time, where no wall stops it."""
    settings = [f"vehicle={vehicle}", f"serial.port={name}", "sim.room.length=.inf", "sim.room.width=.inf"]
    config = load(None, settings, {}, {"hal": name}).config
    return config.model_copy(update={"serial": config.serial.model_copy(update={"fault": fault})})


def board(fault: LineFaults = CLEAN, control: Literal["board", "host"] = "board") -> Hal:
    serial = SerialConfig(port="virtual", control=control, fault=fault)
    return create(Config(hal="serial", serial=serial, sim=SimConfig(room=ENDLESS)))


def wrapped(hal: Any, wrap: Callable[[Port], Port]) -> Hal:
    """The HAL with its port wrapped."""
    hal.line.watched.port = wrap(hal.line.watched.port)
    assert isinstance(hal, PlainHal)
    return hal


class TestSerial(HalConformance):
    """A board behind a line, the line in memory: what it reports and obeys is what the wire carries."""

    def make(self) -> Hal:
        return board()

    def behind(self, wrap: Callable[[Port], Port]) -> Hal:
        return wrapped(board(), wrap)

    def over(self, faults: LineFaults) -> Hal:
        return board(faults)


class TestSerialWithLoopsOnTheHost(HalConformance):
    """The same board in manual mode, obeying PWM test."""

    def make(self) -> Hal:
        return board(control="host")


def test_a_device_of_another_kind_at_the_port_is_told_once_in_a_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("txt1.cli.hal.ANSWERS_WITHIN", 4.0 * S)
    master, slave = os.openpty()
    tty.setraw(slave)
    over = Event()

    def speak() -> None:
        while not over.wait(0.05):
            os.write(master, b'{"T":1001,"L":0.25,"R":-0.5,"gz":-89,"odl":56,"odr":-20,"v":1216}\n')

    speaker = Thread(target=speak)
    speaker.start()
    try:
        code = execute(["hal", "check", "serial", "--port", os.ttyname(slave), "--wheels-up"])
    finally:
        over.set()
        speaker.join()
        os.close(slave)
        os.close(master)
    told = capsys.readouterr()
    assert code == FAULT
    assert "BROKEN" not in told.out
    assert "no board of the HAL 'serial' answers" in told.err
    assert "a Waveshare rover's board speaks there: take --hal waveshare" in told.err
    assert told.err.count("\n") == 1


@pytest.mark.long
class TestSerialOverANoisyLine(HalConformance):
    """Every other promise, too, is kept over a line that does everything at once."""

    def make(self) -> Hal:
        return board(NOISY)


class TestVesc(HalConformance):
    """A VESC with a car behind a line in memory; it says itself when nothing moves it."""

    seed = 0

    def make(self) -> Hal:
        return create(on_a_line("vesc", "f1tenth"))

    def behind(self, wrap: Callable[[Port], Port]) -> Hal:
        return wrapped(self.make(), wrap)

    def over(self, faults: LineFaults) -> Hal:
        return create(on_a_line("vesc", "f1tenth", faults).model_copy(update={"seed": self.seed}))


@pytest.mark.long
class TestVescOverANoisyLine(HalConformance):
    """Every other promise, too, is kept over a line that does everything at once."""

    def make(self) -> Hal:
        return create(on_a_line("vesc", "f1tenth", NOISY))


class TestWaveshare(HalConformance):
    """A rover's board that closes its own loops."""

    def make(self) -> Hal:
        return create(on_a_line("waveshare", "rover"))

    def behind(self, wrap: Callable[[Port], Port]) -> Hal:
        return wrapped(self.make(), wrap)

    def over(self, faults: LineFaults) -> Hal:
        return create(on_a_line("waveshare", "rover", faults))


@pytest.mark.long
class TestWaveshareOverANoisyLine(HalConformance):
    """Every other promise, too, is kept over a line that does everything at once."""

    def make(self) -> Hal:
        return create(on_a_line("waveshare", "rover", NOISY))


class TestWaveshareWithoutEncoders(HalConformance):
    """A rover's board that takes PWM and knows no motion."""

    def make(self) -> Hal:
        return create(on_a_line("waveshare", "rover").model_copy(update={"hal_options": {"encoders": False}}))


def on_a_pi(vehicle: str, fault: LineFaults = CLEAN, **options: Any) -> Config:
    """A Raspberry Pi's servo board on the desk, in the same process and time."""
    settings = [f"vehicle={vehicle}", "sim.room.length=.inf", "sim.room.width=.inf"]
    config = load(None, settings, {}, {"hal": "pi"}).config
    serial = config.serial.model_copy(update={"fault": fault})
    reversing = {"reverse": "direct", "virtual_esc": "direct"}
    return config.model_copy(update={"hal_options": {"bus": "virtual"} | reversing | options, "serial": serial})


class TestPi(HalConformance):
    """A car without encoders: nothing tells it whether it moves."""

    def make(self) -> Hal:
        return create(on_a_pi("donkeycar", battery="ina219"))


class TestPiWithOneEncoder(HalConformance):
    """A car that steers, with an encoder on its drive."""

    def make(self) -> Hal:
        return create(on_a_pi("f1tenth", encoders=[[17, 27]], battery="ads1115"))

    def over(self, faults: LineFaults) -> Hal:
        return create(on_a_pi("f1tenth", faults, encoders=[[17, 27]], battery="ads1115"))


class TestPiOnARover(HalConformance):
    """Sides at two speeds, with an encoder each."""

    skids = True

    def make(self) -> Hal:
        return create(on_a_pi("rover", motor=[0, 1], encoders=[[17, 27], [22, 23]]))


@pytest.mark.parametrize("vehicle", ["f1tenth", "rover"])
def test_an_unknown_esc_is_told_and_not_taken_for_broken_encoders(vehicle: str) -> None:
    class Unknown(TestPiOnARover if vehicle == "rover" else TestPiWithOneEncoder):  # type: ignore[misc]
        def make(self) -> Hal:
            pins: dict[str, Any] = {"encoders": [[17, 27]]}
            if vehicle == "rover":
                pins = {"motor": [0, 1], "encoders": [[17, 27], [22, 23]]}
            return create(on_a_pi(vehicle, reverse=None, **pins))

    with pytest.raises(SkipTest, match=r"as hal_options\.reverse is not set: the step 'reverse' of txt1 calibrate"):
        Unknown().test_forward_is_positive_and_backward_negative()
    if vehicle == "f1tenth":
        Unknown().test_front_to_the_left_and_rear_to_the_right_turn_left()
