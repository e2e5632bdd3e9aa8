"""What `txt1 board --event` lets happen to encoders, one by one."""

from __future__ import annotations

from typing import Any

import pytest

from txt1.board.command import board_event
from txt1.config import load
from txt1.robot import Robot

ENDLESS = ("sim.room.length=.inf", "sim.room.width=.inf")


@pytest.mark.parametrize("habits", ["ours", "original"])
@pytest.mark.parametrize("side", [0, 1], ids=["right", "left"])
async def test_one_encoder_is_lost_and_counts_again(habits: str, side: int) -> None:
    name = ("right", "left")[side]
    given = ["hal=serial", "serial.port=virtual", f"board.habits={habits}", "seed=1", *ENDLESS]
    async with Robot.open(config=load(None, given).config, arm=True) as robot:
        hal: Any = robot.hal
        board = hal.port.board
        await robot.load_gains()
        await robot.drive(0.4, 0.0, 2.0)

        def counted(before: tuple[int, int] = (0, 0)) -> tuple[int, int]:
            right, left = board.vehicle.encoder_counts()
            return right - before[0], left - before[1]

        time, event = board_event(f"12.5:{name}_encoder=off")
        assert time == 12.5
        board.happen(event)
        at = counted()
        await robot.drive(0.4, 0.0, 0.1)
        lost = counted(at)
        assert lost[side] == 0 and lost[1 - side] > 20
        board.happen(board_event(f"20:{name}_encoder=on")[1])
        at = counted()
        await robot.drive(0.4, 0.0, 0.1)
        assert min(counted(at)) > 20
