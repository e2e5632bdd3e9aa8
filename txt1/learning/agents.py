"""The learners by name, and the one that drives by a stored table."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from txt1.config import Config
from txt1.errors import ConfigError, QTableError
from txt1.learning import sweeps, thesis
from txt1.learning.agent import Agent
from txt1.learning.qtable import ACTIONS, RELEARN, STATES, load
from txt1.learning.sweeps import SweepsAgent
from txt1.learning.thesis import ThesisAgent
from txt1.learning.trial import COMMANDS

NAMES: Final = (ThesisAgent.name, SweepsAgent.name)


def make(name: str, config: Config, rng: np.random.Generator) -> Agent:
    """A learner that knows nothing yet.

    Raises:
        ConfigError: there is none of that name.

    """
    exponent = float(config.sim.light.exponent)
    if name == ThesisAgent.name:
        return ThesisAgent(rng, COMMANDS, thesis_settings(config))
    if name == SweepsAgent.name:
        return SweepsAgent(rng, sweeps.Settings(exponent=exponent))
    raise ConfigError(f"there is no learner '{name}', only {' and '.join(NAMES)}")


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
        QTableError: the file is no sound table, or not one of these learners'.

    """
    name = load(path, actions=len(ACTIONS)).about.get("agent")
    if name == ThesisAgent.name:
        stored = load(path, STATES, len(ACTIONS))
        driver = ThesisAgent(
            rng, COMMANDS, thesis_settings(config)._replace(policy="greedy", training=0, learn_on=False)
        )
        driver.q = np.array(stored.values)
        return driver
    if name == SweepsAgent.name:
        stored = load(path, sweeps.BEARINGS * sweeps.YAW_RATES, len(ACTIONS))
        return SweepsAgent.driving(rng, stored, sweeps.Settings(exponent=float(config.sim.light.exponent)))
    raise QTableError(str(path), f"was learned by {name!r}, and there are only {' and '.join(NAMES)}", RELEARN)
