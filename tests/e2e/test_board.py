"""The virtual board, as an original host program meets it: bytes on a line."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from tests.e2e.conftest import ENDLESS
from txt1.board import Board
from txt1.config import load
from txt1.config.schema import ControlConfig
from txt1.hal.base import Button
from txt1.hal.sim import SimHal
from txt1.kernel.ticks import Ticks
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


@asynccontextmanager
async def board_and_host(*settings: str, manual: bool = False) -> AsyncIterator[tuple[Board, Host]]:
    board, host = Board(load(None, [*ENDLESS, *settings]).config, manual=manual), Host()
    await board.power_up()
    connect(host, paced(board, 57600))
    await asyncio.sleep(0.0)
    try:
        yield board, host
    finally:
        await board.power_down()


@pytest.fixture
async def pair() -> AsyncIterator[tuple[Board, Host]]:
    """A board whose host drives: link alive, gains loaded."""
    async with board_and_host() as (board, host):
        host.send(GAINS)
        await host.drive(Velocity(0.0, 0.0), 2.5)
        yield board, host


def hal(board: Board) -> SimHal:
    layer = board.runtime.hal
    assert isinstance(layer, SimHal)
    return layer


def true_speed(board: Board) -> float:
    return hal(board).vehicle.state.v


def outputs(board: Board) -> tuple[int, int, int]:
    held = hal(board).outputs
    return held.motor, held.front, held.rear


# -- power-up --------------------------------------------------------------------------------------------------


async def test_at_power_up_nothing_moves_before_a_pid_set_and_velocity_have_come() -> None:
    async with board_and_host() as (board, host):
        await host.drive(Velocity(0.5, 0.3), 5.0)
        assert outputs(board) == (0, 0, 0), "without gains"
    async with board_and_host() as (board, host):
        host.send(GAINS)
        await asyncio.sleep(5.0)
        assert outputs(board) == (0, 0, 0), "without Velocity"
    async with board_and_host() as (board, host):
        host.send(GAINS)
        await host.drive(Velocity(0.5, 0.0), 5.0)
        assert true_speed(board) == pytest.approx(0.5, abs=0.05)


async def test_odometry_comes_20_times_a_second_while_there_is_a_host_and_battery_levels_once() -> None:
    async with board_and_host() as (_, host):
        await asyncio.sleep(3.0)
        assert not any(isinstance(message, EncoderOdometry) for _, message in host.heard)
        await host.drive(Velocity(0.0, 0.0), 3.0)
        host.heard.clear()
        await host.drive(Velocity(0.0, 0.0), 10.0)
        assert sum(isinstance(message, EncoderOdometry) for _, message in host.heard) in (199, 200, 201)
        assert sum(isinstance(message, BatteryLevels) for _, message in host.heard) in (9, 10, 11)


# -- the line --------------------------------------------------------------------------------------------------


async def test_a_pid_set_is_answered_after_the_time_its_bytes_take(pair: tuple[Board, Host]) -> None:
    board, host = pair
    host.heard.clear()
    asked = host.time()
    host.send(GAINS)
    await asyncio.sleep(0.2)
    ((answered, accepted),) = host.answers()
    assert accepted and board.runtime.state.gains.loaded
    # 242 bytes there and 7 back; what is already under way to the host goes first
    assert (242 + 7) * BYTE <= answered - asked <= (242 + 7 + 27 + 11) * BYTE + 1e-6


@pytest.mark.parametrize("length", [0, 4, 11, 13, 27, 237, 249])
async def test_a_malformed_pid_set_is_rejected_and_changes_nothing(pair: tuple[Board, Host], length: int) -> None:
    board, host = pair
    before = board.runtime.state.gains
    host.heard.clear()
    body = bytes((0x70, *bytes(length)))
    assert host.link is not None
    host.link.write(b"\xfa\xfb" + bytes((length,)) + body + checksum(body).to_bytes(2, "big"))
    await asyncio.sleep(0.5)
    assert [accepted for _, accepted in host.answers()] == [False]
    assert board.runtime.state.gains == before


async def test_an_answer_that_the_line_echoes_is_not_answered(pair: tuple[Board, Host]) -> None:
    _, host = pair
    host.heard.clear()
    assert host.link is not None
    host.link.write(encode(PidResponse(True)))
    await asyncio.sleep(0.5)
    assert host.answers() == []


async def test_a_zero_byte_stands_between_frames_back_to_back_and_nowhere_else(pair: tuple[Board, Host]) -> None:
    """Original hosts lose the byte behind a frame, when it is there already."""
    _, host = pair
    host.raw.clear()
    await host.drive(Velocity(0.0, 0.0), 20.0)
    stream = b"".join(data for _, data in host.raw)
    odometry, battery = 26, 10
    spaced = stream.count(b"\x00\xfa\xfb\x04\x6a")
    assert spaced > 15, "battery levels follow odometry in the same tick"
    assert b"\xfa\xfb\x14\x68" in stream
    frames = stream.count(b"\xfa\xfb\x14\x68"), stream.count(b"\xfa\xfb\x04\x6a")
    spacers = len(stream) - frames[0] * odometry - frames[1] * battery
    assert spaced <= spacers <= 2 * spaced


async def test_bytes_come_at_the_baud_rate(pair: tuple[Board, Host]) -> None:
    _, host = pair
    host.raw.clear()
    await host.drive(Velocity(0.0, 0.0), 10.0)
    until = 0.0
    for time, data in host.raw:
        assert time >= until + len(data) * BYTE - 1e-6
        until = time


async def test_garbage_between_frames_costs_nothing(pair: tuple[Board, Host]) -> None:
    board, host = pair
    assert host.link is not None
    for _ in range(100):
        host.link.write(b"\x00\xfa\x55\xfa\xfb\xff")
        host.send(Velocity(0.5, 0.0))
        await asyncio.sleep(0.05)
    assert true_speed(board) == pytest.approx(0.5, abs=0.05)
    assert board.runtime.faults()["line_bad_length"] >= 100


# -- a host that goes away -------------------------------------------------------------------------------------


async def time_to_neutral(board: Board) -> float:
    """Seconds from the arrival of the last command until motor and steering are neutral."""
    state = board.runtime.state
    last = max(given.time for given in (state.command, state.manual_pwm) if given is not None)
    neutral: list[float] = []

    async def look(ticks: Ticks) -> None:
        async for now in ticks:
            if outputs(board) == (0, 0, 0):
                neutral.append(now)

    board.runtime.add_task("look", -1, TICK, look)
    await asyncio.sleep(3.0)
    return neutral[0] - last


async def test_a_host_that_falls_silent_at_1_metre_a_second_stops_the_vehicle(pair: tuple[Board, Host]) -> None:
    board, host = pair
    await host.drive(Velocity(1.0, 0.0), 3.05, rate=20.0)
    assert true_speed(board) == pytest.approx(1.0, abs=0.1)
    assert await time_to_neutral(board) <= 0.25 + TICK
    assert not board.runtime.gate.armed, "and the link is lost a second later"


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.6, 0.9])
async def test_without_a_time_out_the_link_rule_of_the_thesis_stops_it(phase: float) -> None:
    async with board_and_host("board.link_timeout=null") as (board, host):
        host.send(GAINS)
        await host.drive(Velocity(1.0, 0.0), 4.0 + phase)
        assert true_speed(board) == pytest.approx(1.0, abs=0.1)
        took = await time_to_neutral(board)
        assert 0.9 < took <= 2.0


async def test_in_manual_mode_pwm_test_is_obeyed_and_goes_neutral_with_the_link() -> None:
    for settings in ((), ("board.link_timeout=null",)):
        async with board_and_host(*settings, manual=True) as (board, host):
            for _ in range(60):
                host.send(Velocity(0.0, 0.0))
                await host.drive(PwmTest(2000, -5000, 5000, 0, 0), 0.05, rate=20.0)
            assert outputs(board) == (2000, -5000, 5000)
            took = await time_to_neutral(board)
            assert took <= (2.0 if settings else 0.25 + TICK)


async def test_pwm_test_moves_nothing_in_controller_mode(pair: tuple[Board, Host]) -> None:
    board, host = pair
    for _ in range(40):
        host.send(Velocity(0.0, 0.0))
        await host.drive(PwmTest(3000, 0, 0, 0, 0), 0.05, rate=20.0)
        assert outputs(board)[0] == 0
    assert board.runtime.faults()["pwm_test_refused"] == 40


async def test_the_joystick_changes_the_mode(pair: tuple[Board, Host]) -> None:
    board, host = pair
    board.press(Button.CENTRE)
    await host.drive(Velocity(0.5, 0.0), 2.0)
    assert board.runtime.state.panel.manual
    assert true_speed(board) == 0.0


# -- stops of its own, and the way back ------------------------------------------------------------------------


async def test_after_a_wall_the_board_obeys_again_when_the_host_has_let_go_for_a_second() -> None:
    async with board_and_host("sim.room.length=3.0") as (board, host):
        host.send(GAINS)
        await host.drive(Velocity(0.0, 0.0), 2.5)
        await host.drive(Velocity(0.5, 0.0), 6.0)
        assert not board.runtime.gate.armed
        assert board.runtime.gate.reason.endswith("blocks the robot: it is at a wall of the 3 x inf m room")
        await host.drive(Velocity(-0.3, 0.0), 1.0)
        assert true_speed(board) == 0.0, "the host still asks for motion"
        await host.drive(Velocity(0.0, 0.0), 1.2)
        await host.drive(Velocity(-0.3, 0.0), 2.0)
        assert true_speed(board) == pytest.approx(-0.3, abs=0.05)


async def test_the_emergency_stop_at_the_board_is_latched_until_it_is_released_there(pair: tuple[Board, Host]) -> None:
    board, host = pair
    await host.drive(Velocity(0.5, 0.0), 1.0)
    board.stop()
    await host.drive(Velocity(0.0, 0.0), 3.0)
    await host.drive(Velocity(0.5, 0.0), 2.0)
    assert true_speed(board) == 0.0
    board.arm()
    await host.drive(Velocity(0.5, 0.0), 2.0)
    assert true_speed(board) == pytest.approx(0.5, abs=0.05)


async def test_esc_off_while_driving_does_not_make_it_lurch_when_the_esc_returns(pair: tuple[Board, Host]) -> None:
    board, host = pair
    await host.drive(Velocity(0.5, 0.0), 2.0)
    host.send(PowerControl(Switch.ESC, False))
    await host.drive(Velocity(0.5, 0.0), 3.0)
    assert true_speed(board) == 0.0
    host.send(PowerControl(Switch.ESC, True))
    fastest = 0.0
    for _ in range(60):
        await host.drive(Velocity(0.5, 0.0), 0.05, rate=20.0)
        fastest = max(fastest, true_speed(board))
    assert fastest < 0.56


async def test_the_atx_supply_goes_off_only_when_the_host_asks_for_nothing(pair: tuple[Board, Host]) -> None:
    board, host = pair
    await host.drive(Velocity(0.5, 0.0), 1.0)
    host.send(PowerControl(Switch.ATX, False))
    await host.drive(Velocity(0.5, 0.0), 1.0)
    assert board.runtime.state.power.atx
    await host.drive(Velocity(0.0, 0.0), 3.0)
    host.send(PowerControl(Switch.ATX, False))
    await host.drive(Velocity(0.0, 0.0), 3.0)
    assert not board.runtime.state.power.atx
    await host.drive(Velocity(0.5, 0.0), 1.0)
    assert true_speed(board) == 0.0, "blind"
    host.send(PowerControl(Switch.ATX, True))
    await host.drive(Velocity(0.0, 0.0), 1.5)
    await host.drive(Velocity(0.5, 0.0), 2.0)
    assert true_speed(board) == pytest.approx(0.5, abs=0.05)


async def test_the_first_set_point_after_an_outage_does_not_kick(pair: tuple[Board, Host]) -> None:
    board, host = pair
    await host.drive(Velocity(0.5, 0.0), 2.0)
    await asyncio.sleep(10.0)
    fastest = 0.0
    for _ in range(80):
        await host.drive(Velocity(0.5, 0.0), 0.05, rate=20.0)
        fastest = max(fastest, true_speed(board))
    assert 0.45 < fastest < 0.56
