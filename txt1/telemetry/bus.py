"""The bus of one robot: what its tasks tell goes to whoever has subscribed, and costs nothing while nobody has."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import chain
from typing import Any, NamedTuple, TypeVar
from zlib import crc32

from txt1.telemetry.ready import Maker
from txt1.telemetry.topics import Rule, Take, Topic, Unsubscribe

T = TypeVar("T")

TakeCycle = Callable[[tuple[Topic[Any], ...], list[Any], float], None]
"""Takes all topics that are told every cycle and their values, None where there is none."""


class _Subscriber(NamedTuple):
    take: Take
    topics: frozenset[Topic[Any]] | None
    cycle: TakeCycle

    def wants(self, topic: Topic[Any]) -> bool:
        return self.topics is None or topic in self.topics


class _Offer:
    """A topic that is sampled: the function that reads it, and what was told last; `turn` spreads the seldom ones."""

    def __init__(self, topic: Topic[Any], read: Callable[[], Any], turn: int) -> None:
        self.topic, self.read, self.turn = topic, read, turn
        self.last: Any = None


class _Row:
    """Topics that are read together: those told every cycle, `cycle` of them, before those told on change."""

    def __init__(self, offers: list[_Offer], read: Callable[[], tuple[Any, ...]]) -> None:
        self.offers, self.read = offers, read
        self.changes = [offer for offer in offers if offer.topic.rule is Rule.CHANGE]
        self.cycle = len(offers) - len(self.changes)
        self.last: tuple[Any, ...] = ()


def _part(read: Callable[[], tuple[Any, ...]], place: int) -> Any:
    return read()[place]


class Bus:
    """Carries one robot's topics; its `name`, empty for one that is alone, stands before theirs.

    `sample` is called so many times a second; it is wanted from the first subscription to what is sampled on, when
    `begin` is called.
    """

    def __init__(self, name: str = "", cycles_per_second: int = 50, begin: Callable[[], None] = lambda: None) -> None:
        self.name = name
        self.maker: Maker | None = None
        """Who makes messages of everything here, where somebody does: the first recorder."""
        self._second = cycles_per_second
        self._begin: Callable[[], None] | None = begin
        self._count = 0
        self._offers: dict[Topic[Any], _Offer] = {}
        self._subscribers: list[_Subscriber] = []
        self._takes: dict[Topic[Any], list[Take]] = {}
        self._cycle_takes: list[TakeCycle] = []
        self._cycle: tuple[Topic[Any], ...] = ()
        self._reads: list[Callable[[], Any]] = []
        self._changes: list[_Offer] = []
        self._row: _Row | None = None
        self._row_heard = False
        self._seconds: dict[int, list[_Offer]] = {}

    def full_name(self, topic: Topic[Any]) -> str:
        """The name of a topic with the robot's name before it, where it has one."""
        return f"/{self.name}{topic.name}" if self.name else topic.name

    # -- who has something to tell -----------------------------------------------------------------------------

    def offer(self, topic: Topic[T], read: Callable[[], T | None]) -> None:
        """Offer a topic that is sampled; `read` returns its value now, None as long as there is none."""
        self._offers[topic] = _Offer(topic, read, crc32(topic.name.encode()) % self._second)
        self._arrange()

    def offer_row(self, topics: Sequence[Topic[Any]], read: Callable[[], tuple[Any, ...]]) -> None:
        """Offer topics that are looked at in every cycle, all by one call, which costs a third of one each.

        `read` returns their values in this order, None for none: first of those told every cycle, then of those told
        on change. A robot has one such row.
        """
        for place, topic in enumerate(topics):
            self._offers[topic] = _Offer(topic, partial(_part, read, place), 0)
        self._row = _Row([self._offers[topic] for topic in topics], read)
        self._arrange()

    def publish(self, topic: Topic[T], value: T, time: float) -> None:
        """Tell a value of a topic that comes as it comes; `time` in s of the run."""
        for take in self._takes.get(topic) or self._takers(topic):
            take(topic, value, time)

    @property
    def heard(self) -> bool:
        """Whether anybody listens to anything."""
        return bool(self._subscribers)

    def wanted(self, topic: Topic[Any]) -> bool:
        """Whether anybody listens to a topic, where making its value costs something."""
        return bool(self._takes.get(topic) or self._takers(topic))

    # -- who listens -------------------------------------------------------------------------------------------

    @property
    def offered(self) -> tuple[Topic[Any], ...]:
        """The topics that are sampled."""
        return tuple(self._offers)

    def read(self, topic: Topic[T]) -> T | None:
        """The value of a sampled topic now; None where nobody offers it."""
        offer = self._offers.get(topic)
        return None if offer is None else offer.read()

    def subscribe(
        self, take: Take, topics: Iterable[Topic[Any]] | None = None, cycle: TakeCycle | None = None
    ) -> Unsubscribe:
        """Have `take` told of these topics, of all when there are none given, until the function returned is called.

        What is told on change is told to everybody once more, so whoever comes late knows it, too. Where there is a
        `cycle`, that takes all the topics of a controller cycle in one call instead.
        """
        chosen = None if topics is None else frozenset(topics)

        def one_by_one(every: tuple[Topic[Any], ...], values: list[Any], now: float) -> None:
            for topic, value in zip(every, values, strict=True):
                if value is not None and (chosen is None or topic in chosen):
                    take(topic, value, now)

        entry = _Subscriber(take, chosen, one_by_one if cycle is None else cycle)
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
        """Tell what is offered, by the rules of the topics: called once per controller cycle."""
        self._count += 1
        row = self._row
        found = row.read() if row is not None and self._row_heard else ()
        if self._cycle_takes:
            values = list(found) if row is None else list(found[: row.cycle])
            if self._reads:
                values += [read() for read in self._reads]
            for take_cycle in self._cycle_takes:
                take_cycle(self._cycle, values, now)
        if row is not None and self._row_heard and found[row.cycle :] != row.last:
            row.last = found[row.cycle :]
            for offer, value in zip(row.changes, row.last, strict=True):
                self._tell(offer, value, now)
        for offer in self._changes:
            value = offer.read()
            if value is not offer.last:
                self._tell(offer, value, now)
        for offer in self._seconds.get(self._count % self._second, ()):
            self._tell(offer, offer.read(), now)

    def flush(self, now: float) -> None:
        """Tell what has changed since it was told last: nothing comes any more."""
        changes = () if self._row is None else self._row.changes
        for offer in (*changes, *self._changes, *chain.from_iterable(self._seconds.values())):
            self._tell(offer, offer.read(), now)

    # -- inside ------------------------------------------------------------------------------------------------

    def _tell(self, offer: _Offer, value: Any, now: float) -> None:
        if value == offer.last:
            return
        offer.last = value
        if value is not None:
            for take in self._takers(offer.topic):
                take(offer.topic, value, now)

    def _takers(self, topic: Topic[Any]) -> list[Take]:
        takes = self._takes.get(topic)
        if takes is None:
            takes = self._takes[topic] = [each.take for each in self._subscribers if each.wants(topic)]
        return takes

    def _arrange(self) -> None:
        """Note who wants what of all that is offered."""
        self._takes.clear()
        row = self._row
        rows: set[Topic[Any]] = set()
        self._cycle = ()
        if row is not None:
            rows = {offer.topic for offer in row.offers}
            self._cycle = tuple(offer.topic for offer in row.offers[: row.cycle])
            row.last = (None,) * len(row.changes)
        heard = {
            rule: [each for each in self._offers.values() if each.topic.rule is rule and each.topic not in rows]
            for rule in Rule
        }
        self._cycle += tuple(offer.topic for offer in heard[Rule.CYCLE])
        self._reads = [offer.read for offer in heard[Rule.CYCLE]]
        self._cycle_takes = [each.cycle for each in self._subscribers if any(map(each.wants, self._cycle))]
        self._row_heard = bool(self._cycle_takes) or any(self._takers(topic) for topic in rows)
        self._changes = [offer for offer in heard[Rule.CHANGE] if self._takers(offer.topic)]
        self._seconds = {}
        for offer in heard[Rule.SECOND]:
            if self._takers(offer.topic):
                self._seconds.setdefault(offer.turn, []).append(offer)
        if self._begin is not None and (self._cycle_takes or self._row_heard or self._changes or self._seconds):
            begin, self._begin = self._begin, None
            begin()
