"""A source of commands: it drives in a circle."""

from __future__ import annotations

import asyncio

from txt1 import Robot


async def steer(robot: Robot) -> None:
    source = robot.source("circler")
    while True:
        source.command(0.5, 0.5)
        await asyncio.sleep(0.05)
