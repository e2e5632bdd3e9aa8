"""The table of topics: every value in the robot's telemetry.

A topic is declared in the module that defines the type of its values. The module calls `declare`, and offers or
publishes the topic on the robot's `txt1.telemetry.bus.Bus`. Recorder, live view, screens and exports find it in the
table (see docs/recording.md).
"""

import builtins
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final, Generic, TypeVar

T = TypeVar("T")

TOPIC_NAME: Final = re.compile(r"(/[a-z0-9_]+)+")


class Rule(StrEnum):
    """When a topic is told."""

    CYCLE = "every controller cycle"
    CHANGE = "when it changes, looked at every controller cycle"
    SECOND = "once a second, when it has changed"
    EVENT = "as it comes"
    SNAPSHOT = "in snapshots only"


@dataclass(frozen=True, eq=False)
class Topic(Generic[T]):
    """A topic: one value in the robot's telemetry.

    Attributes:
        name: for example "/odom"; with several robots the robot's name precedes it.
        type: type of the values, which are immutable.
        units: units of the numbers, for people.
        message: the ROS message, ``package/Name`` (see `txt1.telemetry.messages`).
        rule: when a value is told.
        about: the meaning, for people.
        constants: the message's constant values, nested like the message; for example frames.
        paths: paths of the numbers in the message, such as "twist.linear.x", in the message's order.
        make: function from a value to its numbers, in the order of `paths`; later fields of the message are left out.
            Without paths it returns the message's fields as a nested mapping, or all fields after the header as a named
            tuple.
        in_snapshots: False for topics that are slow to read or that repeat another one.
        own: True for topics that only txt1's own replay and screens read; exports leave them out.
        derived: True for topics whose contents other topics have, too; tables leave them out.

    The writer of the message fills in its first time stamp.

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
    own: bool = False
    derived: bool = False


# a subscriber: takes a topic, a value and its time in s of the run; it is called in the loop, so it must not wait
Take = Callable[[Topic[Any], Any, float], None]
# the same for several topics at once; a value may be None
TakeCycle = Callable[[tuple[Topic[Any], ...], Sequence[Any], float], None]
Unsubscribe = Callable[[], None]

TOPICS: Final[dict[str, Topic[Any]]] = {}
"""Every topic declared so far, by name."""


def declare(topic: Topic[T]) -> Topic[T]:
    """Enter a topic into the table and return it. Raises ValueError if its name is taken or malformed."""
    if not TOPIC_NAME.fullmatch(topic.name):
        raise ValueError(f"topic {topic.name!r}: give it a name of /, small letters, digits and _, such as /odom")
    if topic.name in TOPICS:
        raise ValueError(f"topic {topic.name}: declared already ({TOPICS[topic.name].about}); choose another name")
    TOPICS[topic.name] = topic
    return topic
