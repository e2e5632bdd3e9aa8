"""A learner of another package, checked so that its mistakes are reported with its name.

`Checked` asks the learner for each attribute of an `Agent`; `KINDS` has the type that each must return. An error
becomes a single line that names the learner's package.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import index
from typing import Any, Final, cast

from txt1.errors import Txt1Error
from txt1.learning.agent import Agent, Decision, Learned
from txt1.learning.qtable import StoredTable

PROPERTIES: Final = ("name", "ready")
METHODS: Final = [name for name in vars(Agent) if not name.startswith("_")]
SHARES: Final = ("shared", "take")


def _decision(value: Any) -> Decision:
    state, reward, values = value
    row, earned = None if state is None else index(state), None if reward is None else float(reward)
    return Decision(row, earned, tuple(map(float, values)))


KINDS: Final[dict[str, type]] = {"name": str, "table": StoredTable, "memory": dict, "shared": Learned}
# the types that other results are converted to; TypeError or ValueError if that fails
MADE: Final[dict[str, Callable[[Any], Any]]] = {
    "ready": bool,
    "waits": bool,
    "act": index,
    "decision": _decision,
    "take": index,
}


@contextmanager
def blaming(who: str, method: str) -> Iterator[None]:
    """Turn an error of another package into one line with its name."""
    try:
        yield
    except Txt1Error:
        raise
    except (Exception, SystemExit) as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise Txt1Error(f"{who} failed in {method}: {told}") from error


def checked(agent: Agent, who: str, actions: int) -> Agent:
    """Return the learner with its results checked and its errors named after `who`; Txt1Error: it is no Agent."""
    there = dir(agent)
    if missing := [name for name in METHODS if name not in there]:
        raise Txt1Error(f"{who} is no txt1.learning.agent.Agent: {type(agent).__name__} has no {', '.join(missing)}")
    return cast(Agent, (CheckedSharer if {*SHARES} <= {*there} else Checked)(agent, who, actions))


class Checked:
    """An `Agent` that calls another agent, which may fail."""

    def __init__(self, agent: Any, who: str, actions: int) -> None:
        self._agent, self._who, self._actions = agent, who, actions

    def ask(self, name: str, *given: Any) -> Any:
        """Return an attribute of the learner, or its method's result; Txt1Error: it failed, or the type is wrong."""
        with blaming(self._who, name):
            value = getattr(self._agent, name)
            value = value if name in PROPERTIES else value(*given)
            value = MADE[name](value) if name in MADE else value
        if name in KINDS and not isinstance(value, KINDS[name]):
            raise Txt1Error(f"{self._who}: {name} returned {value!r}; return a {KINDS[name].__name__}")
        if name == "act" and not 0 <= value < self._actions:
            raise Txt1Error(f"{self._who}: act returned {value}; return 0 to {self._actions - 1}")
        return value


class CheckedSharer(Checked):
    """A checked learner that can learn together with others (`txt1_learners.sharing.Sharer`)."""


def _asks(name: str) -> Any:
    """Return the attribute of `Checked` that asks the learner for the attribute of this name."""
    if name in PROPERTIES:
        return property(lambda self: self.ask(name))
    return lambda self, *given: self.ask(name, *given)


for _name in METHODS:
    setattr(Checked, _name, _asks(_name))
for _name in SHARES:
    setattr(CheckedSharer, _name, _asks(_name))
