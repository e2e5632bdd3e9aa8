"""The firmware's core does in whole numbers what the computer's loops, odometry and decoder do."""

from __future__ import annotations

import random
import runpy
from collections.abc import Callable
from itertools import groupby
from math import hypot
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from txt1pico import facts, frame, odometry
from txt1pico.core import NOT_YET, Core
from txt1pico.fixed import KD_MAX, KI_MAX, KP_MAX
from txt1pico.fixed import Pid as FixedPid

from tests.examples import examples
from txt1.config import Config
from txt1.control.pid import CLEAR, pid
from txt1.model.odometry import Odometry, advance, body_velocity
from txt1.model.vehicle import Geometry
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role, encode
from txt1.protocol.messages import (
    CombinedOdometry,
    Message,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)
from txt1.tasks import panel
from txt1.tasks.fields import BatteryState

ROOT = Path(__file__).parents[3]
GAINS = Config().control.pid_set()
DT = 0.02


class Small(int):
    """An integer that fails when a result needs more than MicroPython's 30 bits and a sign."""


def _checked(name: str) -> Callable[[int, int], int]:
    plain = getattr(int, name)

    def operate(self: int, *others: int) -> int:
        result = plain(self, *others)
        assert result is NotImplemented or -(1 << 30) <= result < 1 << 30, f"{name}({self}, {others}) = {result}"
        return result if result is NotImplemented else Small(result)

    return operate


for _name in ("add", "sub", "mul", "floordiv", "mod", "lshift", "rshift", "and", "or", "xor"):
    setattr(Small, f"__{_name}__", _checked(f"__{_name}__"))
    setattr(Small, f"__r{_name}__", _checked(f"__r{_name}__"))
for _name in ("neg", "abs"):
    setattr(Small, f"__{_name}__", _checked(f"__{_name}__"))


def test_the_shared_numbers_are_those_of_txt1() -> None:
    made = runpy.run_path(str(ROOT / "firmware" / "make_facts.py"))
    assert made["FILE"].read_text() == made["text"](), "run: python firmware/make_facts.py"


@pytest.mark.parametrize(("scale", "limit"), [(128, 24000), (16, 18000)])
@given(
    gains=st.tuples(st.integers(-KP_MAX, KP_MAX), st.integers(-KI_MAX, KI_MAX), st.integers(-KD_MAX, KD_MAX)),
    errors=st.lists(st.integers(-4500, 4500), min_size=1, max_size=80),
    parts=st.integers(0, 127),
)
def test_the_loops_output_what_the_float_ones_do_within_a_count(
    scale: int, limit: int, gains: tuple[int, int, int], errors: list[int], parts: int
) -> None:
    fixed, floating = FixedPid(Small(scale), Small(limit)), CLEAR
    for error in errors:
        e = Small(error * scale + parts % scale)
        fixed.step(e, *map(Small, gains))
        kp, ki, kd = (gain / 1000.0 for gain in gains)
        floating = pid(floating, e / scale, (kp, ki, kd), DT, limit)
        u = floating[0]
        assert abs(fixed.output - int(u)) <= 1
        assert abs(fixed.counts + fixed.rest / fixed.whole - u) < 1e-6


@pytest.mark.long
def test_an_hour_of_odometry_ends_within_a_centimetre_of_the_floats() -> None:
    rng = random.Random(1)
    ours, geometry, theirs = odometry.Odometry(), Geometry(), Odometry()
    right = left = 0
    for k in range(180_000):
        if k % 50 == 0:
            right = rng.randint(-60, 90)
            left = max(-60, min(90, right + rng.randint(-14, 14)))
        ours.advance(Small(right), Small(left), 1)
        v, omega = body_velocity(right, left, DT, geometry.count_length, geometry.track_width)
        theirs = advance(theirs, v, omega, DT)
        assert ours.v / 128 == pytest.approx(1000 * v, abs=1e-6)
        assert ours.omega / 16 == pytest.approx(1000 * omega, abs=1e-6)
    assert hypot(ours.x - 1000 * theirs.x, ours.y - 1000 * theirs.y) < 10.0
    assert ours.theta == pytest.approx(1000 * theirs.theta, abs=1.0)


MESSAGES: list[Message] = [
    Velocity(0.5, 0.75),
    Velocity(-1.5, 0.0),
    CombinedOdometry(1.0, -2.0, 0.5, 0.3, -0.2),
    PwmTest(1, -2, 3, 4, -5),
    PowerControl(Switch.ESC, True),
    PwmCommand(100, -24000),
    GAINS,
    PidSet((1.0, 2.0, 3.0), ()),
]


def found(data: bytes) -> list[bytes]:
    """The frames that the firmware's receiver finds in a stream."""
    receiver, frames = frame.Receiver(), []
    for byte in data:
        receiver.put(byte)
        while (at := receiver.next()) >= 0:
            frames.append(bytes(receiver.buffer[at : at + receiver.buffer[at + 2] + 6]))
    while receiver.pending():
        receiver.expire()
        while (at := receiver.next()) >= 0:
            frames.append(bytes(receiver.buffer[at : at + receiver.buffer[at + 2] + 6]))
    return frames


@given(
    st.lists(
        st.one_of(
            st.sampled_from(MESSAGES).map(encode),
            st.binary(max_size=8),
            st.sampled_from([b"\xfa", b"\xfa\xfb", b"\xfa\xfb\x04\x67", b"\xfa\xfb\xff\x70", b"\xfa\xfb\xf0\x70"]),
            st.sampled_from(MESSAGES).map(lambda message: encode(message)[:-1]),
            st.sampled_from(MESSAGES).map(lambda message: encode(message)[:-1] + b"\x00"),
        ),
        max_size=12,
    )
)
@settings(max_examples=examples(300))
def test_the_receiver_finds_the_frames_that_the_computers_decoder_finds(pieces: list[bytes]) -> None:
    stream = b"".join(pieces)
    decoder = Decoder(Role.BOARD)
    events = [*decoder.feed(stream), *decoder.expire()]
    messages = [encode(event) for event in events if type(event) in {type(message) for message in MESSAGES}]  # type: ignore[arg-type]
    ours = [
        each
        for each in found(stream)
        if each[3] != facts.IDENTITY and not (each[3] == facts.POWER_CONTROL and (each[4] > 1 or each[5] > 1))
    ]
    assert ours == messages


class Bench:
    """A core, and what it says."""

    def __init__(self) -> None:
        self.core, self.decoder, self.heard = Core(), Decoder(Role.HOST), []  # type: ignore[var-annotated]
        self.voltage, self.sounds = 12000, list[bool]()

    def run(self, seconds: float, message: Message | None = None, wheels: tuple[int, int] = (0, 0)) -> None:
        """Send a message 20 times a second for so long."""
        for k in range(round(seconds / DT)):
            if message is not None and k % 5 in (0, 2):
                self.send(message)
            self.core.step(*wheels, self.voltage, 0, 0, 1)
            self.sounds.append(self.core.buzzer)
            transmitter = self.core.transmitter
            self.heard += self.decoder.feed(bytes(transmitter.buffer[: transmitter.length]))
            transmitter.length = 0

    def send(self, message: Message) -> None:
        """Send a message once."""
        data = encode(message)
        self.core.receive(data, len(data))


@pytest.fixture
def bench() -> Bench:
    """A core that has its gains and hears its host."""
    bench = Bench()
    bench.send(GAINS)
    bench.run(3.0, Velocity(0.0, 0.0))
    assert bench.core.armed
    return bench


def test_the_atx_supply_stays_on_until_its_encoders_have_stood_still_for_a_while(bench: Bench) -> None:
    bench.run(1.0, Velocity(0.5, 0.0), wheels=(30, 30))
    bench.core.disarm(NOT_YET)
    for wheels, seconds in (((30, 30), 0.5), ((1, -1), 0.5), ((0, 0), 0.28)):
        bench.run(seconds, wheels=wheels)
        bench.send(PowerControl(Switch.ATX, False))
        assert bench.core.switches == 3
    bench.run(0.04)
    bench.send(PowerControl(Switch.ATX, False))
    assert bench.core.switches == 2
    bench.run(1.0)
    bench.send(PowerControl(Switch.ATX, True))
    bench.run(0.1)
    bench.send(PowerControl(Switch.ATX, False))
    assert bench.core.switches == 3, "they have had their power for 0.1 s only"


@pytest.mark.parametrize(
    ("voltage", "state", "period"), [(9200, BatteryState.WARNING, 2.0), (8900, BatteryState.BAD, 1.0)]
)
def test_its_buzzer_sounds_as_the_computer_s_does(
    bench: Bench, voltage: int, state: BatteryState, period: float
) -> None:
    assert not any(bench.sounds[-50:]), "a host and a good battery"
    bench.voltage = voltage
    bench.run(20.0, Velocity(0.0, 0.0))
    heard = [len(list(group)) * DT for _, group in groupby(bench.sounds[-600:])]
    assert heard[1:-1] == pytest.approx([period] * (len(heard) - 2)) and len(heard) > 4
    ours = [panel.buzzer(True, state, DT * k) for k in range(600)]
    assert [len(list(group)) * DT for _, group in groupby(ours)][1] == pytest.approx(period)
    bench.run(4.0)
    assert all(bench.sounds[-100:]), "nobody drives"


def test_nothing_moves_before_gains_and_velocity_have_come() -> None:
    without_gains, without_host = Bench(), Bench()
    without_gains.run(5.0, Velocity(0.5, 0.0))
    without_host.send(GAINS)
    without_host.run(5.0)
    assert list(without_gains.core.outputs) == list(without_host.core.outputs) == [0, 0, 0, 0, 0]


def test_a_silent_host_stops_the_motor_within_a_quarter_second_and_a_cycle(bench: Bench) -> None:
    bench.run(0.2, Velocity(0.5, 0.0), wheels=(1, 1))
    assert bench.core.outputs[0] > 0
    bench.run(0.27)
    assert list(bench.core.outputs)[:3] == [0, 0, 0]
    assert bench.core.armed, "stale is not disarmed"
    bench.run(2.1)
    assert not bench.core.armed, "the link rule"


def test_a_silent_encoder_under_power_disarms_until_the_host_lets_go(bench: Bench) -> None:
    bench.run(1.5, Velocity(0.8, 0.0), wheels=(0, 20))
    assert not bench.core.armed
    bench.run(3.0, Velocity(0.8, 0.0))
    assert not bench.core.armed, "the host still wants to move"
    bench.run(1.5, Velocity(0.0, 0.0))
    assert bench.core.armed


@given(st.binary(max_size=400))
def test_no_bytes_break_the_core_or_move_it_beyond_its_limits(data: bytes) -> None:
    bench = Bench()
    bench.send(GAINS)
    bench.run(2.5, Velocity(0.3, 0.0), wheels=(20, 20))
    bench.core.receive(data, len(data))
    bench.run(0.3)
    motor, front, rear, *servos = bench.core.outputs
    assert abs(motor) <= facts.MOTOR_MAX and max(abs(front), abs(rear)) <= facts.STEERING_MAX
    assert max(map(abs, servos)) <= facts.PWM_MAX


def test_a_bad_pid_set_is_rejected_and_the_gains_stay(bench: Bench) -> None:
    before = list(bench.core.linear_gains)
    for bad in (PidSet((300.0, 0.0, 0.0), ()), PidSet((1.0, 1.0, 0.0), ((0.5, 1, 1, 0), (0.5, 1, 1, 0)))):
        bench.heard.clear()
        bench.send(bad)
        bench.run(0.1)
        assert [event.accepted for event in bench.heard if hasattr(event, "accepted")] == [False]
    assert list(bench.core.linear_gains) == before


def test_the_board_tells_its_name_when_it_is_asked() -> None:
    core = Core(identity=b"txt1pico 0.2 pico")
    asked = bytes((0xFA, 0xFB, 0, facts.IDENTITY, 0, facts.IDENTITY))
    core.receive(asked, len(asked))
    said = bytes(core.transmitter.buffer[: core.transmitter.length])
    assert said[4:-2] == b"txt1pico 0.2 pico"
