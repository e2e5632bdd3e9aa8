"""One trial from its seed, on the running robot."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from txt1.config import Config
from txt1.errors import ConfigError, HalError, NotArmed, Overruled, Txt1Error
from txt1.kernel.loop import Speed, run
from txt1.learning.agent import Agent
from txt1.learning.agents import make
from txt1.learning.qtable import StoredTable
from txt1.learning.task import LearningTask, need_light, task_of
from txt1.learning.trial import COMMANDS, Episode, Trial, starts
from txt1.record.session import recording
from txt1.robot import Robot
from txt1.sensors.light import STREAM

STARTS, ROBOT, SENSORS, AGENT = 1, 2, STREAM, 4
"""Streams of random numbers of a trial; the first is `txt1.learning.trial.starts`'s own."""

MARGIN = 1.0
"""The walls stand so much beyond the boundary, m: the body's half, and room to stop."""

BEGIN_MS = 4000
"""A trial in simulation begins at this instant, ms; by then the robot is ready."""


@dataclass
class Outcome:
    """What came of a trial.

    Attributes:
        trial: its number, from 1.
        episodes: those that were completed.
        complete: whether that is all of them.
        table: what was learned.
        memory: with which the agent can carry on.
        paths: by the episode's number, (x, y) in m 20 times a second.
        voided: episodes that were broken off by a disarm and done again.

    """

    trial: int
    episodes: list[Episode]
    complete: bool
    table: StoredTable
    memory: dict[str, Any]
    paths: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    voided: int = 0


def stream(seed: int, trial: int, which: int) -> np.random.Generator:
    """One of a trial's streams of random numbers."""
    return np.random.default_rng(np.random.SeedSequence([seed, trial, which]))


def ready_to_learn(config: Config) -> Config:
    """The configuration with a simulated room that holds the boundary, and batteries that outlast the trial.

    The external supply feeds the simulated robot: a trial can take longer than a pack lasts, and whoever learns on the
    real robot changes them.
    """
    side = 2.0 * (config.learning.boundary + MARGIN)
    sim = config.sim
    room = sim.room.model_copy(update={"length": max(side, sim.room.length), "width": max(side, sim.room.width)})
    battery = replace(sim.battery, used_1=None, used_2=None)
    return config.model_copy(update={"sim": sim.model_copy(update={"room": room, "battery": battery})})


def robot_config(config: Config, seed: int, trial: int) -> Config:
    """The configuration of a trial's own robot."""
    own = int(stream(seed, trial, ROBOT).integers(2**32))
    return ready_to_learn(config).model_copy(update={"seed": own})


def new_trial(
    agent: Agent,
    config: Config,
    seed: int,
    number: int,
    episodes: int,
    done: Callable[[Episode], None] = lambda _: None,
    keep_paths: Collection[int] = (),
    commands: tuple[tuple[float, float], ...] = COMMANDS,
) -> Trial:
    """A trial that has not begun."""
    return Trial(agent, task_of(config), starts(seed, number, episodes), commands, done, keep_paths)


def recorded_plan(name: str, seed: int, number: int, episodes: int) -> dict[str, object]:
    """What the recording of a trial says that it is."""
    return {"learn": name, "seed": seed, "trial": number, "episodes": episodes}


def on_robot(
    learner: Agent | str,
    config: Config,
    seed: int,
    number: int,
    episodes: int,
    *,
    speed: Speed = "max",
    arm: bool = False,
    done: Callable[[Episode], None] = lambda _: None,
    commands: tuple[tuple[float, float], ...] = COMMANDS,
    keep_paths: Collection[int] = (),
    stopped: Callable[[], bool] = lambda: False,
    before: Outcome | None = None,
    keep: Callable[[Outcome], None] = lambda _: None,
    log: Path | None = None,
) -> Outcome:
    """A trial through the robot's real tasks.

    Where nobody is there to arm the robot again, a disarm ends it.

    Args:
        learner: who learns, or its name.
        config: of everything.
        seed: with the trial's number, repeats every random value.
        number: of the trial, from 1.
        episodes: how many.
        speed: of its time, see `txt1.kernel.loop.run`.
        arm: whether to arm a robot that does not arm by itself.
        done: told each episode as it ends.
        commands: (v, omega) of each action, m/s and rad/s.
        keep_paths: numbers of the episodes whose paths are to be kept.
        stopped: asked all the time; once it says yes the trial ends.
        before: what came of this trial when it was broken off, and from which it carries on; None: from scratch.
        keep: given what has come of it when it ends; with an error, too, if an episode was completed.
        log: the file to record it to.

    Raises:
        HalError: the hardware cannot be used, or there are no light sensors.
        NotArmed: the robot was disarmed.
        Overruled: another source of commands took the wheel.
        TaskFault: a task failed; the robot was stopped first.

    """
    agent = make(learner, config, stream(seed, number, AGENT)) if isinstance(learner, str) else learner
    trial = new_trial(agent, config, seed, number, episodes, done, keep_paths, commands)
    if before is not None:
        agent.recall(before.memory)
        trial.carry_on(before.episodes, before.paths, before.voided)

    own, told = robot_config(config, seed, number), recorded_plan(agent.name, seed, number, episodes)

    async def conduct() -> None:
        async with (
            recording(log, own, speed, told, lambda text: print(f"txt1: {text}", file=sys.stderr)) as attach,
            Robot.open(config=own, patience=0.0, attach=attach) as robot,
        ):
            await need_light(robot, [seed, number, SENSORS])
            await _get_ready(robot, arm)
            learning = LearningTask(
                robot, trial, stopped=lambda: stopped() or not (robot.armed or robot.arms_again)
                or bool(learning.overruled), observer=robot.runtime.witness,
            )  # fmt: skip
            learning.start()
            await learning.ended.wait()
            if learning.overruled:
                raise Overruled("learner", learning.overruled)
            if len(trial.episodes) < episodes and not stopped():
                raise NotArmed(robot.reason)

    try:
        run(conduct(), speed=speed)
    except Txt1Error:
        trial.void()
        if trial.episodes:
            keep(outcome(trial, number, episodes))
        raise
    came = outcome(trial, number, episodes)
    keep(came)
    return came


async def _get_ready(robot: Robot, arm: bool) -> None:
    """Wait for the link, arm, load the gains."""
    await robot.linked(10.0)
    if not (arm or robot.arms_by_itself):
        raise ConfigError("nobody is there to arm the robot while it learns: add --arm")
    robot.arm()
    if not await robot.load_gains():
        raise HalError("the board did not acknowledge the gains; 'txt1 doctor' looks closer")
    if robot.hal.capabilities.place:  # always at the same instant
        await asyncio.sleep(max(0.0, BEGIN_MS / 1000.0 - 0.001 - robot.now))


def outcome(trial: Trial, number: int, episodes: int) -> Outcome:
    """What came of a trial."""
    done = trial.episodes
    complete = len(done) == episodes
    agent = trial.agent
    return Outcome(number, done, complete, agent.table(), agent.memory(), trial.paths, trial.voided)
