"""A stop is one, also beside a board with the habits of the originals; and what is no fault is taken for none."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import replace

import pytest

from tests.e2e.conftest import ENDLESS
from txt1.board.board import Board, BoardEvent
from txt1.cli import execute
from txt1.control.standstill import Stop
from txt1.errors import CommandRefused, HalError, NotArmed, StopNotVerified, TaskFault
from txt1.hal.base import Inputs
from txt1.hal.serial import SerialHal
from txt1.kernel.ticks import Ticks
from txt1.protocol.messages import PowerControl, Switch
from txt1.robot import Robot
from txt1.tasks.encoder import fallen
from txt1.tasks.mode import MODE

WIRE = ("serial.port=virtual", *ENDLESS)
ORIGINAL = (*WIRE, "board.habits=original")


@asynccontextmanager
async def robot_and_board(*settings: str, seed: int = 1) -> AsyncIterator[tuple[Robot, Board]]:
    """An armed robot whose gains the board has acknowledged."""
    async with Robot.open("serial", seed=seed, settings=settings or ORIGINAL, arm=True) as robot:
        assert await robot.load_gains()
        yield robot, robot.hal.port.board  # type: ignore[attr-defined]


async def drive(robot: Robot, v: float, duration: float) -> None:
    """Drive, and go on asking for it until the next thing happens."""
    await robot.drive(v, 0.0, duration)
    robot.command(v, 0.0)


async def stands_within(board: Board, limit: float) -> float:
    """Seconds until the true speed has become that of a car that stands; fails after the limit."""
    for k in range(round(limit / 0.01)):
        if abs(board.vehicle.motion[3]) < 0.05:
            return 0.01 * k
        await asyncio.sleep(0.01)
    pytest.fail(f"{board.vehicle.motion[3]:.2f} m/s after {limit} s")


def told(robot: Robot) -> str:
    return "; ".join(event.text for event in robot.runtime.state.events)


# -- the ATX supply, which feeds the encoders -------------------------------------------------------------------


@pytest.mark.parametrize("settings", [ORIGINAL, WIRE], ids=["original", "ours"])
@pytest.mark.parametrize("after", [0.0, 0.1, 0.3])
async def test_the_atx_supply_stays_on_until_the_robot_was_seen_to_stand(
    settings: tuple[str, ...], after: float
) -> None:
    async with robot_and_board(*settings) as (robot, board):
        await drive(robot, 1.0, 3.0)
        robot.disarm()
        await asyncio.sleep(after)
        with pytest.raises(CommandRefused, match="until they have seen the robot stand: ask again then"):
            robot.switch_power(Switch.ATX, False)
        robot.runtime.post(PowerControl(Switch.ATX, False), robot.now)  # as a host's message
        await asyncio.sleep(0.05)
        assert board.vehicle.atx_on and robot.runtime.state.power.atx is None
        assert robot.faults["power_control_refused"] == 2
        assert "seen the robot stand" in told(robot)
        while robot.stop_state is not Stop.STANDING:
            await asyncio.sleep(0.05)
        # our own board obeys when nothing was asked of it for a second; the car may creep on by a last count meanwhile
        await asyncio.sleep(2.0)
        robot.switch_power(Switch.ATX, False)
        await asyncio.sleep(0.1)
        assert not board.vehicle.atx_on


async def test_a_board_whose_atx_supply_is_off_sends_zeros_and_is_not_seen_to_stand() -> None:
    async with robot_and_board() as (robot, board):
        robot.disarm()
        await asyncio.sleep(0.5)
        assert robot.stop_state is Stop.STANDING
        robot.switch_power(Switch.ATX, False)
        await asyncio.sleep(0.1)
        assert (board.vehicle.atx_on, robot.stop_state) == (False, Stop.UNSEEN)
        await asyncio.sleep(5.0)
        assert (robot.odometry.v, robot.stop_state) == (0.0, Stop.UNSEEN)
        robot.switch_power(Switch.ATX, False)  # which is off: nothing to refuse
        robot.switch_power(Switch.ATX, True)
        await asyncio.sleep(0.5)
        assert robot.stop_state is Stop.STANDING


async def test_a_board_s_esc_goes_off_with_its_atx_supply_and_stays_off_without_it() -> None:
    async with robot_and_board() as (robot, board):
        robot.disarm()
        await asyncio.sleep(0.5)
        robot.switch_power(Switch.ESC, True)
        await asyncio.sleep(1.0)  # it would come on in two more
        robot.switch_power(Switch.ATX, False)
        await asyncio.sleep(3.0)
        assert (board.vehicle.atx_on, board.vehicle.esc_on) == (False, False)
        with pytest.raises(
            CommandRefused, match="without the ATX supply the encoders see nothing; switch that on first"
        ):
            robot.switch_power(Switch.ESC, True)
        robot.runtime.post(PowerControl(Switch.ESC, True), robot.now)
        await asyncio.sleep(4.0)
        assert not board.vehicle.esc_on, "nor by a message"
        robot.switch_power(Switch.ATX, True)
        await asyncio.sleep(0.1)
        robot.switch_power(Switch.ESC, True)
        await asyncio.sleep(4.0)
        assert board.vehicle.esc_on
        robot.arm()


async def test_the_esc_stays_off_until_a_robot_that_did_not_stop_was_seen_to_stand() -> None:
    with suppress(StopNotVerified):
        async with robot_and_board() as (robot, board):
            await drive(robot, 1.0, 3.0)
            board.happen(BoardEvent("restart", 3600.0))
            robot.disarm()
            await asyncio.sleep(3.0)
            assert robot.stop_state is Stop.ESC_OFF
            with pytest.raises(CommandRefused, match="did not stop when told to; ask again when it was seen to stand"):
                robot.switch_power(Switch.ESC, True)


async def test_a_robot_that_stood_and_fell_silent_is_not_seen_and_keeps_its_atx_supply() -> None:
    async with robot_and_board() as (robot, board):
        robot.disarm()
        await asyncio.sleep(0.5)
        board.happen(BoardEvent("restart", 3600.0))
        await asyncio.sleep(0.5)
        assert robot.stop_state is Stop.UNSEEN
        with pytest.raises(CommandRefused, match="seen the robot stand"):
            robot.switch_power(Switch.ATX, False)


@pytest.mark.parametrize("settings", [ORIGINAL, WIRE], ids=["original", "ours"])
async def test_an_atx_supply_that_is_switched_off_by_hand_in_motion_is_no_stop(settings: tuple[str, ...]) -> None:
    with pytest.raises(StopNotVerified, match=r"not seen to stand \(not seen\): look at it"):
        async with robot_and_board(*settings) as (robot, board):
            await drive(robot, 1.0, 3.0)
            board.runtime.hal.switch(Switch.ATX, False, board.now)
            robot.disarm()
            seen = set()
            for _ in range(500):
                await asyncio.sleep(0.01)
                seen.add(robot.stop_state)
            assert (robot.odometry.v, robot.stop_state) == (0.0, Stop.UNSEEN) and Stop.STANDING not in seen
            assert "encoders without power; look at the robot" in told(robot)
            assert board.vehicle.motion[3] < 0.05, "as silence has cleared the loops that drove on"
            with pytest.raises(CommandRefused, match="seen the robot stand"):
                robot.switch_power(Switch.ATX, False)


@pytest.mark.parametrize("by_hand", [True, False])
async def test_with_power_again_it_is_seen_to_stand(by_hand: bool) -> None:
    async with robot_and_board() as (robot, board):
        await drive(robot, 1.0, 3.0)
        board.runtime.hal.switch(Switch.ATX, False, board.now)
        robot.disarm()
        await asyncio.sleep(6.0)
        assert robot.stop_state is Stop.UNSEEN
        if by_hand:
            board.runtime.hal.switch(Switch.ATX, True, board.now)
            await asyncio.sleep(1.0)
            assert robot.stop_state is Stop.UNSEEN, "the host is not told of a hand at the switch"
            robot.arm()
            await robot.drive(0.3, 0.0, 1.0)
            robot.disarm()
        else:
            robot.switch_power(Switch.ATX, True)
        await asyncio.sleep(2.0)
        assert robot.stop_state is Stop.STANDING


@pytest.mark.parametrize("settings", [ORIGINAL, WIRE], ids=["original", "ours"])
@pytest.mark.parametrize("v", [0.6, 1.0, 1.3])
async def test_a_stop_as_hard_as_the_loops_make_it_is_seen(settings: tuple[str, ...], v: float) -> None:
    async with robot_and_board(*settings) as (robot, _):
        for later in (0.0, 0.013, 0.026, 0.039):
            robot.arm()
            await drive(robot, v, 2.0 + later)
            robot.disarm()
            await asyncio.sleep(2.5)
            assert robot.stop_state is Stop.STANDING
            assert "fell faster" not in told(robot)


@pytest.mark.parametrize(
    ("before", "after", "since", "falls"),
    [
        (0.5, 0.0, 0.05, False),
        (0.51, 0.0, 0.05, True),
        (-0.51, 0.0, 0.05, True),
        (1.0, 0.0, 0.1, False),
        (1.01, 0.0, 0.1, True),
        (1.01, 0.5, 0.05, True),
        (-1.0, -0.5, 0.05, False),
        (0.5, 0.0, 0.001, False),  # a bunch
        (0.0, 1.0, 0.05, False),
    ],
)
def test_no_brakes_take_more_than_ten_metres_per_second_off_in_a_second(
    before: float, after: float, since: float, falls: bool
) -> None:
    assert fallen(before, after, since) is falls


# -- manual mode -----------------------------------------------------------------------------------------------

STOPS: dict[str, Callable[[Robot], None]] = {
    "disarm": Robot.disarm,
    "emergency stop": Robot.stop,
    "nobody commands": lambda robot: None,
}


@pytest.mark.parametrize("stop", STOPS.values(), ids=STOPS)
async def test_a_stop_that_an_original_board_in_manual_mode_ignores_is_made_one(stop: Callable[[Robot], None]) -> None:
    with pytest.raises(StopNotVerified, match=r"PWM test of zeros.*manual mode"):
        async with robot_and_board() as (robot, board):
            await drive(robot, 0.6, 2.0)
            board.happen(BoardEvent("centre"))
            await asyncio.sleep(0.15)
            robot.command(0.6, 0.0)
            await asyncio.sleep(0.05)
            stop(robot)
            took = await stands_within(board, 4.0)
            assert took > 0.5, "zeros alone do nothing"
            assert not robot.armed
            assert "does not stop" in told(robot)
            await asyncio.sleep(1.0)
            assert robot.stop_state is Stop.STANDING
            assert board.vehicle.esc_on, "a PWM test was enough"


async def test_at_the_end_of_a_run_too() -> None:
    board: Board | None = None
    with pytest.raises(StopNotVerified):
        async with robot_and_board() as (robot, board):
            await drive(robot, 0.6, 2.0)
            board.happen(BoardEvent("centre"))
            await asyncio.sleep(0.15)
            robot.command(0.6, 0.0)
    assert board is not None
    assert abs(board.vehicle.motion[3]) < 0.05


async def test_when_a_pwm_test_is_not_obeyed_either_the_esc_goes_off(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StopNotVerified, match="ESC off"):
        async with robot_and_board() as (robot, board):
            await drive(robot, 0.6, 2.0)
            vehicle = board.vehicle
            monkeypatch.setattr(vehicle, "command", lambda *counts: None)  # its outputs hang
            robot.stop()
            stopped = robot.now
            while vehicle.esc_on:
                await asyncio.sleep(0.01)
            assert 1.0 <= robot.now - stopped < 1.3
            await stands_within(board, 3.0)
            with pytest.raises(NotArmed, match="ESC is off"):
                robot.arm()
            assert robot.snapshot[MODE].power[:] == (None, False, False)
            raise StopNotVerified("ESC off")


def test_exit_code_4_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    power_up = Board.power_up

    async def with_somebody_at_the_button(board: Board) -> None:
        await power_up(board)
        asyncio.get_running_loop().call_later(6.0, board.happen, BoardEvent("centre"))

    words = ["run", "--port", "virtual", "--json", "--duration", "8", "--speed", "max", "--drive", "0.5,0"]
    words += [word for setting in ORIGINAL[1:] for word in ("--set", setting)]
    assert execute(words) == 0
    capsys.readouterr()
    monkeypatch.setattr(Board, "power_up", with_somebody_at_the_button)
    assert execute(words) == 4
    out, err = capsys.readouterr()
    assert "did not stop when told to" in err
    assert json.loads(out)["topics"]["/stop"] == "none", "the report is of the run, the stop came at its end"


async def test_an_error_on_the_way_is_the_cause_of_a_stop_that_was_none() -> None:
    with pytest.raises(StopNotVerified) as caught:
        async with robot_and_board() as (robot, board):
            await drive(robot, 0.6, 1.0)
            board.happen(BoardEvent("centre"))
            await asyncio.sleep(0.15)
            robot.command(0.6, 0.0)
            raise KeyError("of the program")
    assert isinstance(caught.value.__cause__, KeyError)


async def test_a_task_that_raised_is_the_cause_too() -> None:
    async def clumsy(ticks: Ticks) -> None:
        async for _ in ticks:
            raise ZeroDivisionError

    with pytest.raises(StopNotVerified) as caught:
        async with robot_and_board() as (robot, board):
            await drive(robot, 0.6, 1.0)
            board.happen(BoardEvent("centre"))
            await asyncio.sleep(0.15)
            robot.add_task("clumsy", 1.0, clumsy)
            await drive(robot, 0.6, 5.0)
    assert isinstance(caught.value.__cause__, TaskFault)


@pytest.mark.parametrize("cause", [HalError("the first cause"), KeyError("the first cause")])
def test_the_first_cause_is_told_first_and_the_exit_code_is_that_of_the_stop(
    cause: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(arguments: object) -> int:
        try:
            raise cause
        except Exception as first:
            raise StopNotVerified("the robot did not stop") from first

    monkeypatch.setattr("txt1.board.command.main", fails)
    assert execute(["board", "--tcp", ":0"]) == 4
    err = capsys.readouterr().err
    assert 0 < err.index("the first cause") < err.index("txt1: the robot did not stop")
    assert ("Traceback" in err) is isinstance(cause, KeyError)


# -- what is no fault ------------------------------------------------------------------------------------------


async def test_a_car_that_is_pushed_by_hand_is_told_of_and_keeps_its_esc() -> None:
    async with robot_and_board() as (robot, board):
        await drive(robot, 0.5, 1.0)
        robot.disarm()
        await asyncio.sleep(2.0)
        for _ in range(200):
            board.vehicle.state = board.vehicle.state._replace(v=0.5)
            await asyncio.sleep(0.01)
        assert robot.stop_state is Stop.UNASKED
        await asyncio.sleep(6.0)  # its loops had wound up against the hand
        assert robot.stop_state is Stop.STANDING
        assert board.vehicle.esc_on
        assert "without a command" in told(robot)
        robot.arm()


@pytest.mark.parametrize("settings", [WIRE, ORIGINAL], ids=["ours", "original"])
async def test_a_car_on_a_slope_stops_by_zeros(settings: tuple[str, ...]) -> None:
    slope = 0.35  # m/s^2: two degrees
    async with robot_and_board(*settings) as (robot, board):

        async def roll() -> None:
            while True:
                vehicle = board.vehicle
                if vehicle.motion[3]:
                    vehicle.state = vehicle.state._replace(v=vehicle.motion[3] + 0.01 * slope)
                await asyncio.sleep(0.01)

        rolling = asyncio.ensure_future(roll())
        await drive(robot, 0.5, 2.0)
        robot.disarm()
        await asyncio.sleep(4.0)
        rolling.cancel()
        assert "does not stop" not in told(robot)
        assert board.vehicle.esc_on


async def test_a_slow_car_is_no_fault() -> None:
    async with robot_and_board() as (robot, board):
        for v in (0.04, -0.04, 0.1):
            await drive(robot, v, 4.0)
            await robot.drive(0.0, 0.0, 1.0)
        assert robot.armed
        assert board.vehicle.esc_on
        assert "commanded and not moving" not in told(robot)


# -- commanded and not moving ----------------------------------------------------------------------------------


async def test_who_arms_again_at_once_has_the_same_time_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SerialHal, "clear_loops", lambda hal, now: None)  # as hardware whose loops do not wind up
    async with robot_and_board() as (robot, board):
        board.happen(BoardEvent("esc", 0.0))
        await asyncio.sleep(0.5)
        with pytest.raises(NotArmed, match="commanded and not moving"):
            await robot.drive(0.3, 0.0, 3.0)
        robot.arm()
        began = robot.now
        with pytest.raises(NotArmed, match="commanded and not moving"):
            await robot.drive(0.3, 0.0, 3.0)
        assert robot.now - began > 0.55


async def test_an_empty_battery_is_named_among_the_causes() -> None:
    async with robot_and_board() as (robot, board):
        board.happen(BoardEvent("battery", 9.2))
        board.happen(BoardEvent("esc", 0.0))
        await asyncio.sleep(10.0)
        with pytest.raises(NotArmed, match="commanded and not moving: battery empty, ESC off"):
            await robot.drive(0.4, 0.3, 3.0)


async def test_a_battery_that_cuts_the_encoders_off_is_named_too() -> None:
    with pytest.raises(StopNotVerified, match="look at it"):
        async with robot_and_board(*ORIGINAL, "sim.battery.used_1=49.0") as (robot, board):
            with pytest.raises(NotArmed, match="dead encoders; look at the robot; the battery is empty"):
                await robot.drive(0.4, 0.3, 300.0)
            assert board.vehicle.supply.cut_off


async def test_with_the_esc_left_off_the_robot_disarms_and_its_return_does_not_lurch() -> None:
    async with robot_and_board() as (robot, board):
        board.happen(BoardEvent("esc", 0.0))
        await asyncio.sleep(0.5)
        begun = robot.now
        with pytest.raises(NotArmed, match="commanded and not moving: ESC off, gains lost"):
            await robot.drive(0.4, 0.0, 5.0)
        assert robot.now - begun < 1.5
        assert robot.faults["commanded_not_moving"] == 1
        robot.switch_power(Switch.ESC, True)
        await asyncio.sleep(3.0)
        assert not board.vehicle.esc_on, "not before the loops are cleared"
        await asyncio.sleep(4.0)
        assert board.vehicle.esc_on
        robot.arm()
        fastest = 0.0
        for _ in range(60):
            robot.command(0.4, 0.0)
            await asyncio.sleep(0.05)
            fastest = max(fastest, abs(board.vehicle.motion[3]))
        assert 0.35 < fastest < 0.6


@asynccontextmanager
async def not_moving() -> AsyncIterator[tuple[Robot, Board]]:
    """A robot that has just disarmed, as its ESC was off when it was commanded."""
    async with robot_and_board() as (robot, board):
        board.happen(BoardEvent("esc", 0.0))
        await asyncio.sleep(0.5)
        with pytest.raises(NotArmed, match="commanded and not moving"):
            await robot.drive(0.8, 0.0, 5.0)
        yield robot, board


async def fastest_when_the_esc_comes_on(board: Board) -> float:
    """The largest speed, m/s, in the three seconds after somebody has switched the ESC on by hand."""
    board.happen(BoardEvent("esc", 1.0))
    fastest = 0.0
    for _ in range(150):
        await asyncio.sleep(0.02)
        fastest = max(fastest, abs(board.vehicle.motion[3]))
    return fastest


@pytest.mark.parametrize("later", [2.2, 4.0, 9.0])
async def test_an_esc_that_is_switched_on_by_hand_moves_nothing_as_the_loops_are_cleared(later: float) -> None:
    async with not_moving() as (robot, board):
        await asyncio.sleep(later)
        assert await fastest_when_the_esc_comes_on(board) == 0.0
        await asyncio.sleep(1.0)
        assert (robot.stop_state, robot.faults["link_lost"]) == (Stop.STANDING, 0)
        robot.arm()
        await robot.drive(0.4, 0.0, 2.0)
        assert board.vehicle.motion[3] == pytest.approx(0.4, abs=0.1)


async def test_without_that_silence_it_lurches_so_the_test_before_means_something(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(SerialHal, "clear_loops", lambda hal, now: None)
    async with not_moving() as (_, board):
        await asyncio.sleep(4.0)
        assert await fastest_when_the_esc_comes_on(board) > 0.4, "wound up, and disarmed"
        await asyncio.sleep(3.0)


@pytest.mark.parametrize("later", [0.02, 0.25, 0.5, 0.75, 1.0])
async def test_an_esc_that_comes_back_before_the_loops_are_cleared_moves_the_car_by_little(later: float) -> None:
    async with not_moving() as (_, board):
        await asyncio.sleep(later)
        began = board.vehicle.motion[0]
        assert await fastest_when_the_esc_comes_on(board) < 0.35
        assert abs(board.vehicle.motion[0] - began) < 0.15


async def test_without_zeros_in_that_silence_it_lurches_so_the_test_before_means_something(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fastest = 0.0
    with pytest.raises(StopNotVerified):
        async with not_moving() as (_, board):
            monkeypatch.setattr(SerialHal, "halt", lambda hal, outputs, now: None)
            await asyncio.sleep(0.25)
            fastest = await fastest_when_the_esc_comes_on(board)
    assert fastest > 0.4


async def test_while_the_loops_are_cleared_it_is_stopped_but_not_armed() -> None:
    async with not_moving() as (robot, board):
        for wait in (0.0, 0.5):
            await asyncio.sleep(wait)
            with pytest.raises(NotArmed, match="silence clears the board's loops"):
                robot.arm()
        robot.stop()
        assert (robot.armed, robot.reason) == (False, "emergency stop")
        assert 0.05 < await fastest_when_the_esc_comes_on(board) < 0.35, "it came back too soon"
        assert not board.vehicle.esc_on
        assert "the ESC came back before the board's loops were cleared: it is switched off" in told(robot)
        await asyncio.sleep(4.0)
        assert robot.reason == "emergency stop", "which stays until somebody arms"
        robot.switch_power(Switch.ESC, True)
        await asyncio.sleep(4.0)
        robot.arm()
        await robot.drive(0.4, 0.0, 2.0)


async def test_a_board_as_ours_falls_silent_while_its_loops_are_cleared_and_comes_back() -> None:
    async with robot_and_board(*WIRE) as (robot, board):
        vehicle = board.vehicle
        moves = vehicle.dynamics
        vehicle.dynamics = (*moves[:3], 0.0, *moves[4:])  # no speed for any motor output
        with pytest.raises(NotArmed, match="wheel blocked"):
            await robot.drive(0.3, 0.0, 5.0)
        await asyncio.sleep(6.0)
        assert (robot.stop_state, robot.faults["link_lost"], vehicle.esc_on) == (Stop.STANDING, 0, True)
        vehicle.dynamics = moves
        robot.arm()
        await robot.drive(0.4, 0.0, 2.0)
        assert vehicle.motion[3] == pytest.approx(0.4, abs=0.05)


async def test_a_blocked_wheel_disarms_with_its_causes() -> None:
    async with robot_and_board() as (robot, board):
        vehicle = board.vehicle
        vehicle.dynamics = (*vehicle.dynamics[:3], 0.0, *vehicle.dynamics[4:])  # no speed for any motor output
        with pytest.raises(NotArmed, match="wheel blocked"):
            await robot.drive(0.3, 0.0, 5.0)


# -- encoders that lie to an original board, which does not notice -------------------------------------------------


async def test_an_encoder_that_falls_silent_on_the_board_is_noticed_by_the_host() -> None:
    async with robot_and_board() as (robot, board):
        await drive(robot, 0.6, 2.0)
        board.vehicle.faults = replace(board.vehicle.faults, right_encoder=True)
        with pytest.raises(NotArmed, match="the right encoder is silent"):
            await robot.drive(0.6, 0.0, 5.0)
        await stands_within(board, 3.0)


async def test_an_encoder_that_counts_backwards_is_noticed_and_costs_the_esc() -> None:
    with pytest.raises(StopNotVerified, match="ESC off"):
        async with robot_and_board() as (robot, board):
            await drive(robot, 0.6, 2.0)
            hal = board.runtime.hal
            read = hal.read

            def reversed_left(now: float) -> Inputs:
                inputs = read(now)
                return inputs if inputs.ticks is None else inputs._replace(ticks=(inputs.ticks[0], -inputs.ticks[1]))

            hal.read = reversed_left  # type: ignore[method-assign]
            with pytest.raises(NotArmed, match="against each other"):
                await robot.drive(0.6, 0.0, 5.0)
            await stands_within(board, 4.0)
            assert not board.vehicle.esc_on


async def test_slow_curves_in_which_the_inner_wheel_reads_0_are_no_runaway() -> None:
    async with robot_and_board() as (robot, _):
        for v in (0.05, 0.08, 0.11, -0.05, -0.1):
            await robot.drive(v, abs(v) / 0.56, 3.0)
        assert robot.armed


# -- restarts --------------------------------------------------------------------------------------------------


async def test_a_restart_at_rest_far_from_the_origin_is_noticed() -> None:
    async with robot_and_board() as (robot, board):
        await robot.drive(0.3, 0.0, 1.0)
        await robot.drive(0.0, 0.0, 2.0)
        assert 0.1 < robot.odometry.x < 0.4
        board.happen(BoardEvent("restart", 0.2))
        await asyncio.sleep(0.4)
        assert not robot.armed
        assert "restarted" in robot.reason
        await asyncio.sleep(3.0)
        assert robot.runtime.state.gains.loaded, "they were sent again"


async def test_a_restart_at_the_origin_cannot_be_told_from_a_pause_and_disarms() -> None:
    async with robot_and_board() as (robot, board):
        await asyncio.sleep(3.0)
        board.happen(BoardEvent("restart", 0.2))
        await asyncio.sleep(0.4)
        assert not robot.armed
        assert "may have restarted" in robot.reason


@pytest.mark.parametrize("v", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(
    "pause", [0.005, 0.1, 0.4, 3.0, *(pytest.param(s, marks=pytest.mark.long) for s in (0.2, 60.0))]
)
async def test_a_restart_is_noticed_whatever_its_pause_at_rest_and_in_motion(pause: float, v: float) -> None:
    with suppress(StopNotVerified):  # nobody sees the robot stand while its board has no power
        async with robot_and_board() as (robot, board):
            await robot.drive(0.5, 0.0, 1.5)
            await drive(robot, v, 1.5)
            assert robot.armed
            board.happen(BoardEvent("restart", pause))
            await asyncio.sleep(min(pause, 0.5) + 0.2)
            assert not robot.armed
            assert "restarted" in robot.reason or "no odometry" in robot.reason
            await asyncio.sleep(pause + 2.0)
            assert abs(robot.odometry.x) < 0.8, "the odometry begins anew where the board's does"


async def test_a_restart_shorter_than_any_gap_is_noticed_by_the_battery_filter() -> None:
    async with robot_and_board() as (robot, board):
        await asyncio.sleep(6.0)
        board.happen(BoardEvent("restart", 0.01))
        await asyncio.sleep(1.2)
        assert not robot.armed
        assert "battery filter" in robot.reason


async def test_a_pack_that_is_pulled_out_or_a_low_one_is_no_restart() -> None:
    async with robot_and_board() as (robot, board):
        await asyncio.sleep(6.0)
        for volts in (9.3, 0.0, 12.0):
            board.vehicle.faults = replace(board.vehicle.faults, voltage=volts)
            await asyncio.sleep(4.0)
        assert "restarted" not in told(robot)


async def test_gains_that_were_lost_unnoticed_come_back_while_velocity_is_zero_only() -> None:
    async with robot_and_board() as (robot, board):
        assert board.original is not None
        await drive(robot, 0.3, 0.5)
        await robot.drive(0.0, 0.0, 1.0)
        gains, board.runtime.state.gains = board.runtime.state.gains, type(board.runtime.state.gains)()
        await asyncio.sleep(12.0)
        assert board.runtime.state.gains == gains
        board.runtime.state.gains = type(gains)()
        for _ in range(30):
            with suppress(NotArmed):
                await robot.drive(0.3, 0.0, 0.5)
        assert board.runtime.state.gains != gains
        assert not robot.armed, "commanded and not moving"
