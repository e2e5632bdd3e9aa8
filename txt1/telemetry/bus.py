"""The bus of one robot: it carries values from the parts that publish them to the parts that subscribe.

How it works
============

A *topic* (`txt1.telemetry.topics.Topic`) is a name, a type and a rule. The rule says when the topic is told. Values
reach the bus in two ways:

- **Sampled topics.** A task or the HAL calls `Bus.offer(topic, read)` once, while the robot is built. From then on the
  bus calls `read()` when it needs the value. The task itself does nothing in its cycle, so a topic without a listener
  costs no time at all.
- **Events.** Values without a rate, such as a sensor's reading or a line of the log, go through `Bus.publish`, which
  hands them to the listeners at once.

A recorder, a screen or a bridge calls `Bus.subscribe(take, topics)`. `take(topic, value, time)` is called in the loop,
so it must not wait: a recorder keeps a reference, and its thread does the rest. A recorder gives `cycle`, too, which is
told the numbers of a whole cycle in one call: seven of eight messages are among them.

`Bus.sample` is called once a controller cycle, by a task that runs behind all others. The listeners then see one
instant of the robot, after every task has done its step. It goes through the sampled topics in three groups:

1. `Rule.CYCLE`: read and told in every cycle.
2. `Rule.CHANGE`: read in every cycle, told when the value differs from the last value told. `is` is tried before `==`,
   because most values are the very same object as a cycle ago.
3. `Rule.SECOND`: read once a second. Each such topic has a cycle of its own in the second, taken from a checksum of its
   name. So the load is spread, and the cycle is the same in every run of the program: a replay depends on that.

Within a group the topics keep the order in which they were offered, but for whoever takes whole cycles the numbers come
first. Causes are offered before their effects, because a replay that differs from its recording names the first
difference.

A late subscriber has missed the values that are told on change only. So after each new subscription the next `sample`
tells these values to every subscriber once more. At the end of a run `flush` tells the values that changed after the
last cycle.

The groups hold only topics with a subscriber. They are made anew whenever a topic is offered or a subscriber comes or
goes, which is seldom. Before the first listener there is no sampling task either: `begin`, which starts it, is called
when a sampled topic is first wanted.

"""

from collections.abc import Callable, Iterable
from itertools import chain
from typing import Any, NamedTuple, TypeVar
from zlib import crc32

from txt1.telemetry.topics import Rule, Take, TakeCycle, Topic, Unsubscribe

T = TypeVar("T")


class _Subscriber(NamedTuple):
    take: Take
    topics: frozenset[Topic[Any]] | None
    cycle: TakeCycle | None

    def wants(self, topic: Topic[Any]) -> bool:
        return self.topics is None or topic in self.topics


class _Offer:
    """A sampled topic: the function that reads it, the last value told, and its subscribers."""

    def __init__(self, topic: Topic[Any], read: Callable[[], Any]) -> None:
        self.topic, self.read = topic, read
        self.last: Any = None
        self.takes: list[Take] = []

    def tell_change(self, value: Any, now: float) -> None:
        """Tell the value if it differs from the last value told."""
        if value != self.last:
            self.last = value
            if value is not None:
                for take in self.takes:
                    take(self.topic, value, now)


class Bus:
    """Carries one robot's topics. The robot's `name` precedes their names; it is empty for a single robot.

    `begin` is called when a sampled topic is first wanted; from then on `sample` has to be called `cycles_per_second`
    times a second.
    """

    def __init__(self, name: str = "", cycles_per_second: int = 50, begin: Callable[[], None] = lambda: None) -> None:
        self.name = name
        self._cycles_per_second = cycles_per_second
        self._begin: Callable[[], None] | None = begin
        self._cycles = 0
        self._offers: dict[Topic[Any], _Offer] = {}
        self._subscribers: list[_Subscriber] = []
        self._takes: dict[Topic[Any], list[Take]] = {}
        self._arrange()

    def full_name(self, topic: Topic[Any]) -> str:
        """Return the name of a topic, preceded by the robot's name if the robot has a name."""
        return f"/{self.name}{topic.name}" if self.name else topic.name

    # -- publishing -----------------------------------------------------------------------------

    def offer(self, topic: Topic[T], read: Callable[[], T | None]) -> None:
        """Offer a sampled topic. `read` returns its present value, None while there is no value."""
        self._offers[topic] = _Offer(topic, read)
        self._arrange()

    def publish(self, topic: Topic[T], value: T, time: float) -> None:
        """Tell a value of a topic that has no fixed rate; `time` in s of the run."""
        for take in self._takers(topic):
            take(topic, value, time)

    def wanted(self, topic: Topic[Any]) -> bool:
        """Return whether a topic has a subscriber. A part asks before it makes a value that is expensive."""
        # without a call, as it is asked before each command
        takes = self._takes.get(topic)
        return bool(self._takers(topic) if takes is None else takes)

    # -- subscribing -------------------------------------------------------------------------------------------

    @property
    def offered(self) -> tuple[Topic[Any], ...]:
        """The sampled topics."""
        return tuple(self._offers)

    def read(self, topic: Topic[T]) -> T | None:
        """Return the present value of a sampled topic; None if the topic is not offered."""
        offer = self._offers.get(topic)
        return None if offer is None else offer.read()

    def subscribe(
        self, take: Take, topics: Iterable[Topic[Any]] | None = None, cycle: TakeCycle | None = None
    ) -> Unsubscribe:
        """Call `take` for each value of these topics, by default of all topics. Returns a function that unsubscribes.

        `cycle` takes, once a cycle, all offered topics of `Rule.CYCLE` that tell nothing but numbers, not `take`.
        Values that are told on change are told once more to every subscriber, so a late subscriber has them, too.
        """
        entry = _Subscriber(take, None if topics is None else frozenset(topics), cycle)
        self._subscribers.append(entry)
        for topic, offer in self._offers.items():
            if entry.wants(topic):
                offer.last = None
        self._arrange()

        def leave() -> None:
            if entry in self._subscribers:
                self._subscribers.remove(entry)
                self._arrange()

        return leave

    def sample(self, now: float) -> None:
        """Read the offered topics and tell their values, each by its rule. Called once per controller cycle; `now` in s
        of the run.
        """
        self._cycles += 1
        if self._take_cycles:
            values = [read() for read in self._reads]
            for take_cycle in self._take_cycles:
                take_cycle(self._numbers, values, now)
        for offer in self._every_cycle:
            value = offer.read()
            if value is not None:
                for take in offer.takes:
                    take(offer.topic, value, now)
        for offer in self._on_change:
            value = offer.read()
            if value is not offer.last:
                offer.tell_change(value, now)
        for offer in self._each_second.get(self._cycles % self._cycles_per_second, ()):
            offer.tell_change(offer.read(), now)

    def flush(self, now: float) -> None:
        """Tell the values that have changed since they were told last. Called at the end of a run."""
        for offer in (*self._on_change, *chain.from_iterable(self._each_second.values())):
            offer.tell_change(offer.read(), now)

    # -- inside ------------------------------------------------------------------------------------------------

    def _takers(self, topic: Topic[Any]) -> list[Take]:
        takes = self._takes.get(topic)
        if takes is None:
            takes = self._takes[topic] = [each.take for each in self._subscribers if each.wants(topic)]
        return takes

    def _arrange(self) -> None:
        """Find the subscribers of each offered topic."""
        self._takes.clear()
        # who takes the numbers of a cycle in one call; their topics, and what reads them
        self._take_cycles = [each.cycle for each in self._subscribers if each.cycle]
        self._numbers = tuple(topic for topic in self._offers if topic.paths and topic.rule is Rule.CYCLE)
        self._reads = [self._offers[topic].read for topic in self._numbers]
        for topic, offer in self._offers.items():
            offer.takes = [
                each.take
                for each in self._subscribers
                if each.wants(topic) and not (each.cycle and topic in self._numbers)
            ]
        heard = [offer for offer in self._offers.values() if offer.takes]
        self._every_cycle = [offer for offer in heard if offer.topic.rule is Rule.CYCLE]
        self._on_change = [offer for offer in heard if offer.topic.rule is Rule.CHANGE]
        # topics of `Rule.SECOND` by their cycle in the second
        self._each_second: dict[int, list[_Offer]] = {}
        for offer in heard:
            if offer.topic.rule is Rule.SECOND:
                turn = crc32(offer.topic.name.encode()) % self._cycles_per_second
                self._each_second.setdefault(turn, []).append(offer)
        if self._begin is not None and (self._take_cycles or self._every_cycle or self._on_change or self._each_second):
            begin, self._begin = self._begin, None
            begin()
