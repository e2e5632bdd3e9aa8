"""Host and board over a line: whatever it is made of, and whatever it does to the bytes."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest
from blockbuster import BlockBuster

from tests.e2e.conftest import ENDLESS, may_block
from tests.patience import LIMIT, PATIENT, lateness
from txt1.board import board as board_module
from txt1.board.board import Board
from txt1.config import load
from txt1.control.limits import Fault as GateFault
from txt1.errors import CommandRefused, HalError, NotArmed, NotCapable, StopNotVerified, TaskFault
from txt1.hal import serial as serial_hal
from txt1.hal.base import Button
from txt1.hal.serial import SerialHal
from txt1.kernel.loop import Speed, run
from txt1.kernel.ticks import Ticks
from txt1.link.base import End, Link, Listener
from txt1.link.pty import listen_pty
from txt1.link.tcp import listen_tcp
from txt1.protocol.layout import checksum, encode
from txt1.protocol.messages import (
    CombinedOdometry,
    EncoderOdometry,
    Message,
    PidSet,
    PowerControl,
    PwmCommand,
    PwmTest,
    Switch,
    Velocity,
)
from txt1.robot import Robot
from txt1.tasks.battery import BATTERIES
from txt1.tasks.encoder import ENCODERS, ODOMETRY, POSE
from txt1.tasks.fields import BACKLIGHT, CAPABILITIES, COMMAND, GAIN_TABLE
from txt1.tasks.mode import MODE

TICK = 0.02
SMALL_GAINS = "control.angular=[{v_max: 1.5, kp: 4, ki: 130, kd: 0.005}]"
"""One set: its frame has 34 bytes, of which a noisy line lets more through than of 242."""

VIRTUAL = ("serial.port=virtual", *ENDLESS)


class Wired(NamedTuple):
    """A robot whose board is at the other end of a line, and what the host has sent and the board has received."""

    robot: Robot
    board: Board
    sent: list[tuple[float, Message]]
    received: list[tuple[float, Message]]


def true_speed(board: Board) -> float:
    return board.runtime.hal.vehicle.state.v  # type: ignore[attr-defined, no-any-return]


def outputs(board: Board) -> tuple[int, int, int]:
    """Motor, front and rear of the board's vehicle."""
    held = board.runtime.hal.outputs  # type: ignore[attr-defined]
    return held.motor, held.front, held.rear


@asynccontextmanager
async def wired(
    monkeypatch: pytest.MonkeyPatch,
    *settings: str,
    transport: str = "memory",
    directory: Path | None = None,
    arm: bool | None = True,
) -> AsyncIterator[Wired]:
    """A robot and its board, the link up and the gains acknowledged."""
    sent: list[tuple[float, Message]] = []
    received: list[tuple[float, Message]] = []
    time = asyncio.get_running_loop().time

    def note(message: Message) -> bytes:
        sent.append((time(), message))
        return encode(message)

    monkeypatch.setattr(serial_hal, "encode", note)
    async with line(transport, directory, settings) as words, Robot.open("serial", settings=words, arm=arm) as robot:
        port = robot.hal.port  # type: ignore[attr-defined]
        board = port.board if transport == "memory" else BOARDS[-1]
        post = board.runtime.post

        def take(message: Message, when: float) -> None:
            received.append((time(), message))
            post(message, when)

        board.runtime.post = take
        assert await robot.load_gains(timeout=LIMIT)
        yield Wired(robot, board, sent, received)


BOARDS: list[Board] = []


@asynccontextmanager
async def line(transport: str, directory: Path | None, settings: tuple[str, ...]) -> AsyncIterator[list[str]]:
    """The settings for a host on this kind of line, with a board at its other end."""
    common = [*ENDLESS, *settings]
    if transport == "memory":
        yield ["serial.port=virtual", *common]
        return
    config = load(None, common).config
    board = Board(config)
    BOARDS.append(board)
    listener: Listener
    if transport == "pty":
        assert directory is not None
        listener = listen_pty(str(directory / "board"), board.paced)
    else:
        listener = await listen_tcp("127.0.0.1", 0, board.paced)
    await board.power_up()
    try:
        yield [f"serial.port={listener.address}", *common]
    finally:
        await board.power_down()
        listener.close()
        BOARDS.remove(board)


@pytest.fixture(autouse=True)
def a_pseudo_terminal_is_made_before_the_board_has_power(blocking_calls_fail: BlockBuster) -> None:
    may_block(blocking_calls_fail, "txt1/link/pty.py", "listen_pty", "_let_go")


# -- one body over everything ----------------------------------------------------------------------------------


@asynccontextmanager
async def expecting_trouble(why: str) -> AsyncIterator[None]:
    """The run ends in a stop that nobody saw, or that took more than zeros."""
    with pytest.raises(StopNotVerified, match=why):
        yield


LINES = {
    "clean": (),
    "one byte at a time": ("serial.fault.split=true",),
    "20 % of the frames dropped": ("serial.fault.drop=0.2",),
    "a bit in a thousand flipped": ("serial.fault.flip=0.001",),
    "50 ms late": ("serial.fault.delay=0.05",),
}


async def drives_and_stops(wired: Wired, delay: float, late: Callable[[], float] = lambda: 0.0) -> None:
    """The robot does over the line what it does on the desk, but for what the machine is late."""
    robot, board = wired.robot, wired.board
    await robot.drive(0.5, 0.2, 2.0)
    assert true_speed(board) == pytest.approx(0.5, abs=0.06)
    assert robot.odometry.v == pytest.approx(0.5, abs=0.08)
    assert robot.odometry.x == pytest.approx(board.runtime.state.odometry.x, abs=0.5 * (0.3 + 2.0 * delay))
    robot.servos(1000, -2000)
    await asyncio.sleep(0.5)

    robot.command(0.5, 0.0)
    given = asyncio.get_running_loop().time()
    await asyncio.sleep(2.0)
    assert robot.armed, "a stale command does not disarm"
    assert true_speed(board) == pytest.approx(0.0, abs=0.005)
    zero = next(time for time, message in wired.sent if time > given + 0.1 and message == Velocity(0.0, 0.0))
    assert zero - given <= 0.25 + TICK + 0.03 + 3.0 * late()
    assert robot.odometry.x == pytest.approx(board.runtime.state.odometry.x, abs=0.002)

    robot.disarm()
    with pytest.raises(NotArmed):
        await robot.drive(0.5, 0.0, 1.0)

    # What is acted on was sent: a damaged frame passes the checksum once in 65536 times, and this saw a few hundred.
    # It may come later than it was sent and not at all, but never more often, and never otherwise.
    sent = Counter(message for _, message in wired.sent)
    assert not Counter(message for _, message in wired.received) - sent


@pytest.mark.parametrize(
    ("transport", "settings"),
    [
        # in real time they take long
        pytest.param(
            transport, settings, id=f"{transport}-{line}", marks=[] if transport == "memory" else pytest.mark.long
        )
        for transport in ("memory", "pty", "tcp")
        for line, settings in LINES.items()
    ],
)
def test_the_robot_drives_over_any_line(
    transport: str, settings: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def body() -> None:
        patience = () if transport == "memory" else PATIENT
        async with wired(
            monkeypatch, SMALL_GAINS, *settings, *patience, "seed=3", transport=transport, directory=tmp_path
        ) as together:
            with nullcontext(lambda: 0.0) if transport == "memory" else lateness() as late:
                await drives_and_stops(together, 0.05, late)

    speed: Speed = "max" if transport == "memory" else None
    run(body(), speed=speed)


# -- the virtual line, in virtual time -------------------------------------------------------------------------

Body = Callable[[Wired], Coroutine[Any, Any, None]]


async def test_a_run_over_the_virtual_line_repeats_from_its_seed() -> None:
    async def drive(seed: int) -> tuple[Any, ...]:
        async with Robot.open("serial", seed=seed, settings=[*VIRTUAL, "serial.fault.drop=0.1"]) as robot:
            await robot.load_gains()
            await robot.drive(0.5, 0.4, 5.0)
            return robot.odometry, robot.battery, robot.faults

    assert await drive(1) == await drive(1)
    assert await drive(1) != await drive(2)


async def test_velocity_goes_out_20_times_a_second_armed_or_not(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch, arm=False) as together:
        for arm in (False, True):
            if arm:
                together.robot.arm()
            together.sent.clear()
            await asyncio.sleep(10.0)
            velocities = [message for _, message in together.sent if isinstance(message, Velocity)]
            assert len(velocities) in (199, 200, 201)
            assert set(velocities) == {Velocity(0.0, 0.0)}


async def test_a_stop_is_on_the_wire_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        for offset in (0.0, 0.007, 0.013, 0.021, 0.034, 0.048):
            await together.robot.drive(1.0, 0.0, 1.0)
            together.robot.command(1.0, 0.0)
            await asyncio.sleep(0.1 + offset)
            stopped = asyncio.get_running_loop().time()
            together.robot.stop()
            assert together.sent[-1] == (stopped, Velocity(0.0, 0.0))
            await asyncio.sleep(1.0)
            together.robot.arm()


async def test_no_set_point_goes_out_before_the_board_has_been_heard_for_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun = asyncio.get_running_loop().time()
    async with wired(monkeypatch, arm=False) as together:
        robot = together.robot
        linked = asyncio.get_running_loop().time()
        robot.arm()
        await robot.drive(0.5, 0.0, 1.0)
        first = next(time for time, message in together.sent if isinstance(message, Velocity) and message.v)
        heard = begun + robot.runtime.state.events[1].time
        assert "answers" in robot.runtime.state.events[1].text
        assert first >= linked >= heard + 1.0
        assert max(abs(m) for m in outputs(together.board)) < 24000


@pytest.mark.long
async def test_at_20_percent_lost_frames_no_time_out_is_false_in_ten_minutes(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch, "serial.fault.drop=0.2", "seed=1") as together:
        await together.robot.drive(0.5, 0.3, 600.0)
        gate = together.board.runtime.gate
        assert gate.armed
        assert gate.counts[GateFault.STALE] == gate.counts[GateFault.LINK] == 0
        assert together.robot.faults["link_lost"] == 0


async def test_gains_are_sent_once_a_second_until_the_board_acknowledges_them(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        hal: SerialHal = together.robot.hal  # type: ignore[assignment]
        link = hal.line.link
        assert link is not None
        asked: list[float] = []
        time = asyncio.get_running_loop().time

        def swallow(frame: bytes) -> None:
            if frame[3] == 0x70:
                asked.append(time())
                if len(asked) < 4:
                    return
            link.write(frame)

        hal.line.link = SimpleNamespace(write=swallow, close=link.close, overflows=0)  # type: ignore[assignment]
        assert await together.robot.load_gains(timeout=10.0)
        await asyncio.sleep(5.0)
        assert [round(later - asked[0]) for later in asked] == [0, 1, 2, 3]


async def test_gains_the_board_rejects_are_reported_and_counted(
    monkeypatch: pytest.MonkeyPatch, reject_gains: Callable[[], None]
) -> None:
    async with wired(monkeypatch) as together:
        reject_gains()
        hal = together.robot.hal
        assert not await together.robot.load_gains()
        assert together.robot.faults["gains_refused"] > 0
        assert hal.name == "serial"


async def test_servos_power_and_combined_odometry_reach_the_board(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        robot, state = together.robot, together.board.runtime.state
        robot.servos(1000, -2000)
        robot.switch_power(Switch.ESC, False)
        await asyncio.sleep(0.2)
        assert state.servos == (1000, -2000)
        assert state.power == (True, False, True)
        assert robot.runtime.state.power == (None, False, False), "asked, not confirmed; of ATX nobody knows"
        assert PwmCommand(1000, -2000) in [message for _, message in together.received]


async def test_combined_odometry_reaches_the_board_of_a_robot_that_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        robot, state = together.robot, together.board.runtime.state
        for _ in range(200):
            robot.combined_odometry(1.0, 2.0, 0.5, 0.25, 0.125)
            await asyncio.sleep(0.01)
        assert not state.link.combined, "its loops would drive against a speed that is not there"
        for _ in range(200):
            robot.command(0.25, 0.1)
            robot.combined_odometry(1.0, 2.0, 0.5, 0.25, 0.125)
            await asyncio.sleep(0.01)
        assert state.link.combined
        assert state.combined is not None and state.combined[:2] == (0.25, 0.125)
        combined = [message for _, message in together.received if isinstance(message, CombinedOdometry)]
        assert 95 <= len(combined) <= 101, "100 a second would crowd the line"


async def test_combined_odometry_outside_the_world_is_refused_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        together.robot.command(0.25, 0.0)
        await asyncio.sleep(0.1)
        together.robot.combined_odometry(1e9, 0.0, 0.0, 0.0, 0.0)
        await asyncio.sleep(0.1)
        assert together.robot.faults["line_not_encodable"] == 1


async def test_what_the_wire_does_not_carry_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        with pytest.raises(NotCapable, match="'place'"):
            together.robot.place(0.0, 0.0, 0.0)
        with pytest.raises(NotCapable, match="allow_host"):
            together.robot.pwm_test(0, 0, 0)
        assert together.robot.pose is None


async def test_the_odometry_scale_corrects_a_board_that_reads_low() -> None:
    settings = [*VIRTUAL, "odometry.scale=1.067", "geometry.circumference=0.5125"]
    async with Robot.open("serial", settings=settings) as robot:
        await robot.load_gains()
        await robot.drive(0.5, 0.0, 4.0)
        board = robot.hal.port.board  # type: ignore[attr-defined]
        assert robot.odometry.x == pytest.approx(1.067 * board.runtime.state.odometry.x, abs=0.05)


# -- what breaks -----------------------------------------------------------------------------------------------


async def test_a_silent_board_is_noticed_within_half_a_second_and_its_return_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with expecting_trouble("no odometry"), wired(monkeypatch) as together:
        robot, board = together.robot, together.board
        await robot.drive(0.5, 0.0, 1.0)
        board.link = None
        with pytest.raises(NotArmed, match="no odometry"):
            await robot.drive(0.5, 0.0, 0.5 + TICK)
        assert robot.faults["link_lost"] == 1
        await asyncio.sleep(3.0)
        assert true_speed(board) == 0.0
        assert not robot.armed
        with pytest.raises(NotArmed, match="no link to the board yet"):
            robot.arm()


async def test_after_a_cut_the_link_comes_back_disarmed_with_the_gains_sent_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with wired(monkeypatch) as together:
        robot, board = together.robot, together.board
        await robot.drive(1.0, 0.0, 2.0)
        robot.command(1.0, 0.0)
        link = board.link
        assert link is not None
        together.received.clear()
        link.close()
        lost = robot.now
        await asyncio.sleep(2 * TICK)
        assert not robot.armed
        assert "lost" in robot.reason
        await asyncio.sleep(0.25 + TICK)
        command = board.runtime.state.command
        assert outputs(board) == (0, 0, 0) or (command is not None and command.v == 0.0)
        await robot.linked(5.0)
        again = next(event for event in robot.runtime.state.events if event.time > lost and "answers" in event.text)
        assert again.time - lost < 2.5
        assert robot.faults["reconnects"] == 1
        await asyncio.sleep(1.0)
        assert any(isinstance(message, PidSet) for _, message in together.received), "the gains were sent again"
        assert not robot.armed
        assert true_speed(board) == 0.0
        robot.arm()
        await robot.drive(0.5, 0.0, 2.0)
        assert true_speed(board) == pytest.approx(0.5, abs=0.06)


async def test_where_the_configuration_says_so_the_robot_arms_again_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch, "serial.rearm=true") as together:
        robot, board = together.robot, together.board
        assert board.link is not None
        board.link.close()
        await asyncio.sleep(0.1)
        assert not robot.armed
        await asyncio.sleep(5.0)
        assert robot.armed

        board.link.close()
        await asyncio.sleep(0.1)
        robot.stop()
        await asyncio.sleep(5.0)
        assert not robot.armed, "an emergency stop stays"


async def test_a_board_that_restarts_is_noticed_by_its_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        robot = together.robot
        await robot.drive(0.4, 0.0, 3.0)
        assert robot.odometry.x > 1.0
        together.received.clear()
        anew = encode(EncoderOdometry(0.0, 0.0, 0.0, 0.0, 0.0))
        monkeypatch.setattr(
            board_module, "encode", lambda message: anew if isinstance(message, EncoderOdometry) else encode(message)
        )
        await asyncio.sleep(0.1)
        assert not robot.armed
        assert "restarted" in robot.reason
        await asyncio.sleep(0.1)
        assert any(isinstance(message, PidSet) for _, message in together.received), "it may have forgotten them"


@pytest.mark.parametrize("fault", ["serial.fault.flip=0.2", "serial.fault.drop=0.99"])
async def test_a_board_that_only_makes_noise_does_not_link_up(fault: str) -> None:
    with pytest.raises(HalError, match=r"no link after 10 s.*txt1 doctor"):
        async with Robot.open("serial", settings=[*VIRTUAL, fault]):
            pass


async def test_pwm_test_is_no_message_of_a_host_that_leaves_the_loops_to_the_board(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with wired(monkeypatch) as together:
        await together.robot.drive(0.5, 0.5, 2.0)
        assert not any(isinstance(message, PwmTest) for _, message in together.sent)


async def test_a_stop_before_the_loss_of_the_link_is_not_undone_by_rearm(monkeypatch: pytest.MonkeyPatch) -> None:
    for stop in (Robot.stop, Robot.disarm):
        async with wired(monkeypatch, "serial.rearm=true") as together:
            robot, board = together.robot, together.board
            await robot.drive(0.5, 0.0, 1.0)
            stop(robot)
            assert board.link is not None
            board.link.close()
            await asyncio.sleep(6.0)
            assert robot.runtime.linked
            assert not robot.armed


async def test_rearm_survives_a_second_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch, "serial.rearm=true") as together:
        for _ in range(2):
            assert together.board.link is not None
            together.board.link.close()
            await asyncio.sleep(1.0)
            assert not together.robot.armed
        await asyncio.sleep(5.0)
        assert together.robot.armed


@pytest.mark.long
async def test_servos_and_switches_are_sent_until_they_arrive(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch, "serial.fault.drop=0.3", "seed=5", SMALL_GAINS) as together:
        robot, state = together.robot, together.board.runtime.state
        await robot.drive(0.5, 0.0, 0.5)  # away from the pose of a board that restarted
        for k in range(20):
            robot.servos(100 * k, -100 * k)
            await asyncio.sleep(6.0)
            assert state.servos == (100 * k, -100 * k)
        robot.switch_power(Switch.ESC, False)
        await asyncio.sleep(6.0)
        assert not state.power.esc
        assert together.board.link is not None
        together.board.link.close()
        await asyncio.sleep(8.0)
        assert not state.power.esc


async def test_no_switch_is_turned_on_twice_and_atx_is_not_switched_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch, arm=False) as together:
        robot = together.robot
        for switch, on, often in ((Switch.ATX, False, 1), (Switch.ATX, True, 1), (Switch.ESC, True, 1)):
            together.sent.clear()
            robot.switch_power(switch, on)
            await asyncio.sleep(10.0)
            assert [message for _, message in together.sent].count(PowerControl(switch, on)) == often
        together.sent.clear()
        robot.switch_power(Switch.ESC, False)
        await asyncio.sleep(10.0)
        assert [message for _, message in together.sent].count(PowerControl(Switch.ESC, False)) > 5


async def test_the_esc_comes_on_after_silence_and_zeros_and_never_while_armed(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        robot = together.robot
        with pytest.raises(CommandRefused, match="disarm"):
            robot.switch_power(Switch.ESC, True)
        robot.disarm()
        await asyncio.sleep(1.0)
        together.sent.clear()
        robot.switch_power(Switch.ESC, True)
        asked = asyncio.get_running_loop().time()
        await asyncio.sleep(1.0)
        with pytest.raises(NotArmed, match=r"ESC comes on|no odometry"):
            robot.arm()
        await asyncio.sleep(6.0)
        velocities = [time - asked for time, message in together.sent if isinstance(message, Velocity)]
        (on,) = [time - asked for time, message in together.sent if message == PowerControl(Switch.ESC, True)]
        assert min(time for time in velocities if time > TICK) > 2.0, "the link rule clears the board's loops"
        assert on - min(time for time in velocities if time > TICK) >= 1.0
        robot.arm()


async def test_the_board_is_left_with_a_stop_that_a_lost_frame_does_not_undo(monkeypatch: pytest.MonkeyPatch) -> None:
    for seed in range(10):
        async with wired(monkeypatch, "serial.fault.drop=0.2", f"seed={seed}", SMALL_GAINS) as together:
            await together.robot.drive(0.5, 0.0, 1.0)
            together.robot.command(0.5, 0.0)
        last = [message for _, message in together.received if isinstance(message, Velocity)][-1]
        assert last == Velocity(0.0, 0.0)


async def test_why_the_line_cannot_be_opened_again_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        robot, port = together.robot, together.robot.hal.port  # type: ignore[attr-defined]

        async def busy(end: End) -> Link:
            raise HalError("somebody else has it")

        port.open = busy
        assert together.board.link is not None
        together.board.link.close()
        await asyncio.sleep(2.0)
        with pytest.raises(NotArmed, match="somebody else has it"):
            robot.arm()


async def test_a_task_of_the_virtual_board_that_fails_reaches_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(TaskFault, match="broken") as fault:
        async with wired(monkeypatch) as together:

            async def broken(ticks: Ticks) -> None:
                async for _ in ticks:
                    raise RuntimeError("broken")

            together.board.runtime.add_task("broken", 0, 0.1, broken)
            await asyncio.sleep(5.0)
    assert "broken" in str(fault.value)


async def test_old_commands_do_not_make_a_line_lossy(monkeypatch: pytest.MonkeyPatch) -> None:
    async with wired(monkeypatch) as together:
        assert together.board.link is not None
        body = bytes((0x6D, *bytes(16)))
        old = b"\xfa\xfb\x10" + body + checksum(body).to_bytes(2, "big")
        together.sent.clear()
        for _ in range(50):
            together.board.link.write(old)
            await asyncio.sleep(0.1)
        velocities = [message for _, message in together.sent if isinstance(message, Velocity)]
        assert len(velocities) in (99, 100, 101)
        assert together.robot.faults["line_old_command"] == 50


async def test_battery_levels_have_the_time_they_came_and_a_silent_board_has_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with wired(monkeypatch) as together:
        robot = together.robot
        await asyncio.sleep(3.0)
        assert 0.0 <= robot.now - robot.battery.time <= 2.0
        together.board.link = None
        await asyncio.sleep(2.0)
        heard = robot.battery.time
        levels = robot.battery_stream()
        # a board that is silent for longer has its port opened again, and answers
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(anext(levels), 3.0)
        assert robot.battery.time == heard


# -- loops on the host -----------------------------------------------------------------------------------------

HOST = (*VIRTUAL, "serial.control=host")


async def test_control_by_the_host_arms_only_where_that_is_allowed() -> None:
    async with Robot.open("serial", settings=HOST, arm=False) as robot:
        with pytest.raises(NotArmed, match="allow_host"):
            robot.arm()


async def test_pwm_by_hand_needs_a_word_about_hosts_that_die() -> None:
    async with Robot.open("serial", settings=VIRTUAL) as robot:
        with pytest.raises(NotCapable, match=r"serial\.allow_host=true.*centre button"):
            await robot.set_manual(True)
        with pytest.raises(NotCapable, match="allow_host"):
            robot.pwm_test(2000, 0, 0)


@pytest.mark.parametrize("habits", ["ours", "original"])
async def test_a_board_in_manual_mode_is_driven_by_pwm_and_by_set_points_again_afterwards(habits: str) -> None:
    settings = [*VIRTUAL, "serial.allow_host=true", f"board.habits={habits}"]
    async with Robot.open("serial", settings=settings) as robot:
        board = robot.hal.port.board  # type: ignore[attr-defined]
        await robot.load_gains()
        await robot.set_manual(False)
        with pytest.raises(CommandRefused, match="needs manual mode"):
            robot.pwm_test(2000, 0, 0)

        board.runtime.press(Button.CENTRE)
        await robot.set_manual(True)
        await robot.hold_pwm(1500, -9000, 9000, duration=2.0)
        assert 0.2 < robot.odometry.v < 0.6
        assert robot.odometry.omega > 0.2, "it turns left"
        await asyncio.sleep(2.0)
        assert true_speed(board) == 0.0, "an original board would have kept it for ever"

        robot.pwm_test(1500, 0, 0)
        await asyncio.sleep(0.2)
        robot.disarm("enough")
        await asyncio.sleep(2.5)
        assert true_speed(board) == 0.0
        board.runtime.press(Button.CENTRE)
        await robot.set_manual(False)
        robot.arm()
        await asyncio.sleep(1.5)
        await robot.drive(0.4, 0.0, 2.0)
        assert true_speed(board) == pytest.approx(0.4, abs=0.08)


@pytest.mark.parametrize("v, omega", [(0.5, 0.0), (0.5, 0.4), (-0.5, 0.0), (-0.5, 0.3), (1.0, 0.3)])
async def test_the_host_closes_the_loops_at_20_hz(v: float, omega: float) -> None:
    async with Robot.open("serial", settings=[*HOST, "serial.allow_host=true"]) as robot:
        await robot.load_gains()
        board = robot.hal.port.board  # type: ignore[attr-defined]
        assert board.runtime.state.panel.manual
        speeds, rates = [], []

        async def look(ticks: Ticks) -> None:
            async for _ in ticks:
                speeds.append(true_speed(board))
                rates.append(robot.odometry.omega)

        await robot.drive(v, omega, 4.0)
        robot.add_task("look", 0.02, look, priority=-1)
        await robot.drive(v, omega, 4.0)
        assert sum(speeds) / len(speeds) == pytest.approx(v, abs=0.05)
        assert max(abs(speed - v) for speed in speeds) < 0.1
        assert sum(rates) / len(rates) == pytest.approx(omega, abs=0.05)
        await asyncio.sleep(1.5)
        assert true_speed(board) == 0.0


# -- the screens -----------------------------------------------------------------------------------------------


async def test_what_the_wire_carries_agrees_on_both_screens_and_the_rest_is_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with wired(monkeypatch) as together:
        await together.robot.drive(0.5, 0.4, 3.0)
        await together.robot.drive(0.0, 0.0, 3.0)
        host, board = together.robot.snapshot, together.board.snapshot
        assert host[ODOMETRY] == pytest.approx(board[ODOMETRY], abs=0.0006)
        assert host[ODOMETRY].x > 1.0
        ours, theirs = host[BATTERIES[0]], board[BATTERIES[0]]
        assert (ours.battery1, ours.battery2) == pytest.approx((theirs.battery1, theirs.battery2), abs=0.01)
        assert ours.state == theirs.state
        assert host[COMMAND][:2] == board[COMMAND][:2] == (0.0, 0.0)
        assert host[GAIN_TABLE].linear == board[GAIN_TABLE].linear and host[GAIN_TABLE].loaded
        assert host[MODE].link.alive and board[MODE].link.alive
        can = host[CAPABILITIES]
        assert not (can.ticks or can.pwm or can.buttons or can.pose)
        assert {host.get(topic) for topic in (ENCODERS, POSE, BACKLIGHT)} == {None}


async def test_nothing_that_a_board_keeps_to_itself_is_recorded() -> None:
    async with Robot.open("serial", settings=VIRTUAL, patience=0.0) as robot:
        bus = robot.runtime.bus
        assert {topic.name for topic in bus.offered}.isdisjoint({"/pwm", "/gains", "/encoders", "/pose"})
        assert bus.read(ODOMETRY) is None
        await robot.linked(5.0)
        assert bus.read(ODOMETRY) == (0.0, 0.0, 0.0, 0.0, 0.0)
