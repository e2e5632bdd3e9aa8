"""The learning task on a robot that an operator may watch and stop."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from txt1.learning.options import Learner
from txt1.learning.sharing import Exchange, Sharing, sharer
from txt1.learning.task import need_light, start
from txt1.robot import Robot


@asynccontextmanager
async def beside(robot: Robot, learner: Learner) -> AsyncIterator[None]:
    """Let the learner drive as soon as the robot is ready; raises HalError: there are no light sensors."""
    await need_light(robot)

    async def begin() -> None:
        sharing = None
        if learner.share is not None:
            exchange = next((part for part in robot.runtime.parts if isinstance(part, Exchange)), None)
            # the options make sure that the robot is in a fleet
            assert exchange is not None
            sharing = Sharing(sharer(str(learner.name), learner.agent), exchange, learner.share, tell=robot.tell)
            await sharing.joined()
        start(robot, learner.agent, sharing=sharing)

    robot.on_ready.append(begin)
    yield
