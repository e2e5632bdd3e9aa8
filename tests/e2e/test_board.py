"""A board, as an original host program meets it: bytes on a line.

What every board has to do is tested with the virtual board and, where MicroPython is installed, with
the Pico's firmware.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import ENDLESS, may_block
from tests.examples import some
from txt1.board.board import Board
from txt1.cars.pico.virtual_pico import Pico, interpreter
from txt1.config import load
from txt1.config.schema import ControlConfig
from txt1.errors import MissingExtra
from txt1.hal.base import Button
from txt1.hal.sim import SimHal
from txt1.link.base import Link, connect
from txt1.link.impairments import paced
from txt1.protocol.decoder import Decoder
from txt1.protocol.layout import Role, checksum, encode
from txt1.protocol.messages import (
    BatteryLevels,
    EncoderOdometry,
    HostMessage,
    Message,
    PidResponse,
    PowerControl,
    PwmTest,
    Switch,
    Velocity,
)

GAINS = ControlConfig().pid_set()
TICK = 0.02
BYTE = 10.0 / 57600


class Host:
    """A host program: sends frames, and notes what comes."""

    def __init__(self) -> None:
        self.time = asyncio.get_running_loop().time
        self.decoder = Decoder(Role.HOST)
        self.link: Link | None = None
        self.raw: list[tuple[float, bytes]] = []
        self.heard: list[tuple[float, Message]] = []
        self._velocity: asyncio.Task[None] | None = None

    def connected(self, link: Link) -> None:
        self.link = link

    def received(self, data: bytes) -> None:
        self.raw.append((self.time(), data))
        self.heard += [(self.time(), event) for event in self.decoder.feed(data)]  # type: ignore[misc]

    def lost(self, reason: str) -> None:
        self.link = None

    def send(self, message: HostMessage) -> None:
        assert self.link is not None
        self.link.write(encode(message))

    def answers(self) -> list[tuple[float, bool]]:
        return [(time, message.accepted) for time, message in self.heard if isinstance(message, PidResponse)]

    async def drive(self, message: HostMessage, duration: float, rate: float = 10.0) -> None:
        """Send a message again and again, 10 times a second as the original driver does."""
        for _ in range(round(duration * rate)):
            self.send(message)
            await asyncio.sleep(1.0 / rate)


class Desk:
    """A board on the desk, looked at from outside.

    Attributes:
        end: the board.
        arrived: loop time at which bytes came last.
        neutral: loop time at which motor and steering became neutral last.

    """

    def __init__(self, kind: str, *settings: str, manual: bool = False) -> None:
        config = load(None, [*ENDLESS, *settings]).config
        self.end: Board | Pico = Board(config, manual=manual) if kind == "virtual" else Pico(config)
        self.manual = manual
        self.arrived = self.neutral = 0.0
        self._watch: asyncio.Task[None] | None = None

    async def power_up(self) -> None:
        await self.end.power_up()
        self._watch = asyncio.create_task(self._look())
        if self.manual and isinstance(self.end, Pico):
            await self.press_centre()

    async def power_down(self) -> None:
        assert self._watch is not None
        self._watch.cancel()
        await self.end.power_down()

    async def _look(self) -> None:
        loop, moving = asyncio.get_running_loop(), False
        while True:
            await asyncio.sleep(0.005)
            before, moving = moving, self.outputs != (0, 0, 0)
            if before and not moving:
                self.neutral = loop.time()

    def connected(self, link: Link) -> None:
        self.end.connected(link)

    def received(self, data: bytes) -> None:
        self.arrived = asyncio.get_running_loop().time()
        self.end.received(data)

    def lost(self, reason: str) -> None:
        self.end.lost(reason)

    async def press_centre(self) -> None:
        if isinstance(self.end, Board):
            self.end.press(Button.CENTRE)
        else:
            self.end.buttons = Button.CENTRE
        await asyncio.sleep(0.15)
        if isinstance(self.end, Pico):
            self.end.buttons = Button.NONE

    @property
    def layer(self) -> SimHal:
        layer = self.end.runtime.hal if isinstance(self.end, Board) else self.end.hal
        assert isinstance(layer, SimHal)
        return layer

    @property
    def speed(self) -> float:
        """True, m/s."""
        return self.layer.vehicle.state.v

    @property
    def outputs(self) -> tuple[int, int, int]:
        """Motor, front and rear, PWM counts."""
        held = self.layer.outputs
        return held.motor, held.front, held.rear

    @property
    def armed(self) -> bool:
        return self.end.runtime.gate.armed if isinstance(self.end, Board) else self.end.state.armed

    @property
    def in_manual_mode(self) -> bool:
        return self.end.runtime.state.panel.manual if isinstance(self.end, Board) else self.end.state.manual

    @property
    def atx(self) -> bool:
        return self.end.runtime.state.power.atx if isinstance(self.end, Board) else self.end.state.atx


@pytest.fixture(params=["virtual", "pico"])
def kind(request: pytest.FixtureRequest, blocking_calls_fail: BlockBuster) -> str:
    """Which board; the Pico's firmware runs in lock step, so its device waits a tenth of a millisecond for it."""
    if request.param == "pico":
        try:
            interpreter()
        except MissingExtra:
            pytest.skip("MicroPython's unix port is not installed")
        may_block(blocking_calls_fail, "txt1/cars/pico/virtual_pico.py", "_exchange", "_read")
    return str(request.param)


@asynccontextmanager
async def desk_and_host(kind: str, *settings: str, manual: bool = False) -> AsyncIterator[tuple[Desk, Host]]:
    desk, host = Desk(kind, *settings, manual=manual), Host()
    await desk.power_up()
    connect(host, paced(desk, 57600))
    await asyncio.sleep(0.0)
    try:
        yield desk, host
    finally:
        await desk.power_down()


@pytest.fixture
async def pair(kind: str) -> AsyncIterator[tuple[Desk, Host]]:
    """A board whose host drives: link alive, gains loaded."""
    async with desk_and_host(kind) as (desk, host):
        host.send(GAINS)
        await host.drive(Velocity(0.0, 0.0), 2.5)
        yield desk, host


# -- power-up --------------------------------------------------------------------------------------------------


async def test_at_power_up_nothing_moves_before_a_pid_set_and_velocity_have_come(kind: str) -> None:
    async with desk_and_host(kind) as (desk, host):
        await host.drive(Velocity(0.5, 0.3), 3.0)
        assert desk.outputs == (0, 0, 0), "without gains"
    async with desk_and_host(kind) as (desk, host):
        host.send(GAINS)
        await asyncio.sleep(3.0)
        assert desk.outputs == (0, 0, 0), "without Velocity"
    async with desk_and_host(kind) as (desk, host):
        host.send(GAINS)
        await host.drive(Velocity(0.5, 0.0), 5.0)
        assert desk.speed == pytest.approx(0.5, abs=0.05)


async def test_with_a_host_odometry_comes_20_times_a_second_and_battery_levels_once(kind: str) -> None:
    async with desk_and_host(kind) as (_, host):
        await asyncio.sleep(3.0)
        assert not any(isinstance(message, EncoderOdometry) for _, message in host.heard)
        await host.drive(Velocity(0.0, 0.0), 3.0)
        host.heard.clear()
        await host.drive(Velocity(0.0, 0.0), 10.0)
        assert sum(isinstance(message, EncoderOdometry) for _, message in host.heard) in (199, 200, 201)
        assert sum(isinstance(message, BatteryLevels) for _, message in host.heard) in (9, 10, 11)


# -- the line --------------------------------------------------------------------------------------------------


async def test_a_pid_set_is_answered_after_the_time_its_bytes_take(pair: tuple[Desk, Host]) -> None:
    _, host = pair
    host.heard.clear()
    asked = host.time()
    host.send(GAINS)
    await asyncio.sleep(0.2)
    ((answered, accepted),) = host.answers()
    assert accepted
    # 242 bytes there and 7 back; what is already under way to the host goes first
    assert (242 + 7) * BYTE <= answered - asked <= (242 + 7 + 27 + 11) * BYTE + 1e-6


@pytest.mark.parametrize("length", some(11, rest=(0, 4, 13, 27, 237, 249)))
async def test_a_malformed_pid_set_is_rejected_and_changes_nothing(pair: tuple[Desk, Host], length: int) -> None:
    desk, host = pair
    host.heard.clear()
    body = bytes((0x70, *bytes(length)))
    assert host.link is not None
    host.link.write(b"\xfa\xfb" + bytes((length,)) + body + checksum(body).to_bytes(2, "big"))
    await asyncio.sleep(0.5)
    assert [accepted for _, accepted in host.answers()] == [False]
    await host.drive(Velocity(0.5, 0.0), 3.0)
    assert desk.speed == pytest.approx(0.5, abs=0.05)


async def test_an_answer_that_the_line_echoes_is_not_answered(pair: tuple[Desk, Host]) -> None:
    _, host = pair
    host.heard.clear()
    assert host.link is not None
    host.link.write(encode(PidResponse(True)))
    await asyncio.sleep(0.5)
    assert host.answers() == []


async def test_a_zero_byte_stands_between_frames_back_to_back_and_nowhere_else(pair: tuple[Desk, Host]) -> None:
    """Original hosts lose the byte behind a frame, when it is there already."""
    _, host = pair
    host.raw.clear()
    await host.drive(Velocity(0.0, 0.0), 8.0)
    stream = b"".join(data for _, data in host.raw)
    odometry, battery = 26, 10
    spaced = stream.count(b"\x00\xfa\xfb\x04\x6a")
    assert spaced > 5, "battery levels follow odometry in the same tick"
    assert b"\xfa\xfb\x14\x68" in stream
    frames = stream.count(b"\xfa\xfb\x14\x68"), stream.count(b"\xfa\xfb\x04\x6a")
    spacers = len(stream) - frames[0] * odometry - frames[1] * battery
    assert spaced <= spacers <= 2 * spaced


async def test_bytes_come_at_the_baud_rate(pair: tuple[Desk, Host]) -> None:
    _, host = pair
    host.raw.clear()
    await host.drive(Velocity(0.0, 0.0), 3.0)
    until = 0.0
    for time, data in host.raw:
        assert time >= until + len(data) * BYTE - 1e-6
        until = time


async def test_garbage_between_frames_costs_nothing(pair: tuple[Desk, Host]) -> None:
    desk, host = pair
    assert host.link is not None
    for _ in range(100):
        host.link.write(b"\x00\xfa\x55\xfa\xfb\xff")
        host.send(Velocity(0.5, 0.0))
        await asyncio.sleep(0.05)
    assert desk.speed == pytest.approx(0.5, abs=0.05)


# -- a host that goes away -------------------------------------------------------------------------------------


async def time_to_neutral(desk: Desk) -> float:
    """Seconds from the arrival of the last command until motor and steering are neutral."""
    await asyncio.sleep(0.0)
    last = desk.arrived
    await asyncio.sleep(3.0)
    return desk.neutral - last


async def test_a_host_that_falls_silent_at_1_metre_a_second_stops_the_vehicle(pair: tuple[Desk, Host]) -> None:
    desk, host = pair
    await host.drive(Velocity(1.0, 0.0), 3.05, rate=20.0)
    assert desk.speed == pytest.approx(1.0, abs=0.1)
    assert await time_to_neutral(desk) <= 0.25 + 2 * TICK, "a cycle to see the command, one to see it is stale"
    assert not desk.armed, "and the link is lost a second later"


@pytest.mark.parametrize("phase", some(0.0, 0.6, rest=(0.3, 0.9)))
async def test_without_a_time_out_the_link_rule_of_the_thesis_stops_it(phase: float) -> None:
    async with desk_and_host("virtual", "board.link_timeout=null") as (desk, host):
        host.send(GAINS)
        await host.drive(Velocity(1.0, 0.0), 4.0 + phase)
        assert desk.speed == pytest.approx(1.0, abs=0.1)
        took = await time_to_neutral(desk)
        assert 0.9 < took <= 2.0


async def test_in_manual_mode_pwm_test_is_obeyed_and_goes_neutral_with_the_link(kind: str) -> None:
    async with desk_and_host(kind, manual=True) as (desk, host):
        for _ in range(60):
            host.send(Velocity(0.0, 0.0))
            await host.drive(PwmTest(2000, -5000, 5000, 0, 0), 0.05, rate=20.0)
        assert desk.outputs == (2000, -5000, 5000)
        assert await time_to_neutral(desk) <= 0.25 + 2 * TICK


async def test_pwm_test_moves_nothing_in_controller_mode(pair: tuple[Desk, Host]) -> None:
    desk, host = pair
    for _ in range(40):
        host.send(Velocity(0.0, 0.0))
        await host.drive(PwmTest(3000, 0, 0, 0, 0), 0.05, rate=20.0)
        assert desk.outputs[0] == 0


async def test_the_joystick_changes_the_mode(pair: tuple[Desk, Host]) -> None:
    desk, host = pair
    await desk.press_centre()
    await host.drive(Velocity(0.5, 0.0), 2.0)
    assert desk.in_manual_mode
    assert desk.speed == 0.0


# -- stops of its own, and the way back ------------------------------------------------------------------------


async def test_after_a_wall_the_board_obeys_again_when_the_host_has_let_go_for_a_second(kind: str) -> None:
    async with desk_and_host(kind, "sim.room.length=3.0") as (desk, host):
        host.send(GAINS)
        await host.drive(Velocity(0.0, 0.0), 2.5)
        await host.drive(Velocity(0.5, 0.0), 6.0)
        assert not desk.armed
        if isinstance(desk.end, Board):
            assert desk.end.runtime.gate.reason.startswith("blocked: a wall of the 3 x inf m room")
        await host.drive(Velocity(-0.3, 0.0), 1.0)
        assert desk.speed == 0.0, "the host still asks for motion"
        await host.drive(Velocity(0.0, 0.0), 1.2)
        await host.drive(Velocity(-0.3, 0.0), 2.0)
        assert desk.speed == pytest.approx(-0.3, abs=0.05)


async def test_the_emergency_stop_at_the_board_is_latched_until_it_is_released_there() -> None:
    async with desk_and_host("virtual") as (desk, host):
        assert isinstance(desk.end, Board)
        host.send(GAINS)
        await host.drive(Velocity(0.0, 0.0), 2.5)
        await host.drive(Velocity(0.5, 0.0), 1.0)
        desk.end.stop()
        await host.drive(Velocity(0.0, 0.0), 3.0)
        await host.drive(Velocity(0.5, 0.0), 2.0)
        assert desk.speed == 0.0
        desk.end.arm()
        await host.drive(Velocity(0.5, 0.0), 2.0)
        assert desk.speed == pytest.approx(0.5, abs=0.05)


async def test_esc_off_while_driving_does_not_make_it_lurch_when_the_esc_returns(pair: tuple[Desk, Host]) -> None:
    desk, host = pair
    await host.drive(Velocity(0.5, 0.0), 2.0)
    host.send(PowerControl(Switch.ESC, False))
    await host.drive(Velocity(0.5, 0.0), 3.0)
    assert desk.speed == 0.0
    host.send(PowerControl(Switch.ESC, True))
    fastest = 0.0
    for _ in range(60):
        await host.drive(Velocity(0.5, 0.0), 0.05, rate=20.0)
        fastest = max(fastest, desk.speed)
    assert fastest < 0.56


async def test_the_atx_supply_goes_off_only_when_the_host_asks_for_nothing(pair: tuple[Desk, Host]) -> None:
    desk, host = pair
    await host.drive(Velocity(0.5, 0.0), 1.0)
    host.send(PowerControl(Switch.ATX, False))
    await host.drive(Velocity(0.5, 0.0), 1.0)
    assert desk.atx
    await host.drive(Velocity(0.0, 0.0), 3.0)
    host.send(PowerControl(Switch.ATX, False))
    await host.drive(Velocity(0.0, 0.0), 3.0)
    assert not desk.atx
    await host.drive(Velocity(0.5, 0.0), 1.0)
    assert desk.speed == 0.0, "blind"
    host.send(PowerControl(Switch.ATX, True))
    await host.drive(Velocity(0.0, 0.0), 1.5)
    await host.drive(Velocity(0.5, 0.0), 2.0)
    assert desk.speed == pytest.approx(0.5, abs=0.05)


async def test_the_atx_supply_stays_on_while_a_board_that_stopped_by_itself_rolls() -> None:
    async with desk_and_host("virtual", *ENDLESS) as (desk, host):
        host.send(GAINS)
        await host.drive(Velocity(0.0, 0.0), 2.5)
        await host.drive(Velocity(1.0, 0.0), 3.0)
        assert isinstance(desk.end, Board)
        desk.end.stop()
        host.send(PowerControl(Switch.ATX, False))
        await asyncio.sleep(0.1)
        assert desk.atx and desk.speed > 0.5
        await host.drive(Velocity(0.0, 0.0), 4.0)
        host.send(PowerControl(Switch.ATX, False))
        await asyncio.sleep(0.1)
        assert not desk.atx


async def test_the_first_set_point_after_an_outage_does_not_kick(pair: tuple[Desk, Host]) -> None:
    desk, host = pair
    await host.drive(Velocity(0.5, 0.0), 2.0)
    await asyncio.sleep(4.0)
    fastest = 0.0
    for _ in range(60):
        await host.drive(Velocity(0.5, 0.0), 0.05, rate=20.0)
        fastest = max(fastest, desk.speed)
    assert 0.45 < fastest < 0.56
