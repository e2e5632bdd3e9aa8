"""Learning, or driving by what was learned, while the robot runs under an operator's eyes (`txt1 run`)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from txt1.config import Config
from txt1.learning.agent import Agent
from txt1.learning.agents import from_table, make
from txt1.learning.seeding import AGENT, new_trial, stream
from txt1.learning.task import LearningTask
from txt1.learning.trial import Episode
from txt1.navigation import PoseSource
from txt1.robot import Robot

EPISODES: Final = 10_000  # more than anybody will watch

FROM_WALL: Final = 0.5  # the boundary is at least so far inside the simulated room's walls, m


def agent_of(config: Config, learn: str | None, policy: Path | None) -> Agent | None:
    """The learner of this name, or one that drives by the table in this file; None for neither.

    Raises ConfigError: there is no learner of that name; QTableError: the file is no sound table.
    """
    rng = stream(config.own_seed, 1, AGENT)
    if policy is not None:
        return from_table(policy, config, rng)
    return None if learn is None else make(learn, config, rng)


def start(robot: Robot, agent: Agent, pose: PoseSource | None = None, episodes: int = EPISODES) -> LearningTask:
    """The learning task, at work beside the robot's others.

    The robot has its gains and light sensors (see `txt1.learning.task.need_light`); `pose` None: as configured.
    """
    config = robot.config
    if robot.hal.capabilities.place:
        room = config.sim.room
        boundary = min(config.learning.boundary, 0.5 * min(room.length, room.width) - FROM_WALL)
        config = config.model_copy(update={"learning": config.learning.model_copy(update={"boundary": boundary})})

    def tell(one: Episode) -> None:
        how = "reached the light" if one.success else "lost the light"
        robot.tell(f"episode {one.number}: {how} after {one.time:.1f} s, best possible {one.optimal_time:.1f} s")

    trial = new_trial(agent, config, config.own_seed, 1, episodes, tell)
    task = LearningTask(robot, trial, pose)
    task.start()
    return task
