"""Values as bytes and back, exact to the last bit: a replay gives recorded readings to the robot again.

A value is a tree of numbers, texts, bytes, arrays of numpy's, tuples, mappings, named tuples and dataclasses. It is
written with the names of its fields, and read by the rules of a snapshot (`txt1.telemetry.snapshot.read_as`): unknown
fields are ignored, missing fields have their defaults. A byte before each part gives its type.
"""

import struct
from collections.abc import Callable, Collection, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, Final

import numpy as np

from txt1.telemetry.snapshot import read_as

_COUNT: Final = struct.Struct("<I")
_INTEGER: Final = struct.Struct("<q")
_NUMBER: Final = struct.Struct("<d")


def encode(value: object) -> bytes:
    """Return a value as bytes.

    Raises TypeError for an unsupported type, OverflowError for an integer beyond 64 bits.
    """
    data = bytearray()
    _write(data, value)
    return bytes(data)


def decode(kind: Any, data: bytes) -> Any:
    """Return the value of type `kind` from its bytes.

    Raises ValueError if the bytes do not hold a value of this type.
    """
    try:
        value, end = _read(data, 0)
        if end != len(data):
            raise ValueError(f"{len(data) - end} bytes too many")
        return read_as(kind, value)
    except (struct.error, IndexError, TypeError, KeyError, AttributeError, RecursionError, ValueError) as error:
        raise ValueError(f"no {getattr(kind, '__name__', kind)}: {type(error).__name__}: {error}") from None


# -- writing -----------------------------------------------------------------------------------------------------


def _write(data: bytearray, value: Any) -> None:
    kind: Any = type(value)
    if isinstance(value, float):
        data += b"d" + _NUMBER.pack(value)
    elif value is None or kind is bool:
        data += b"N" if value is None else b"T" if value else b"F"
    elif isinstance(value, Enum):
        _write(data, value.value)
    elif isinstance(value, int):
        data += b"i" + _INTEGER.pack(value) if -(1 << 63) <= value < 1 << 63 else _too_large(value)
    elif isinstance(value, str):
        _write_bytes(data, b"s", value.encode())
    elif isinstance(value, bytes):
        _write_bytes(data, b"b", value)
    elif names := _fields(kind):
        _write_named(data, [(name, each) for name, left in names if (each := getattr(value, name)) is not None or left])
    elif isinstance(value, tuple | list):
        data += b"t" + _COUNT.pack(len(value))
        for each in value:
            _write(data, each)
    elif isinstance(value, Mapping):
        _write_named(data, value.items())
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        _write_bytes(data, b"a", value.dtype.str.encode())
        _write(data, value.shape)
        _write_bytes(data, b"", value.tobytes())
    elif isinstance(value, np.generic):
        _write(data, value.item())
    else:
        raise TypeError(f"{kind.__name__} has no exact bytes")


def _write_named(data: bytearray, parts: Collection[tuple[str, Any]]) -> None:
    data += b"o" + _COUNT.pack(len(parts))
    for name, each in parts:
        _write_bytes(data, b"", name.encode())
        _write(data, each)


def _too_large(value: int) -> bytes:
    raise OverflowError(f"an integer of {value.bit_length()} bits has no exact bytes")


def _write_bytes(data: bytearray, mark: bytes, piece: bytes) -> None:
    data += mark + _COUNT.pack(len(piece)) + piece


@cache
def _fields(kind: Any) -> tuple[tuple[str, bool], ...]:
    """Return the fields of a type: name, and whether a value None is written. The result is empty for a type without
    fields.
    """
    if is_dataclass(kind):
        return tuple((field.name, field.default is not None) for field in fields(kind))
    defaults: Mapping[str, object] = getattr(kind, "_field_defaults", {})
    return tuple((name, defaults.get(name, ...) is not None) for name in getattr(kind, "_fields", ()))


# -- reading -----------------------------------------------------------------------------------------------------


def _read(data: bytes, at: int) -> tuple[Any, int]:
    """Return the part that begins at offset `at`, and the offset of its end."""
    return _READERS[data[at : at + 1]](data, at + 1)


def _read_bytes(data: bytes, at: int) -> tuple[bytes, int]:
    (count,) = _COUNT.unpack_from(data, at)
    begin, end = at + 4, at + 4 + count
    if end > len(data):
        raise ValueError("it breaks off")
    return data[begin:end], end


def _read_text(data: bytes, at: int) -> tuple[str, int]:
    piece, end = _read_bytes(data, at)
    return piece.decode(), end


def _read_object(data: bytes, at: int) -> tuple[dict[str, Any], int]:
    (count,), at = _COUNT.unpack_from(data, at), at + 4
    found = {}
    for _ in range(count):
        name, at = _read_text(data, at)
        found[name], at = _read(data, at)
    return found, at


def _read_tuple(data: bytes, at: int) -> tuple[list[Any], int]:
    (count,), at = _COUNT.unpack_from(data, at), at + 4
    found = []
    for _ in range(count):
        each, at = _read(data, at)
        found.append(each)
    return found, at


def _read_array(data: bytes, at: int) -> tuple[Any, int]:
    kind, at = _read_text(data, at)
    shape, at = _read(data, at)
    piece, at = _read_bytes(data, at)
    return np.frombuffer(piece, kind).reshape(shape), at


_READERS: Final[dict[bytes, Callable[[bytes, int], tuple[Any, int]]]] = {
    b"N": lambda data, at: (None, at),
    b"T": lambda data, at: (True, at),
    b"F": lambda data, at: (False, at),
    b"i": lambda data, at: (_INTEGER.unpack_from(data, at)[0], at + 8),
    b"d": lambda data, at: (_NUMBER.unpack_from(data, at)[0], at + 8),
    b"s": _read_text,
    b"b": _read_bytes,
    b"t": _read_tuple,
    b"o": _read_object,
    b"a": _read_array,
}
