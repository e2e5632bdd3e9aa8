"""The learners by name: ours from a table, other packages' through the entry-point group ``txt1.learners``.

A learner is one module with a class that is an `Agent` and the function that makes one. A package announces it in its
pyproject.toml::

    [project.entry-points."txt1.learners"]
    mine = "mypackage.mine:create"

Here ``create(config, rng, stored) -> txt1.learning.agent.Agent``. With `stored` None the learner knows nothing yet.
With a stored table it always takes the best action and does not learn; ValueError says why the table does not fit. The
settings come in ``learning.options``. The table that it stores has its name as `agent`; `settings` and `commands` are
written beside its notes.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from txt1.config import Config
from txt1.config.sources import with_values
from txt1.errors import ConfigError, MissingPlugin, QTableError
from txt1.learning import thesis
from txt1.learning.agent import Agent
from txt1.learning.checked_learner import checked
from txt1.learning.qtable import RELEARN, StoredTable, load
from txt1.learning.settings import LearningConfig, section_of, settings_of
from txt1.learning.trial import AGENT, stream
from txt1.plugins import Registry
from txt1.sim.pcg64 import Pcg64
from txt1.unknown import brought

LEARNERS: Final = Registry(
    "learner", "txt1.learners", {"thesis": thesis.create, "locator": "txt1.learning.locator:LocatorAgent"}
)


def make(name: str, config: Config, rng: Any, stored: StoredTable | None = None) -> Agent:
    """Return a learner that knows nothing yet, or a driver by a stored table.

    Raises ConfigError: the name is unknown, or its options are wrong; ValueError: the table does not fit.
    """
    if name != "thesis":
        # the others compute with numpy
        rng = rng.numpy() if isinstance(rng, Pcg64) else rng
        stored = None if stored is None else stored.as_array()
    agent: Agent = LEARNERS.make("agent", name, config, rng, stored)
    place = LEARNERS.place("agent", name)
    if callable(place) or name in {*LEARNERS.table, *brought(LEARNERS.group)}:
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


def from_table(path: Path, config: Config, rng: Any) -> Agent:
    """Return a driver that takes the best action of a stored table and does not learn.

    Raises QTableError: the file is no sound table, its learner is not installed, or the
    configuration asks for other settings or actions than it was learned with.
    """
    table = load(path)
    name = str(table.about.get("agent"))
    try:
        return make(name, _as_learned(config, name, table.about), rng, table)
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


def with_settings(config: Config, name: str, table: StoredTable) -> StoredTable:
    """Return a learner's table with the settings and actions that give its states and columns their meaning."""
    learning = config.section(LearningConfig)
    actions = [list(each) for each in learning.actions]
    return StoredTable(table.values, {**table.about, "settings": settings_of(learning, name), "commands": actions})


def _as_learned(config: Config, name: str, about: Mapping[str, Any]) -> Config:
    """Return the configuration with the learner's settings of a stored table.

    Raises ValueError: another value is given, or other actions.
    """
    learning, section = config.section(LearningConfig), section_of(name)
    actions, now = about.get("commands"), [list(each) for each in learning.actions]
    if actions is not None and actions != now:
        raise ValueError(f"was learned with learning.actions={actions}, not {now}")
    given, usual = settings_of(learning, name), settings_of(LearningConfig(), name)
    # tables of before told the direction alone
    kept = about.get("settings", {key: about[key] for key in ("direction",) if key in about})
    for key, value in kept.items():
        if given.get(key) not in (value, usual.get(key)):
            raise ValueError(f"was learned with learning.{section}.{key}={value}, not {given.get(key)}")
    return with_values(config, {f"learning.{section}.{key}": value for key, value in kept.items()})
