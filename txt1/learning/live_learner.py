"""The learning task on a robot that an operator may watch and stop."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from txt1.learning.options import Learner, learning_together
from txt1.learning.task import need_light, start
from txt1.robot import Robot


@asynccontextmanager
async def beside(robot: Robot, learner: Learner) -> AsyncIterator[None]:
    """Let the learner drive as soon as the robot is ready; raises HalError: there are no light sensors."""
    await need_light(robot)

    async def begin() -> None:
        if learner.share is None:
            start(robot, learner.agent)
            return
        sharing = learning_together().of_robot(robot, str(learner.name), learner.agent, learner.share)
        await sharing.joined()
        sharing.accompany(start(robot, learner.agent).trial)

    robot.on_ready.append(begin)
    yield
