"""The VRPN protocol (version 7), as far as trackers need it: encodes and decodes messages. No I/O.

Each side first sends a cookie of 24 bytes, then messages. A message is a head, a sequence number, and a body that is
padded to a multiple of 8 bytes. The head is five big-endian int32: the length of head and body without the padding, the
time in s and us, the sender, and the type. Each side numbers senders and types in its own way. Messages of type -1 and
-2 give the names for these numbers.
"""

import struct
from typing import Final, NamedTuple

from txt1.errors import HalError

PORT: Final = 3883
COOKIE: Final = b"vrpn: ver. 07.35  0".ljust(24, b"\0")
MAJOR: Final = b"vrpn: ver. 07."
HEAD: Final = struct.Struct(">iiiiii")
# sensor, padding, position, quaternion x y z w
POSE: Final = struct.Struct(">ii3d4d")
SENDER_NAME: Final = -1
TYPE_NAME: Final = -2
POSE_TYPE: Final = "vrpn_Tracker Pos_Quat"
PING_TYPE: Final = "vrpn_Base ping_message"
PONG_TYPE: Final = "vrpn_Base pong_message"
# bytes; a tracker's longest message has 72
BODY_MAX: Final = 65536


class VrpnMessage(NamedTuple):
    """A message; its numbers are those of the sending side."""

    # s by the sending side's clock
    time: float
    sender: int
    type: int
    body: bytes


def pack(message: VrpnMessage) -> bytes:
    """Return a message as bytes. The sequence number stays 0, as no receiver uses it."""
    us = round(message.time * 1e6)
    head = HEAD.pack(HEAD.size + len(message.body), us // 1_000_000, us % 1_000_000, message.sender, message.type, 0)
    return head + message.body + bytes(-len(message.body) % 8)


def name_message(kind: int, number: int, name: str) -> VrpnMessage:
    """Return the message with the name of a sender (`SENDER_NAME`) or type (`TYPE_NAME`)."""
    text = name.encode() + b"\0"
    return VrpnMessage(0.0, number, kind, struct.pack(">i", len(text)) + text)


class Splitter:
    """Splits a stream into the cookie and messages; raises HalError if the version is not 7."""

    def __init__(self) -> None:
        self._rest = b""
        self._greeted = False

    def feed(self, data: bytes) -> list[VrpnMessage]:
        """Take bytes; return the messages that they complete."""
        data, at, found = self._rest + data, 0, []
        if not self._greeted:
            start = data[: len(MAJOR)]
            if start != MAJOR[: len(start)]:
                raise HalError(f"no VRPN server of version 7 is there: it begins with {start!r}; check the port")
            if len(data) < len(COOKIE):
                self._rest = data
                return []
            self._greeted, at = True, len(COOKIE)
        while len(data) - at >= HEAD.size:
            length, seconds, us, sender, kind, _ = HEAD.unpack_from(data, at)
            if not HEAD.size <= length <= HEAD.size + BODY_MAX:
                raise HalError(f"the VRPN stream is out of step: a message of {length} bytes")
            end = at + length + -length % 8
            if end > len(data):
                break
            found.append(VrpnMessage(seconds + us * 1e-6, sender, kind, data[at + HEAD.size : at + length]))
            at = end
        self._rest = data[at:]
        return found


class Names:
    """The names for the other side's numbers, from its messages."""

    def __init__(self) -> None:
        self.senders: dict[int, str] = {}
        self.types: dict[int, str] = {}

    def note(self, message: VrpnMessage) -> bool:
        """Store the name in a message; return whether the message has one."""
        names = {SENDER_NAME: self.senders, TYPE_NAME: self.types}.get(message.type)
        if names is None:
            return False
        names[message.sender] = message.body[4:].partition(b"\0")[0].decode("utf-8", "replace")
        return True
