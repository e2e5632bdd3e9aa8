"""Describe a capture of the serial line: a line of text, or a JSON object, for each message and fault (thesis 3.5)."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import fields
from enum import Enum
from typing import Any

from txt1.errors import CaptureError
from txt1.protocol.decoder import Decoder, Event, FrameFault


def decode(decoder: Decoder, reads: Iterable[bytes]) -> Iterator[tuple[int, Event]]:
    """Yield each event of a capture and its offset in the stream, in bytes.

    The end of the capture counts as silence.
    """
    for read in reads:
        events = decoder.feed(read)
        yield from zip(decoder.offsets, events, strict=True)
    last = decoder.expire()
    yield from zip(decoder.offsets, last, strict=True)


def as_dict(offset: int, event: Event) -> dict[str, Any]:
    """Return an event as a JSON object: offset, type (the message's name, or FrameFault), and the fields in SI units.

    The fields of a FrameFault are the reason, and its first bytes as hexadecimal text.
    """
    if isinstance(event, FrameFault):
        values: dict[str, Any] = {"reason": event.reason.value, "head": event.head.hex(" ").upper()}
    else:
        values = {field.name: _plain(getattr(event, field.name)) for field in fields(event)}
    return {"offset": offset, "type": type(event).__name__, **values}


def describe(offset: int, event: Event) -> str:
    """Return an event as a line of text: the offset, the type, and the fields in SI units."""
    values = as_dict(offset, event)
    if isinstance(event, FrameFault):
        return f"{offset:8d}  fault: {values['reason']}  [{values['head']}]"
    return f"{offset:8d}  {values['type']}  {' '.join(f'{name}={values[name]}' for name in list(values)[2:])}"


def summary(decoder: Decoder) -> str:
    """Return a line of totals: bytes, messages by type, faults by reason, and bytes outside intact frames."""
    counts = {message.__name__: count for message, count in decoder.messages.items()}
    counts |= {reason.value: count for reason, count in decoder.faults.items()}
    parts = [f"{count} {name}" for name, count in counts.items() if count]
    return ", ".join((f"{decoder.position} bytes", *parts, f"{decoder.skipped} bytes in no frame"))


def read_hex(lines: Iterable[str]) -> Iterator[bytes]:
    """Yield the bytes of each line of hexadecimal text.

    Bytes may stand together (FAFB04) or be separated by blanks or commas, with or without 0x. A # begins a comment.
    Raises CaptureError for half a byte or a character that is no hexadecimal digit; it names line and column, from 1.
    """
    for number, line in enumerate(lines, 1):
        digits = ""
        for token in re.finditer(r"(?:0[xX])?([^\s,]*)", line.partition("#")[0]):
            wrong = re.search("[^0-9a-fA-F]", token[1])
            if wrong is not None:
                place = f"line {number}, column {token.start(1) + wrong.start() + 1}"
                raise CaptureError(f"{place}: {wrong[0]!r} is no hexadecimal digit")
            if len(token[1]) % 2 or (token[0] and not token[1]):
                why = f"'{token[0]}' ends in half a byte: write two digits for each"
                raise CaptureError(f"line {number}, column {token.start() + 1}: {why}")
            digits += token[1]
        yield bytes.fromhex(digits)


def _plain(value: Any) -> Any:
    """Return a field's value for JSON: a switch as its name, gain sets as lists."""
    if isinstance(value, Enum):
        return value.name
    return [_plain(each) for each in value] if isinstance(value, tuple) else value
