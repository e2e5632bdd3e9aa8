"""ROS 2 messages as bytes: CDR, little-endian, as the DDS standard's plain encoding lays it out.

A message whose strings and sequence lengths are known is a fixed pattern of bytes with numbers at known places. Such
a `Layout` is made once; then a message, or several behind one another, costs one call of struct.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from txt1.record.definitions import fields

HEADER: Final = b"\x00\x01\x00\x00"
"""CDR, little-endian; alignment counts from the byte behind it."""

CODES: Final = {
    "bool": "?", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d",
}  # fmt: skip

STRUCTS: Final = {code: struct.Struct(f"<{code}") for code in CODES.values()}
LENGTH: Final = STRUCTS["I"]
"""Of a string, with its zero, or of a sequence."""
PADDING: Final = (b"", b"\0", b"\0\0", b"\0\0\0")


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
                add_length(self._bytes, len(elements))
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
        if kind == "string":
            add_text(self._bytes, "" if value is None else value)
        elif kind in CODES:
            code = CODES[kind]
            self.places[path] = self._number(code, 0 if value is None else value), code
        else:
            self._message(kind, {} if value is None else value, path + ".")

    def _align(self, size: int) -> None:
        self._bytes += bytes(-(len(self._bytes) - len(HEADER)) % size)

    def _number(self, code: str, value: Any) -> int:
        number = STRUCTS[code]
        self._align(number.size)
        self._bytes += number.pack(value)
        return len(self._bytes) - number.size

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


def add_length(data: bytearray, length: int) -> None:
    """Add the length of a sequence to a message."""
    data += PADDING[-len(data) % 4]
    data += LENGTH.pack(length)


def add_text(data: bytearray, text: str) -> None:
    """Add a string to a message."""
    encoded = text.encode()
    data += PADDING[-len(data) % 4]
    data += LENGTH.pack(len(encoded) + 1)
    data += encoded
    data += b"\0"


def encode(message: str, values: Mapping[str, Any]) -> bytes:
    """One message as CDR, from values nested like the message; what is left out is 0, empty or none."""
    return Layout(message, values).template


def packer(template: bytes, places: Iterable[tuple[int, str]]) -> tuple[Callable[..., bytes], list[bytes]]:
    """The quickest way to fill in a template, and the constants that go with it.

    Args:
        template: what stands between the values.
        places: of the values, in the order in which they stand: offset and struct code.

    Returns:
        What makes bytes of the values in order, and what it wants among them: ahead of a value, and at the end, the
        bytes in between, unless there are none or only zeros.

    """
    text, end, constants = "<", 0, []
    for offset, code in [*places, (len(template), "")]:
        between = template[end:offset]
        if any(between):
            text += f"{len(between)}s"
            constants.append(between)
        else:
            text += f"{len(between)}x"
        text += code
        end = offset + struct.calcsize(f"<{code}")
    return struct.Struct(text).pack, constants
