"""A robot in a fleet on a network."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from txt1.bridges.registry import bridge
from txt1.fleet.link import FleetLink
from txt1.fleet.options import Joining
from txt1.robot import Key, Robot


@asynccontextmanager
async def beside(robot: Robot, joining: Joining) -> AsyncIterator[None]:
    """Take part in the fleet within the block; x, and a page's stop, stop all robots. Raises ConfigError."""
    link = FleetLink(robot)
    robot.runtime.parts.append(link)
    robot.requests["stop"] = link.stop_all
    robot.keys["x"] = Key("stop all", link.stop_all)
    robot.alongside.append(link.refused)
    robot.unfinished.append(link.unfinished)
    async with bridge(robot, "fleet", joining.bridge, link.requests):
        if joining.law is not None:
            link.cooperate(joining.law, joining.team or ())
        yield
