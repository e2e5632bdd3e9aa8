"""Runs bridges by name beside a robot."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from txt1.bridges.options import BridgesAsked
from txt1.bridges.registry import bridge
from txt1.bridges.services import FOLDER, services
from txt1.robot import Robot


@asynccontextmanager
async def beside(robot: Robot, asked: BridgesAsked) -> AsyncIterator[None]:
    """Run the bridges until the block is left."""
    async with AsyncExitStack() as stack:
        requests = await stack.enter_async_context(services(robot, asked.speed, FOLDER))
        for name, given in asked.bridges:
            await stack.enter_async_context(bridge(robot, name, given, requests))
        yield
