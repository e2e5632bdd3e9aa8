"""A capture of the line in words: one text line, or one object for JSON, per message and fault (thesis 3.5)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import fields
from enum import Enum
from string import hexdigits
from typing import Any

from txt1.errors import CaptureError
from txt1.protocol.decoder import Decoder, Event, FrameFault


def decode(decoder: Decoder, reads: Iterable[bytes]) -> Iterator[tuple[int, Event]]:
    """Every event of a capture with its offset in the stream, bytes; the end of the capture counts as silence."""
    for read in reads:
        events = decoder.feed(read)
        yield from zip(decoder.offsets, events, strict=True)
    events = decoder.expire()
    yield from zip(decoder.offsets, events, strict=True)


def describe(offset: int, event: Event) -> str:
    """One line of text: the offset, what it is, and its fields in SI units."""
    if isinstance(event, FrameFault):
        return f"{offset:8d}  fault: {event.reason.value}  [{event.head.hex(' ').upper()}]"
    values = (f"{field.name}={_plain(getattr(event, field.name))}" for field in fields(event))
    return f"{offset:8d}  {type(event).__name__}  {' '.join(values)}"


def as_dict(offset: int, event: Event) -> dict[str, Any]:
    """An object for JSON: offset, type (the message's name, or FrameFault), and the fields in SI units.

    A fault has a reason in words and its first bytes as hexadecimal text.
    """
    if isinstance(event, FrameFault):
        return {
            "offset": offset,
            "type": "FrameFault",
            "reason": event.reason.value,
            "head": event.head.hex(" ").upper(),
        }
    values = {field.name: _plain(getattr(event, field.name)) for field in fields(event)}
    return {"offset": offset, "type": type(event).__name__, **values}


def as_json(offset: int, event: Event) -> str:
    """The same object as one line of JSON."""
    return json.dumps(as_dict(offset, event))


def summary(decoder: Decoder) -> str:
    """One line: bytes, messages by type, faults by reason, and bytes that are part of no intact frame."""
    counts = {message.__name__: count for message, count in decoder.messages.items()}
    counts |= {reason.value: count for reason, count in decoder.faults.items()}
    parts = [f"{count} {name}" for name, count in counts.items() if count]
    return ", ".join((f"{decoder.position} bytes", *parts, f"{decoder.skipped} bytes in no frame"))


def read_hex(lines: Iterable[str]) -> Iterator[bytes]:
    """The bytes of each line of hexadecimal text.

    Bytes may stand together (FAFB04) or be parted by blanks or commas, with or without 0x; what follows a # is a
    comment.

    Raises:
        CaptureError: something is no hexadecimal digit, or half a byte is left over; it names line and column, from 1.

    """
    for number, line in enumerate(lines, 1):
        yield _read_line(number, line.partition("#")[0].replace(",", " "))


def _read_line(number: int, line: str) -> bytes:
    read = bytearray()
    column = 1
    for token in line.split():
        column = line.index(token, column - 1) + 1
        digits = token[2:] if token[:2] in ("0x", "0X") else token
        skipped = len(token) - len(digits)
        for place, digit in enumerate(digits, column + skipped):
            if digit not in hexdigits:
                raise CaptureError(number, place, f"{digit!r} is no hexadecimal digit")
        if len(digits) % 2 or not digits:
            raise CaptureError(number, column, f"'{token}' ends in half a byte: write two digits for each")
        read += bytes.fromhex(digits)
        column += len(token)
    return bytes(read)


def _plain(value: Any) -> Any:
    """A field's value as JSON knows it: a switch by its name, gain sets as lists."""
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return value
