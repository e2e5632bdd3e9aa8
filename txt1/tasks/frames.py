"""A Snapshot as one line of JSON and back, exact for every value.

Named tuples become arrays in the order of their fields, so a line is short and writing one is a single call
into the C encoder. Reading follows the type hints: a field added to the Snapshot needs nothing here.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from txt1.control.schedule import GainSet, Schedule
from txt1.tasks.fields import Snapshot


def encode(snapshot: Snapshot) -> bytes:
    """The snapshot as one line of ASCII, newline included."""
    pieces: list[str] = []
    start = 0
    for place, (known, text) in _SELDOM.items():
        value = snapshot[place]
        if value is not known:
            text = _ENCODER.encode(value)
            _SELDOM[place] = value, text
        pieces += _ENCODER.encode(snapshot[start:place])[1:-1], text
        start = place + 1
    pieces.append(_ENCODER.encode(snapshot[start:])[1:-1])
    return f"[{','.join(pieces)}]\n".encode("ascii")


def decode(line: bytes) -> Snapshot:
    """The snapshot a line was made from.

    Raises:
        ValueError: the line is not a snapshot.

    """
    try:
        snapshot = _reader(Snapshot)(json.loads(line))
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"not a snapshot: {error}") from error
    assert isinstance(snapshot, Snapshot)
    return snapshot


def _plain(value: object) -> object:
    """What JSON has no word for, as arrays."""
    if isinstance(value, Schedule):
        return value.sets
    if is_dataclass(value):
        return [getattr(value, field.name) for field in fields(value)]
    raise TypeError(f"{type(value).__name__} has no place in a snapshot")


_ENCODER = json.JSONEncoder(default=_plain, separators=(",", ":"))

_SELDOM: dict[int, tuple[object, str]] = {
    Snapshot._fields.index(name): (None, "null") for name in ("capabilities", "gains")
}
"""The places of fields that stay the same object for long, with the last ones and their JSON: half of the work."""

Reader = Callable[[Any], Any]


@cache
def _reader(kind: Any) -> Reader:
    """The function that makes a value of type `kind` from its JSON."""
    origin, args = get_origin(kind), get_args(kind)
    if kind is Schedule:
        sets = _reader(tuple[GainSet, ...])
        return lambda value: Schedule(sets(value))
    if origin in (Union, UnionType):  # here always "something or None"
        (inner,) = (_reader(arg) for arg in args if arg is not NoneType)
        return lambda value: None if value is None else inner(value)
    if origin is tuple and args[-1] is ...:
        each = _reader(args[0])
        return lambda value: tuple(map(each, value))
    if origin is tuple:
        return _sequence(tuple, tuple(map(_reader, args)))
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        hints = get_type_hints(kind)
        return _sequence(lambda values: kind(*values), tuple(map(_reader, hints.values())))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind
    return lambda value: value


def _sequence(make: Reader, readers: tuple[Reader, ...]) -> Reader:
    """The function that reads an array, each element by its own reader."""

    def read(values: Any) -> Any:
        return make([reader(value) for reader, value in zip(readers, values, strict=True)])

    return read
