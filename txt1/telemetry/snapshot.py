"""The telemetry of one instant, by topic; also as a line of JSON with a version.

A topic is decoded when it is first asked for. Unknown topics and fields are ignored; missing ones are None or their
default. So an older line stays readable when fields are added.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, lru_cache
from types import NoneType, UnionType
from typing import Any, Final, TypeVar, Union, cast, get_args, get_origin, get_type_hints, overload

from txt1.control.schedule import GainSet, Schedule
from txt1.telemetry.bus import Bus
from txt1.telemetry.topics import Rule, Topic, declare

VERSION: Final = 1

T = TypeVar("T")
Convert = Callable[[Any], Any]


class Snapshot:
    """The values of topics at one instant, by name. `time` is in s of the run, `name` is the robot's."""

    def __init__(self, time: float, name: str, values: Mapping[str, Any]) -> None:
        self.time, self.name = time, name
        self._values = dict(values)
        self._plain: Mapping[str, Any] = {}

    @classmethod
    def take(
        cls,
        bus: Bus,
        time: float,
        name: str,
        topics: Iterable[str] | None = None,
        without: Collection[Topic[Any]] = (),
    ) -> Snapshot:
        """Take a snapshot of a bus now: of the topics of these names, by default of all sampled topics.

        Topics in `without` are left out.
        """
        chosen = None if topics is None else frozenset(topics)
        values = {}
        for topic in bus.offered:
            if topic.in_snapshots and (chosen is None or topic.name in chosen) and topic not in without:
                value = bus.read(topic)
                if value is not None:
                    values[topic.name] = value
        return cls(time, name, values)

    def __getitem__(self, topic: Topic[T]) -> T:
        """Return the value of a topic; KeyError if the topic has no value."""
        value = self.get(topic)
        if value is None:
            raise KeyError(topic.name)
        return value

    @overload
    def get(self, topic: Topic[T]) -> T | None: ...

    @overload
    def get(self, topic: Topic[T], default: T) -> T: ...

    def get(self, topic: Topic[T], default: T | None = None) -> T | None:
        """Return the value of a topic; the default if it has no value, or a value of a wrong type."""
        name, kind = topic.name, cast(Any, topic.type)
        if name not in self._values:
            try:
                self._values[name] = _reader(kind)(self._plain.get(name))
            except (TypeError, ValueError, KeyError, AttributeError):
                self._values[name] = None
        found: T | None = self._values[name]
        return default if found is None else found

    def replaced(
        self, values: Mapping[Topic[Any], Any], time: float | None = None, name: str | None = None
    ) -> Snapshot:
        """Return a copy with new values of some topics (None removes a value), and with a new time or name if given."""
        other = Snapshot(self.time if time is None else time, self.name if name is None else name, self._values)
        other._plain = self._plain
        other._values.update((topic.name, value) for topic, value in values.items())
        return other

    def encode(self) -> bytes:
        """Return the snapshot as a line of JSON, with its newline.

        Raises TypeError for a value that JSON cannot hold.
        """
        topics = {**self._plain, **{name: plain(value) for name, value in self._values.items()}}
        told = {"version": VERSION, "time": self.time, "name": self.name, "topics": topics}
        return f"{_JSON.encode(told)}\n".encode("ascii")

    @classmethod
    def decode(cls, line: bytes | str) -> Snapshot:
        """Return the snapshot of a line of JSON. Raises ValueError for a malformed line or an unknown version."""
        try:
            read = json.loads(line)
            if read["version"] != VERSION:
                raise ValueError(f"not a snapshot of version {VERSION} but of {read['version']!r}")
            snapshot = cls(float(read["time"]), str(read["name"]), {})
            snapshot._plain = dict(read["topics"])
        except (TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"not a snapshot: {type(error).__name__}: {error}") from error
        return snapshot


SNAPSHOT: Final = declare(
    Topic(
        "/snapshot",
        Snapshot,
        "",
        "std_msgs/String",
        Rule.SECOND,
        "everything the robot tells, as one line of JSON",
        make=lambda snapshot: {"data": snapshot.encode()[:-1].decode("ascii")},
        in_snapshots=False,
        own=True,
    )
)

_JSON: Final = json.JSONEncoder(separators=(",", ":"))
_WORDS: Final = frozenset((NoneType, bool, int, float, str))


# -- values to JSON and back -----------------------------------------------------------------------------------


def plain(value: Any) -> Any:
    """Return a value for JSON: fields by name, bytes in base64. Raises TypeError for a value that JSON cannot hold."""
    kind: Any = type(value)
    if kind in _WORDS:
        return value
    if kind is Schedule:
        return _sets(value)
    if names := _names(kind):
        values = value if isinstance(value, tuple) else [getattr(value, name) for name in names]
        return {name: each if type(each) in _WORDS else plain(each) for name, each in zip(names, values, strict=True)}
    if isinstance(value, tuple | list):
        return [plain(each) for each in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, bytes):
        return b64encode(value).decode("ascii")
    # numpy's arrays; numpy is not imported here, because it takes 0.1 s to load and the screens do not need it
    words = getattr(value, "tolist", None)
    if words is not None:
        return words()
    raise TypeError(f"{kind.__name__} has no place in a snapshot")


@lru_cache(8)
def _sets(schedule: Schedule) -> Any:
    # four fifths of a snapshot, which seldom change
    return plain(schedule.sets)


@cache
def _names(kind: Any) -> tuple[str, ...]:
    """Return the names of a type's fields; empty for a type without fields."""
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else getattr(kind, "_fields", ())


def read_as(kind: Any, value: Any) -> Any:
    """Return the value of type `kind` from JSON's form or `txt1.telemetry.exact`'s; None stays None."""
    return _reader(kind)(value)


@cache
def _reader(kind: Any) -> Convert:
    """Return the function that makes a value of type `kind`, or None, from its JSON form."""
    read = _make_reader(kind)
    return lambda value: None if value is None else read(value)


def _make_reader(kind: Any) -> Convert:
    origin, args = get_origin(kind) or kind, get_args(kind)
    # here always a type or None
    if origin in (Union, UnionType):
        return _reader(next(arg for arg in args if arg is not NoneType))
    if origin is Schedule:
        sets = _reader(tuple[GainSet, ...])
        return lambda value: Schedule(sets(value))
    if hasattr(origin, "_fields") or is_dataclass(origin):
        readers = {name: _reader(hint) for name, hint in get_type_hints(origin).items()}
        return lambda value: origin(**{name: readers[name](value[name]) for name in readers.keys() & value.keys()})
    if origin is tuple and args[-1:] == (...,):
        each = _reader(args[0])
        return lambda value: tuple(map(each, value))
    if origin is tuple and args:
        several = tuple(map(_reader, args))
        return lambda value: tuple(read(item) for read, item in zip(several, value, strict=True))
    if isinstance(origin, type) and issubclass(origin, Mapping) and args:
        item_of = _reader(args[1])
        return lambda value: {key: item_of(item) for key, item in value.items()}
    convert: Convert = origin if isinstance(origin, type) and issubclass(origin, (Enum, tuple)) else lambda value: value
    return convert
