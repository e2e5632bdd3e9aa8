"""ROS 2 messages as bytes: CDR, little-endian, as the DDS standard's plain encoding lays it out."""

import struct
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Final

from txt1.telemetry.messages import Field, fields

# CDR, little-endian; alignment counts from the byte behind it
HEADER: Final = b"\x00\x01\x00\x00"

CODES: Final = {
    "bool": "?", "byte": "B", "int8": "b", "uint8": "B", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f",
    "float64": "d",
}  # fmt: skip

_LENGTH: Final = struct.Struct("<I")
_PADDING: Final = tuple(map(bytes, range(8)))


class MessageBuffer(bytearray):
    """A message in the making, which begins as `HEADER`."""

    def __init__(self, message: str, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(HEADER)
        self.places: dict[str, tuple[int, str]] = {}
        """For every number's path, such as "header.stamp.sec", its offset in the bytes and its struct code."""
        _writer(message)(self, values or {}, "", self.places)


Places = dict[str, tuple[int, str]] | None
_Write = Callable[[bytearray, Any, str, Places], None]
"""Adds a value, None for nothing but zeros, to a message; notes where its numbers are, where that is wanted."""


def encode(message: str, values: Mapping[str, Any], begun: bytes = b"") -> bytearray:
    """Return one message as CDR, from values nested like the message; omitted fields are 0, empty or none.

    If it was `begun` with its first field, the others are added.
    """
    data = bytearray(begun or HEADER)
    _writer(message, 1 if begun else 0)(data, values, "", None)
    return data


def begin(message: str, values: Mapping[str, Any]) -> bytes:
    """Return a message as far as its first field."""
    first, data = fields(message)[0], bytearray(HEADER)
    _part(message, first)(data, values.get(first.name), "", None)
    return bytes(data)


def _part(message: str, field: Field) -> _Write:
    return _array_writer(message, field) if field.array else _writer(field.type)


@cache
def _writer(kind: str, begun: int = 0) -> _Write:
    """Return the function that writes a value of this type: a number's, ``string`` or ``package/Name``.

    So many of its fields are written already.
    """
    if kind == "string":
        return _write_text
    if kind in CODES:
        return _number_writer(CODES[kind])
    parts = [(field.name, _part(kind, field)) for field in fields(kind)[begun:]]

    def write(data: bytearray, value: Any, path: str, places: Places) -> None:
        values = value or {}
        for name, part in parts:
            here = f"{path}.{name}" if path and places is not None else name
            part(data, values.get(name), here, places)

    return write


def _number_writer(code: str) -> _Write:
    number = struct.Struct(f"<{code}")
    size, pack = number.size, number.pack

    def write(data: bytearray, value: Any, path: str, places: Places) -> None:
        data += _PADDING[(len(HEADER) - len(data)) % size]
        if places is not None:
            places[path] = len(data), code
        data += pack(value or 0)

    return write


def _write_text(data: bytearray, value: Any, path: str, places: Places) -> None:
    del path, places
    encoded = (value or "").encode()
    data += _PADDING[-len(data) % 4] + _LENGTH.pack(len(encoded) + 1) + encoded + b"\0"


def _array_writer(message: str, field: Field) -> _Write:
    """Return the function that writes an array, or a sequence with its length first."""
    element, code = _writer(field.type), CODES.get(field.type)
    size = 0 if code is None else struct.calcsize(code)

    def write(data: bytearray, value: Any, path: str, places: Places) -> None:
        values = (None,) * (field.length or 0) if value is None else value
        if field.length is None:
            data += _PADDING[-len(data) % 4]
            data += _LENGTH.pack(len(values))
        elif len(values) != field.length:
            raise ValueError(f"{message}.{field.name} takes {field.length} values, not {len(values)}")
        if code is not None and places is None and value is not None:
            if values:
                data += _PADDING[(len(HEADER) - len(data)) % size]
                data += values if isinstance(values, bytes) else struct.pack(f"<{len(values)}{code}", *values)
            return
        for index, each in enumerate(values):
            element(data, each, f"{path}.{index}", places)

    return write
