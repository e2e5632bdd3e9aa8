"""Serves the web page beside a robot."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from txt1.bridges.registry import bridge
from txt1.bridges.services import services
from txt1.commands import say
from txt1.robot import Key, Robot
from txt1.sensors.readings import Image
from txt1.sidecar import NICENESS, Sidecar
from txt1.tasks.fields import PAGE
from txt1.web.options import PageAsked, free_or_any


@asynccontextmanager
async def beside(robot: Robot, asked: PageAsked) -> AsyncIterator[None]:
    """Serve the page until the block is left.

    If an addition offers the request "stop", as a fleet does, it replaces the robot's own stop.

    When the page answers, its addresses are told, and the header of the screens shows the first of them as long as it
    answers; the key p tells them again.
    """
    places = "  ".join(asked.page.places)

    def stop() -> None:
        robot.requests.get("stop", robot.stop)()

    def tell() -> None:
        answers = server is not None and server.answers
        robot.tell(f"the page is at {places}" if answers else f"the page does not answer yet; it will be at {places}")

    def ready() -> None:
        robot.tell(f"the page is at {places}")
        if asked.printed:
            say(f"the page is at {places}")

    server: Sidecar | None = None
    robot.keys["p"] = Key("page", tell)
    robot.runtime.bus.offer(PAGE, lambda: asked.page.places[0] if server is not None and server.answers else None)
    name, given = asked.page.bridge()
    async with AsyncExitStack() as stack:
        requests = await stack.enter_async_context(services(robot, asked.speed, asked.page.folder))
        if cameras := cameras_of(robot):
            port = await asyncio.to_thread(free_or_any, asked.page.host, asked.page.port + 1)
            given["camera"] = port
            pictures = asked.page.camera_bridge(port, cameras)
            await stack.enter_async_context(bridge(robot, *pictures, niceness=NICENESS))
        server = await stack.enter_async_context(bridge(robot, name, given, {**requests, "stop": stop}, ready=ready))
        yield


def cameras_of(robot: Robot) -> list[str]:
    """Return the names of the sensors that give pictures."""
    return [name for name, each in robot.sensors.items() if each.sensor.topic.type is Image]
