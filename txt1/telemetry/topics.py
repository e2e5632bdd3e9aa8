"""The table of topics: every value the robot tells, declared beside its type by whoever owns it.

Its module hands it to `declare` and offers or publishes it on the robot's `txt1.telemetry.bus.Bus`: recorder, live
view, screens and exports find it there (see docs/recording.md).
"""

import builtins
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final, Generic, TypeVar

T = TypeVar("T")

TOPIC_NAME: Final = re.compile(r"(/[a-z0-9_]+)+")


class Rule(StrEnum):
    """When a topic is told."""

    CYCLE = "every controller cycle"
    CHANGE = "when it changes, looked at every controller cycle"
    SECOND = "once a second, when it is another than before"
    EVENT = "as it comes"
    SNAPSHOT = "in snapshots only"


@dataclass(frozen=True, eq=False)
class Topic(Generic[T]):
    """One value that the robot tells.

    Attributes:
        name: such as "/odom"; with several robots the robot's name stands before it.
        type: of its values, which are immutable.
        units: of its numbers, for people.
        message: the ROS message, ``package/Name`` (see `txt1.telemetry.messages`).
        rule: when it is told.
        about: its meaning, for people.
        constants: the message's values that are always the same, nested like the message: frames, for example.
        paths: of the numbers in the message, such as "twist.linear.x", in the order in which they stand there.
        make: the numbers of a value, in the order of `paths`, those behind them left out; without paths, the message's
            fields as a nested mapping, or all behind its header as a named tuple.
        in_snapshots: False for topics that are slow to read or that repeat another one.

    The message's first time stamp is filled in by whoever writes it.

    """

    name: str
    type: builtins.type[T]
    units: str
    message: str
    rule: Rule
    about: str
    constants: Mapping[str, Any] = field(default_factory=dict)
    paths: tuple[str, ...] = ()
    make: Callable[[T], tuple[Any, ...] | Mapping[str, Any]] = lambda value: {"data": str(value)}
    in_snapshots: bool = True


Take = Callable[[Topic[Any], Any, float], None]
"""Takes a topic, a value and its time in s of the run; in the loop, so it must not wait."""
Unsubscribe = Callable[[], None]

TOPICS: Final[dict[str, Topic[Any]]] = {}
"""Every topic declared so far, by name."""


def declare(topic: Topic[T]) -> Topic[T]:
    """Enter a topic into the table and return it; ValueError where its name is taken, or no name of a topic."""
    if not TOPIC_NAME.fullmatch(topic.name):
        raise ValueError(f"topic {topic.name!r}: give it a name of /, small letters, digits and _, such as /odom")
    if topic.name in TOPICS:
        raise ValueError(f"topic {topic.name}: declared already ({TOPICS[topic.name].about}); choose another name")
    TOPICS[topic.name] = topic
    return topic
