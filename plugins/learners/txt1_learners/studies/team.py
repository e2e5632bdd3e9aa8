"""A team of simulated robots that learn together in one process, each in a world of its own."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack

from txt1 import Robot
from txt1.config import Config
from txt1.learning.registry import make
from txt1.learning.settings import LearningConfig
from txt1.learning.task import LearningTask, need_light
from txt1.learning.trial import AGENT, SENSORS, Episode, Trial, robot_config, starts, stream, task_of
from txt1_learners.sharing import Sharer, Sharing, sharer

Join = Callable[[str, Sharer], Sharing]  # the part of the robot of a name in learning together


async def learn_together(
    config: Config, seed: int, names: list[str], episodes: int, join: Join | None, learner: str = "thesis"
) -> dict[str, list[Episode]]:
    """Each robot's episodes; `join` None: each learns by itself."""
    trials: dict[str, Trial] = {}
    async with AsyncExitStack() as stack:
        ended = []
        for number, name in enumerate(names, start=1):
            agent = make(learner, config, stream(seed, number, AGENT))
            trial = Trial(
                agent, task_of(config), starts(seed, number, episodes), config.section(LearningConfig).actions
            )
            if join is not None:
                join(name, sharer(learner, agent)).accompany(trial)
            own = robot_config(config, seed, number).model_copy(update={"name": name})
            robot = await stack.enter_async_context(Robot.open(config=own, arm=True))
            await need_light(robot, [seed, number, SENSORS])
            await robot.load_gains()
            learning = LearningTask(robot, trial)
            learning.start()
            trials[name] = trial
            ended.append(learning.ended.wait())
        await asyncio.gather(*ended)
    return {name: trial.episodes for name, trial in trials.items()}
