"""Serves the web page beside a robot."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from txt1.bridges.registry import bridge
from txt1.bridges.services import services
from txt1.robot import Key, Robot
from txt1.web.options import PageAsked


@asynccontextmanager
async def beside(robot: Robot, asked: PageAsked) -> AsyncIterator[None]:
    """Serve the page until the block is left.

    If an addition offers the request "stop", as a fleet does, it replaces the robot's own stop.

    The event log shows the page's addresses, and shows them again on the key p.
    """

    def stop() -> None:
        robot.requests.get("stop", robot.stop)()

    def tell() -> None:
        robot.tell(f"the page is at {'  '.join(asked.page.places)}")

    robot.keys["p"] = Key("page", tell)
    async with services(robot, asked.speed, asked.page.folder) as requests:
        name, given = asked.page.bridge()
        async with bridge(robot, name, given, {**requests, "stop": stop}):
            tell()
            yield
