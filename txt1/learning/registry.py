"""The learners by name: ours from a table, other packages' through the entry-point group ``txt1.learners``.

A learner is one module with a class that is an `Agent` and the function that makes one. A package announces it in its
pyproject.toml::

    [project.entry-points."txt1.learners"]
    mine = "mypackage.mine:create"

Here ``create(config, rng, stored) -> txt1.learning.agent.Agent``. With `stored` None the learner knows nothing yet.
With a stored table it always takes the best action and does not learn; ValueError says why the table does not fit. The
settings come in ``learning.options``. The table that it stores has its name as `agent`.
"""

import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

from txt1.config import Config
from txt1.errors import ConfigError, MissingPlugin, QTableError
from txt1.learning import thesis
from txt1.learning.agent import Agent
from txt1.learning.checked_learner import checked
from txt1.learning.qtable import RELEARN, StoredTable, load
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import AGENT, stream
from txt1.plugins import Registry
from txt1.unknown import brought

LEARNERS: Final = Registry("learner", "txt1.learners", {"thesis": thesis.create})


def make(name: str, config: Config, rng: np.random.Generator) -> Agent:
    """Return a learner that knows nothing yet; ConfigError: the name is unknown, or its options are wrong."""
    return _made(name, config, rng, None)


def _made(name: str, config: Config, rng: np.random.Generator, stored: StoredTable | None) -> Agent:
    agent: Agent = LEARNERS.make("agent", name, config, rng, stored)
    place = LEARNERS.place("agent", name)
    if callable(place) or name in brought(LEARNERS.group):
        return agent
    return checked(agent, f"the learner '{name}' ({place})", len(config.section(LearningConfig).actions))


def of_module(name: str, attribute: str, usual: Any) -> Any:
    """Return what the module of one of this repository's learners has beside the learner, for pictures.

    `usual` if it has no such thing, or the learner is another package's, or not installed.
    """
    if name not in LEARNERS.names() or name not in {*LEARNERS.table, *brought(LEARNERS.group)}:
        return usual
    factory, _ = LEARNERS.find("agent", name)
    return getattr(sys.modules[factory.__module__], attribute, usual)


def agent_of(config: Config, learn: str | None, policy: Path | None) -> Agent | None:
    """Return the learner of this name, or a driver by the table in this file; None without both.

    Raises ConfigError: the name is unknown; QTableError: the file is no sound table.
    """
    rng = stream(config.own_seed, 1, AGENT)
    if policy is not None:
        return from_table(policy, config, rng)
    return None if learn is None else make(learn, config, rng)


def from_table(path: Path, config: Config, rng: np.random.Generator) -> Agent:
    """Return a driver that takes the best action of a stored table and does not learn.

    Raises QTableError: the file is no sound table, or its learner is not installed.
    """
    table = load(path)
    name = str(table.about.get("agent"))
    try:
        return _made(name, config, rng, table)
    except MissingPlugin as error:
        raise QTableError(
            str(path), f"was learned by '{name}', in a plug-in that is not installed", error.command
        ) from None
    except ConfigError as error:
        raise QTableError(str(path), f"was learned by '{name}' ({error})", RELEARN) from None
    except ValueError as error:
        raise QTableError(str(path), str(error), "give a table that this agent learned") from None
    except (LookupError, TypeError, AttributeError, ArithmeticError) as error:
        # from wrong notes in the table
        problem = f"lacks what '{name}' keeps with its table: {type(error).__name__}: {error}"
        raise QTableError(str(path), problem, "give a table that this agent learned") from error
