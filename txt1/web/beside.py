"""The web page beside a robot."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from txt1.bridges.registry import bridge
from txt1.bridges.services import services
from txt1.robot import Robot
from txt1.web.options import PageAsked


@asynccontextmanager
async def beside(robot: Robot, asked: PageAsked) -> AsyncIterator[None]:
    """Serve the page as long as the block is at work; what other additions offer stands before what it can itself."""

    def stop() -> None:
        robot.requests.get("stop", robot.stop)()

    async with services(robot, asked.speed, asked.page.folder) as requests:
        name, given = asked.page.bridge()
        async with bridge(robot, name, given, {**requests, "stop": stop}):
            yield
