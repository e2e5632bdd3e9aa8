"""Frames: header, length, command, data, checksum (thesis 3.5).

0xFA 0xFB | length (data bytes, 0 .. 249) | command | data | checksum high | checksum low
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import Final, NamedTuple

from txt1.protocol.layout import LAYOUTS, Layout, Role
from txt1.protocol.messages import Message

__all__ = ["Role", "checksum", "encode"]

HEADER: Final = b"\xfa\xfb"
DATA_MAX: Final = 249
OVERHEAD: Final = 6  # bytes of a frame that are not data: header, length, command and checksum

# (length, command) of two older messages still sent in the field (one gain set; the PID's terms): safe to ignore
OLD_COMMANDS: Final = frozenset({(24, 0x6B), (16, 0x6D)})


def checksum(data: bytes) -> int:
    """The checksum, 0 .. 65535, of a frame's command and data.

    Pairs of bytes, the first one the high one, are added modulo 65536; an odd last byte is XORed into the low byte. Any
    single flipped bit is noticed; two that cancel out, or two pairs that changed places, are not.
    """
    total = sum(data[0:-1:2]) * 256 + sum(data[1::2])
    return (total ^ data[-1] if len(data) % 2 else total) & 0xFFFF


def encode(message: Message) -> bytes:
    """The frame of a message, values rounded to the nearest count of the wire, ties to the even one.

    An EncodeError names message, field, value and range of a value that is not finite or does not fit its field.
    """
    layout = LAYOUTS.get(type(message))
    if layout is None:
        raise TypeError(f"{message!r} is no message of the protocol")
    data = layout.pack(message)
    body = bytes((layout.command,)) + data
    return HEADER + bytes((len(data),)) + body + checksum(body).to_bytes(2, "big")


class Receivable(NamedTuple):
    """How to check and read a frame of one (length, command) pair."""

    size: int  # bytes of the whole frame
    words: Callable[[bytes, int], tuple[int, ...]]  # pairs of command and data, the odd last byte if any, the checksum
    odd: bool  # whether there is an odd last byte, for the XOR
    read: Callable[[bytes, int], Message]
    message: type[Message] | None


def _receivable(layout: Layout, data: Struct) -> Receivable:
    pairs, odd = divmod(1 + data.size, 2)
    words = Struct(f">{pairs}H{'B' * odd}H").unpack_from
    return Receivable(data.size + OVERHEAD, words, bool(odd), layout.reader(data), layout.message)


def receivable(role: Role) -> dict[bytes, Receivable]:
    """The legal frames of a receiver by their bytes of length and command; anything else is no frame."""
    return {
        bytes((data.size, layout.command)): _receivable(layout, data)
        for layout in LAYOUTS.values()
        if layout.receiver is role
        for data in map(layout.struct, layout.counts)
    }


# any other pair is no frame, and its four bytes tell
ILLEGAL: Final = Receivable(4, Struct("").unpack_from, False, lambda *_: Message(), None)
