"""Runs the gamepads' process beside a robot."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import asdict

from txt1.bridges.registry import bridge
from txt1.gamepad.pad import PadParameters
from txt1.robot import Robot


@asynccontextmanager
async def beside(robot: Robot, pad: PadParameters) -> AsyncIterator[None]:
    """Let gamepads drive until the block is left."""
    async with bridge(robot, "gamepad", asdict(pad) | {"hand": robot.config.hand()._asdict()}):
        yield
