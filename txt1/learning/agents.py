"""The learners by name: ours, and other packages' through the entry-point group ``txt1.learners``.

A package announces its learner in its pyproject.toml::

    [project.entry-points."txt1.learners"]
    mine = "mypackage.learner:create"

where ``create(config, rng, stored) -> txt1.learning.agent.Agent``: a learner that knows nothing yet, or with a stored
table (else None) one that takes the best action of it and learns no more; ValueError says why the table does not fit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from txt1.config import Config
from txt1.errors import QTableError
from txt1.learning import sweeps, thesis
from txt1.learning.agent import Agent
from txt1.learning.qtable import ACTIONS, RELEARN, STATES, StoredTable, load
from txt1.learning.sweeps import SweepsAgent
from txt1.learning.thesis import ThesisAgent
from txt1.learning.trial import COMMANDS
from txt1.plugins import Registry


def _thesis(config: Config, rng: np.random.Generator, stored: StoredTable | None) -> Agent:
    settings = thesis_settings(config)
    if stored is None:
        return ThesisAgent(rng, COMMANDS, settings)
    _need_states(stored, STATES)
    driver = ThesisAgent(rng, COMMANDS, settings._replace(policy="greedy", training=0, learn_on=False))
    driver.q = np.array(stored.values)
    return driver


def _sweeps(config: Config, rng: np.random.Generator, stored: StoredTable | None) -> Agent:
    settings = sweeps.Settings(exponent=float(config.sim.light.exponent))
    if stored is None:
        return SweepsAgent(rng, settings)
    _need_states(stored, sweeps.BEARINGS * sweeps.YAW_RATES)
    return SweepsAgent.driving(rng, stored, settings)


LEARNERS: Final = Registry("learner", "txt1.learners", {ThesisAgent.name: _thesis, SweepsAgent.name: _sweeps})


def make(name: str, config: Config, rng: np.random.Generator) -> Agent:
    """A learner that knows nothing yet.

    Raises:
        ConfigError: there is none of that name.

    """
    agent: Agent = LEARNERS.make("learner", name, config, rng, None)
    return agent


def thesis_settings(config: Config) -> thesis.Settings:
    """The thesis's learner, as configured."""
    one = config.learning
    return thesis.Settings(
        one.period, one.remedy, one.policy, one.alpha, one.gamma, one.rate,
        temperature=one.temperature, decay=one.temperature_decay, floor=one.temperature_floor, filtered=one.filtered,
        direction=one.direction, exponent=float(config.sim.light.exponent), training=one.training,
        learn_on=one.learn_on,
    )  # fmt: skip


def from_table(path: Path, config: Config, rng: np.random.Generator) -> Agent:
    """A driver that takes the best action of a stored table and learns no more.

    Raises:
        QTableError: the file is no sound table, or not one of a learner that is installed.

    """
    stored = load(path, actions=len(ACTIONS))
    name = stored.about.get("agent")
    if name not in (names := LEARNERS.names()):
        raise QTableError(str(path), f"was learned by {name!r}, and there are only {' and '.join(names)}", RELEARN)
    try:
        agent: Agent = LEARNERS.make("policy", name, config, rng, stored)
    except ValueError as error:
        raise QTableError(str(path), str(error), "give a table that this agent learned") from None
    return agent


def _need_states(stored: StoredTable, needed: int) -> None:
    """Raise ValueError unless the table has so many states."""
    if len(stored.values) != needed:
        raise ValueError(f"has {len(stored.values)} states where {needed} are needed")
