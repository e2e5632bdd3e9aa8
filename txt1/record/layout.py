"""ROS 2 messages as bytes: CDR, little-endian, as the DDS standard's plain encoding lays it out.

A message whose strings and sequence lengths are known is a fixed pattern of bytes with numbers at known places. Such
a `Layout` is made once; then a message costs one call of struct, or many messages a few calls of numpy.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from txt1.record.definitions import DEFINITIONS, fields

HEADER: Final = b"\x00\x01\x00\x00"
"""CDR, little-endian; alignment counts from the byte behind it."""

CODES: Final = {
    "bool": "?", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d",
}  # fmt: skip


class Layout:
    """Where the numbers of a message are, given its strings and lengths.

    Args:
        message: ``package/Name``.
        values: what is known of it, nested like the message: strings, lists as long as its sequences, and numbers
            that differ from 0. Bytes and numpy's arrays, of numbers of the very size, go in as they are.

    Attributes:
        template: the message as bytes, with these values.
        places: for every number's path, such as "header.stamp.sec", its offset in the bytes and its struct code.

    """

    def __init__(self, message: str, values: Mapping[str, Any] | None = None) -> None:
        self._bytes = bytearray(HEADER)
        self.places: dict[str, tuple[int, str]] = {}
        self._message(message, values or {}, "")
        self.template = bytes(self._bytes)

    def _message(self, message: str, values: Mapping[str, Any], path: str) -> None:
        for field in fields(message):
            here, value = path + field.name, values.get(field.name)
            if not field.array:
                self._one(field.type, value, here)
                continue
            elements: Sequence[Any] | np.ndarray[Any, Any] = [None] * (field.length or 0) if value is None else value
            if field.length is None:
                self._number("I", len(elements))
            elif len(elements) != field.length:
                raise ValueError(f"{message}.{field.name} takes {field.length} values, not {len(elements)}")
            if isinstance(elements, bytes):
                self._bytes += elements
                continue
            if isinstance(elements, np.ndarray):
                self._align(elements.itemsize)
                self._bytes += elements.astype(f"<{CODES[field.type]}").tobytes()
                continue
            for index, element in enumerate(elements):
                self._one(field.type, element, f"{here}.{index}")

    def _one(self, kind: str, value: Any, path: str) -> None:
        if kind in DEFINITIONS:
            self._message(kind, {} if value is None else value, path + ".")
        elif kind == "string":
            text = ("" if value is None else value).encode() + b"\x00"
            self._number("I", len(text))
            self._bytes += text
        else:
            code = CODES[kind]
            self.places[path] = self._number(code, 0 if value is None else value), code

    def _align(self, size: int) -> None:
        self._bytes += bytes(-(len(self._bytes) - len(HEADER)) % size)

    def _number(self, code: str, value: Any) -> int:
        size = struct.calcsize(code)
        self._align(size)
        self._bytes += struct.pack(f"<{code}", value)
        return len(self._bytes) - size

    def filler(self, *paths: str) -> Callable[..., bytes]:
        """A function of these numbers, given in the order in which they stand, that makes a message with them."""
        text, end, pieces = "<", 0, []
        for path in paths:
            offset, code = self.places[path]
            if offset < end:
                raise ValueError(f"{path} stands before the number named ahead of it")
            text += f"{offset - end}s{code}"
            pieces.append(self.template[end:offset])
            end = offset + struct.calcsize(code)
        pack = struct.Struct(f"{text}{len(self.template) - end}s").pack
        arguments: list[Any] = [b""] * (2 * len(paths) + 1)
        arguments[::2] = [*pieces, self.template[end:]]

        def fill(*numbers: float) -> bytes:
            arguments[1::2] = numbers
            return pack(*arguments)

        return fill

    def fields_at(self, prefix: str, start: int) -> dict[str, tuple[str, int]]:
        """For a numpy record with this message at byte `start`: format and offset of every number by name."""
        return {f"{prefix}{path}": (f"<{code}", start + offset) for path, (offset, code) in self.places.items()}


def encode(message: str, values: Mapping[str, Any]) -> bytes:
    """One message as CDR, from values nested like the message; what is left out is 0, empty or none."""
    return Layout(message, values).template


def record_type(parts: Sequence[tuple[str, Layout, int]], size: int) -> np.dtype[Any]:
    """The numpy record of `size` bytes that holds several messages: (prefix of its names, layout, offset) each."""
    places: dict[str, tuple[str, int]] = {}
    for prefix, layout, start in parts:
        places |= layout.fields_at(prefix, start)
    return np.dtype(
        {
            "names": list(places),
            "formats": [code for code, _ in places.values()],
            "offsets": [offset for _, offset in places.values()],
            "itemsize": size,
        }
    )
