"""Everything of a trial that its seed decides: its random streams, its robot, its starts; and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from txt1.config import Config
from txt1.learning.agent import Agent
from txt1.learning.qtable import StoredTable
from txt1.learning.task import task_of
from txt1.learning.trial import COMMANDS, Episode, Trial, starts
from txt1.sensors.light import STREAM

STARTS, ROBOT, SENSORS, AGENT = 1, 2, STREAM, 4
"""Streams of random numbers of a trial; the first is `txt1.learning.trial.starts`'s own."""

MARGIN = 1.0  # the walls stand so much beyond the boundary, m: the body's half, and room to stop


@dataclass
class TrialResult:
    """The result of a trial."""

    trial: int  # its number, from 1
    episodes: list[Episode]  # those that were completed
    complete: bool  # whether that is all of them
    table: StoredTable  # what was learned
    memory: dict[str, Any]  # with which the agent can carry on
    paths: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    """By the episode's number, (x, y) in m 20 times a second."""
    voided: int = 0  # episodes that were broken off by a disarm and done again


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
    """Return the description of a trial that its recording holds."""
    return {"learn": name, "seed": seed, "trial": number, "episodes": episodes}


def result_of(trial: Trial, number: int, episodes: int) -> TrialResult:
    """Return the result of a trial."""
    done = trial.episodes
    complete = len(done) == episodes
    agent = trial.agent
    return TrialResult(number, done, complete, agent.table(), agent.memory(), trial.paths, trial.voided)
