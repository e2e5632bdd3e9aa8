"""The options of `txt1 run` with which the robot learns, or drives by a learned table."""

from __future__ import annotations

from argparse import Namespace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from txt1.additions import Options
from txt1.commands import count, existing, takes
from txt1.errors import ConfigError, MissingPlugin

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.learning.agent import Agent


class Learner(NamedTuple):
    """The agent that learns, or drives by a stored table."""

    name: str | None
    agent: Agent
    share: int | None
    """Episodes between two times at which it takes over the fleet's rows; None: never."""


def asked(arguments: Namespace, config: Config) -> Learner | None:
    """Return the learner that was asked for, None if there is none; raises ConfigError."""
    if arguments.learn is None and arguments.policy is None:
        if arguments.share is not None:
            raise ConfigError("--share: this robot does not learn; add --learn")
        unread = next((word for word in arguments.set or () if word.startswith("learning.")), None)
        if unread is not None:
            raise ConfigError(f"--set {unread}: this robot does not learn, so it would have no effect; add --learn")
        return None
    steering = [name for name in ("learn", "policy", "drive", "source") if getattr(arguments, name) is not None]
    if len(steering) > 1:
        raise ConfigError(f"--{steering[0]}: --{steering[1]} drives already; leave one of them out")
    from txt1.learning.registry import LEARNERS, agent_of
    from txt1.learning.settings import LearningConfig, refuse_of_studies, refuse_unread

    if arguments.learn is not None:
        refuse_unread(arguments.set, arguments.learn)
    refuse_of_studies(config.section(LearningConfig), LEARNERS.names())
    agent = agent_of(config, arguments.learn, arguments.policy)
    # one of the two options is given
    assert agent is not None
    if arguments.share is not None:
        if arguments.fleet is None:
            raise ConfigError("--share: the robot is in no fleet; add --fleet")
        if arguments.learn is None:
            raise ConfigError("--share: this robot does not learn; add --learn")
        learning_together().sharer(arguments.learn, agent)
    return Learner(arguments.learn, agent, arguments.share)


def learning_together() -> Any:
    """Return the plug-in's module by which robots learn together; raises MissingPlugin."""
    try:
        return import_module("txt1_learners.sharing")
    except ModuleNotFoundError:
        raise MissingPlugin("--share: learning together", "learners") from None


OPTIONS: Final = Options(
    "learning",
    {
        "--learn": takes("AGENT", "let this learner learn to find the light (see txt1 learn)"),
        "--policy": takes("FILE", "drive to the light by a learned qtable.json", existing),
        "--share": takes("EPISODES", "with --learn and a plug-in: learn from the fleet every EPISODES episodes", count),
    },
    asked,
)
