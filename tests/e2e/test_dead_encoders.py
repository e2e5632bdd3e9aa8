"""Encoders that lose their power while the car drives: it is stopped within a metre, past loops that do not see it."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import pytest

from benchmarks.board_faults import BOARDS, lose_encoders, lose_simulated_encoders
from tests.examples import some
from txt1.board.board import Board, BoardEvent
from txt1.errors import NotArmed, Overruled, StopNotVerified
from txt1.protocol.messages import Switch
from txt1.robot import Robot


@pytest.mark.parametrize("later", some(0.0, rest=(0.013, 0.026, 0.039)))
@pytest.mark.parametrize("v", some(0.1, 1.0, -0.6, rest=(0.3, 0.6)))
@pytest.mark.parametrize("board", BOARDS)
async def test_it_goes_less_than_a_metre_and_the_esc_is_off(board: str, v: float, later: float) -> None:
    lost = await lose_encoders(board, v, "encoders", later)
    assert lost.course.way < 1.0
    assert lost.course.fastest < 1.9
    assert not lost.esc
    assert "not seen any more" in lost.reason


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("v", some(1.0, rest=(0.1, 0.3, 0.6)))
@pytest.mark.parametrize("board", BOARDS)
async def test_of_one_encoder_alone_it_stops_by_the_other(board: str, v: float, side: str) -> None:
    lost = await lose_encoders(board, v, f"{side}_encoder", 0.0)
    assert lost.course.way < 1.0
    assert lost.reason == f"runaway: the {side} encoder is silent"


@pytest.mark.parametrize("v", some(0.1, 1.0, rest=(0.3, 0.6)))
async def test_loops_in_this_host_stop_it_as_soon(v: float) -> None:
    lost = await lose_simulated_encoders(v, 0.0)
    assert lost.course.way < 0.55
    assert "not seen any more" in lost.reason


async def test_the_way_back_is_to_look_at_it_to_switch_the_esc_on_and_to_arm() -> None:
    async def go_on(robot: Robot, board: Board) -> None:
        with pytest.raises(NotArmed, match="switch the ESC on first"):
            robot.arm()
        board.happen(BoardEvent("encoders", 1.0))
        robot.switch_power(Switch.ESC, True)
        await asyncio.sleep(4.0)
        robot.arm()
        await robot.drive(0.4, 0.0, 2.0)
        assert board.vehicle.motion[3] == pytest.approx(0.4, abs=0.1)

    await lose_encoders("original", 0.6, "encoders", 0.0, go_on)


async def test_encoders_that_are_still_dead_are_noticed_at_the_next_start() -> None:
    async def go_on(robot: Robot, board: Board) -> None:
        robot.switch_power(Switch.ESC, True)
        await asyncio.sleep(4.0)
        robot.arm()
        x = board.vehicle.motion[0]
        with pytest.raises(NotArmed, match="commanded and not moving"):
            await robot.drive(0.6, 0.0, 2.0)
        await asyncio.sleep(4.0)
        assert board.vehicle.motion[0] - x < 3.0, "6.5 m when it took a second"

    await lose_encoders("original", 0.6, "encoders", 0.0, go_on)


async def test_a_robot_that_was_lost_sight_of_is_never_called_standing() -> None:
    async def look(robot: Robot, board: Board) -> None:
        assert robot.stop_state == "not seen"
        assert "not seen to stand" in robot.trouble

    await lose_encoders("original", 1.0, "encoders", 0.0, look)


@pytest.mark.parametrize("v", some(0.6, rest=(0.3, 1.0)))
@pytest.mark.parametrize("board", BOARDS)
async def test_at_a_wall_it_is_stopped_too_and_drives_back(board: str, v: float) -> None:
    settings = (*BOARDS[board], "sim.room.length=4", "sim.room.width=4")
    with suppress(StopNotVerified):
        async with Robot.open("serial", settings=settings, seed=1, arm=True) as robot:
            await robot.load_gains()
            at: Board = robot.hal.port.board  # type: ignore[attr-defined]
            with pytest.raises((NotArmed, Overruled)):
                await robot.drive(v, 0.0, 20.0)
            assert robot.armed or "wall" in robot.reason
            await asyncio.sleep(4.0)
            if not at.vehicle.esc_on:
                robot.switch_power(Switch.ESC, True)
                await asyncio.sleep(5.0)
            robot.arm()
            x = at.vehicle.motion[0]
            await robot.drive(-0.3, 0.0, 2.0)
            assert at.vehicle.motion[0] < x - 0.3
