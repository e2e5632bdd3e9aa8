"""Encoders that lose their power while the car drives: it is stopped within a metre, past loops that do not see it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from math import hypot
from typing import NamedTuple

import pytest

from tests.e2e.conftest import ENDLESS
from txt1.board.board import Board, BoardEvent
from txt1.errors import NotArmed, Overruled, StopNotVerified
from txt1.protocol.messages import Switch
from txt1.robot import Robot

WIRE = ("serial.port=virtual", *ENDLESS)
BOARDS = {
    "ours": WIRE,
    # its loops spin the wheels of a car with less grip
    "original": (*WIRE, "board.habits=original", "sim.vehicle.grip=2"),
}
SIDES = {"both": "encoders", "right": "right_encoder", "left": "left_encoder"}


class Seen(NamedTuple):
    """The true way since the loss (m), the largest speed (m/s), whether the ESC is on, and why it was disarmed."""

    way: float
    fastest: float
    esc: bool
    reason: str


async def lose(
    settings: tuple[str, ...], v: float, lost: str, later: float, then: Callable[[Robot, Board], Awaitable[None]]
) -> Seen:
    """Drive, let the encoders go, watch for four seconds, and do something then."""
    seen: Seen | None = None
    with suppress(StopNotVerified):
        async with Robot.open("serial", settings=settings, seed=1, arm=True) as robot:
            await robot.load_gains()
            board: Board = robot.hal.port.board  # type: ignore[attr-defined]
            await robot.drive(v, 0.0, 2.0 + later)
            driving = asyncio.ensure_future(robot.drive(v, 0.0, 4.0))
            board.happen(BoardEvent(SIDES[lost], 0.0))
            vehicle = board.vehicle
            x, y = vehicle.motion[:2]
            way = fastest = 0.0
            for _ in range(400):
                await asyncio.sleep(0.01)
                vehicle.advance_to(board.now)
                way += hypot(vehicle.motion[0] - x, vehicle.motion[1] - y)
                x, y = vehicle.motion[:2]
                fastest = max(fastest, abs(vehicle.motion[3]))
            with pytest.raises(NotArmed):
                await driving
            seen = Seen(way, fastest, vehicle.esc_on, robot.reason)
            await then(robot, board)
    assert seen is not None
    return seen


async def nothing(robot: Robot, board: Board) -> None:
    """Let it end."""


@pytest.mark.parametrize("later", [0.0, 0.013, 0.026, 0.039])
@pytest.mark.parametrize("v", [0.1, 0.3, 0.6, 1.0, -0.6])
@pytest.mark.parametrize("board", BOARDS)
async def test_it_goes_less_than_a_metre_and_the_esc_is_off(board: str, v: float, later: float) -> None:
    seen = await lose(BOARDS[board], v, "both", later, nothing)
    assert seen.way < 1.0
    assert seen.fastest < 1.9
    assert not seen.esc
    assert "not seen any more" in seen.reason


@pytest.mark.parametrize("lost", ["right", "left"])
@pytest.mark.parametrize("v", [0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("board", BOARDS)
async def test_of_one_encoder_alone_it_stops_by_the_other(board: str, v: float, lost: str) -> None:
    seen = await lose(BOARDS[board], v, lost, 0.0, nothing)
    assert seen.way < 1.0
    assert seen.reason == f"runaway: the {lost} encoder is silent"


@pytest.mark.parametrize("v", [0.1, 0.3, 0.6, 1.0])
async def test_loops_in_this_host_stop_it_as_soon(v: float) -> None:
    async with Robot.open("sim", settings=ENDLESS, seed=1, arm=True) as robot:
        await robot.load_gains()
        await robot.drive(v, 0.0, 2.0)
        vehicle = robot.hal.vehicle  # type: ignore[attr-defined]
        vehicle.atx_on = False
        x = vehicle.motion[0]
        with pytest.raises(NotArmed, match="not seen any more"):
            await robot.drive(v, 0.0, 4.0)
        await asyncio.sleep(3.0)
        assert vehicle.motion[0] - x < 0.55


async def test_the_way_back_is_to_look_at_it_to_switch_the_esc_on_and_to_arm() -> None:
    async def go_on(robot: Robot, board: Board) -> None:
        with pytest.raises(NotArmed, match="the ESC is off: switch it on first"):
            robot.arm()
        board.happen(BoardEvent("encoders", 1.0))
        robot.switch_power(Switch.ESC, True)
        await asyncio.sleep(4.0)
        robot.arm()
        await robot.drive(0.4, 0.0, 2.0)
        assert board.vehicle.motion[3] == pytest.approx(0.4, abs=0.1)

    await lose(BOARDS["original"], 0.6, "both", 0.0, go_on)


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

    await lose(BOARDS["original"], 0.6, "both", 0.0, go_on)


async def test_a_robot_that_was_lost_sight_of_is_never_called_standing() -> None:
    async def look(robot: Robot, board: Board) -> None:
        assert robot.stop_state == "not seen"
        assert "not seen to stand" in robot.trouble

    await lose(BOARDS["original"], 1.0, "both", 0.0, look)


@pytest.mark.parametrize("v", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("board", BOARDS)
async def test_at_a_wall_it_is_stopped_too_and_drives_back(board: str, v: float) -> None:
    settings = ("serial.port=virtual", "sim.room.length=4", *BOARDS[board][len(WIRE) :])
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
