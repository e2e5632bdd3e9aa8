"""A snapshot survives the way to another process exactly, and a field more or less never makes it unreadable."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from txt1.control.schedule import ANGULAR_GAINS, Schedule
from txt1.telemetry.bus import Bus
from txt1.telemetry.snapshot import Snapshot
from txt1.telemetry.topics import Rule, Topic


class Mood(StrEnum):
    GOOD = "good"


class Inner(NamedTuple):
    x: float
    mood: Mood | None = None


@dataclass(frozen=True)
class Abilities:
    flies: bool = False
    swims: bool = True


class Value(NamedTuple):
    inner: Inner
    several: tuple[Inner, ...] = ()
    pair: tuple[int, str] | None = None
    counts: Mapping[str, int] = {}
    schedule: Schedule = Schedule()
    abilities: Abilities = Abilities()


def topic(name: str, kind: type) -> Topic:  # type: ignore[type-arg]
    return Topic(name, kind, "", "std_msgs/String", Rule.SECOND, "")


VALUE = topic("/value", Value)
NUMBER = topic("/number", float)
PLACE = topic("/place", tuple)

FULL = Value(
    Inner(1.5, Mood.GOOD), (Inner(1.0), Inner(-0.0)), (3, "ä\n\x1b"), {"a": 1}, Schedule(ANGULAR_GAINS), Abilities(True)
)


def there_and_back(snapshot: Snapshot) -> Snapshot:
    return Snapshot.decode(snapshot.encode())


def test_every_kind_of_value_comes_back_as_it_was_and_of_its_type() -> None:
    sent = Snapshot(1.25, "txt03", {"/value": FULL, "/number": 0.1, "/place": (1.0, 2.0)})
    assert sent.encode().count(b"\n") == 1
    assert sent.encode().isascii()
    got = there_and_back(sent)
    assert (got.time, got.name) == (1.25, "txt03")
    assert got[VALUE] == sent[VALUE] == FULL
    assert type(got[VALUE].inner) is Inner and got[VALUE].inner.mood is Mood.GOOD
    assert (got[NUMBER], got[PLACE]) == (0.1, (1.0, 2.0))
    assert there_and_back(got).encode() == sent.encode()


@settings(max_examples=examples(40))
@given(st.floats(allow_nan=False), st.text(), st.dictionaries(st.text(max_size=20), st.integers(), max_size=5))
def test_all_values_are_exact(number: float, text: str, counts: dict[str, int]) -> None:
    value = Value(Inner(number), pair=(1, text), counts=counts)
    assert there_and_back(Snapshot(0.0, "", {"/value": value}))[VALUE] == value


def test_a_topic_without_a_value_is_none_or_the_default() -> None:
    for snapshot in (Snapshot(0.0, "", {}), there_and_back(Snapshot(0.0, "", {}))):
        assert snapshot.get(NUMBER) is None
        assert snapshot.get(NUMBER, 2.0) == 2.0
        with pytest.raises(KeyError, match="/number"):
            snapshot[NUMBER]


def edited(change: object) -> Snapshot:
    """The full snapshot of a version whose value has other fields."""
    line = json.loads(Snapshot(0.0, "", {"/value": FULL, "/number": 1.0}).encode())
    change(line["topics"])  # type: ignore[operator]
    return Snapshot.decode(json.dumps(line))


def test_a_field_more_is_ignored_and_a_field_less_has_its_default() -> None:
    assert edited(lambda topics: topics["/value"].update(new=[1])).get(VALUE) == FULL
    less = edited(lambda topics: topics["/value"].pop("abilities"))
    assert less.get(VALUE) == FULL._replace(abilities=Abilities())


@pytest.mark.parametrize("broken", [[1], "text", {}, {"inner": 3}, {"inner": {"x": 1.0}, "pair": [1]}])
def test_a_value_of_another_shape_spoils_its_own_topic_only(broken: object) -> None:
    snapshot = edited(lambda topics: topics.update({"/value": broken, "/unheard_of": 1}))
    assert snapshot.get(VALUE) is None
    assert snapshot[NUMBER] == 1.0


@pytest.mark.parametrize("line", [b"", b"{}\n", b"[1, 2]\n", b"null\n", b"\xff\n", b'{"version": 99, "time": 0}'])
def test_anything_else_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError):
        Snapshot.decode(line)


def test_a_value_of_unknown_type_is_an_error_and_no_guess() -> None:
    with pytest.raises(TypeError, match="complex"):
        Snapshot(0.0, "", {"/number": 1j}).encode()


def test_it_is_taken_from_the_bus_all_of_it_or_the_topics_asked_for() -> None:
    bus = Bus()
    bus.offer(NUMBER, lambda: 1.0)
    bus.offer(PLACE, lambda: None)
    bus.offer(VALUE, lambda: FULL)
    every = Snapshot.take(bus, 2.0, "sim")
    assert (every.get(NUMBER), every.get(PLACE), every.get(VALUE)) == (1.0, None, FULL)
    some = Snapshot.take(bus, 2.0, "sim", ["/value", "/unheard_of"])
    assert (some.time, some.name, some.get(NUMBER), some[VALUE]) == (2.0, "sim", None, FULL)


def test_values_can_be_replaced() -> None:
    for first in (Snapshot(1.0, "", {"/number": 1.0}), there_and_back(Snapshot(1.0, "", {"/number": 1.0}))):
        second = first.replaced({NUMBER: 2.0, PLACE: (1,)}, time=3.0)
        assert (first[NUMBER], second[NUMBER], second[PLACE], second.time) == (1.0, 2.0, (1,), 3.0)
        assert there_and_back(second)[NUMBER] == 2.0
