"""Bytes in, messages and faults out; no I/O, no clock (thesis 3.5).

The rule: in any stream, every valid frame whose bytes are intact and that is not inside a longer valid frame is
delivered. So a false header costs nothing that follows it: after it the search goes on at its next byte but one. Of two
valid frames that overlap, both are delivered: the sender sent one of them, and nothing tells which.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from struct import Struct
from typing import Final, NamedTuple

from txt1.protocol.layout import HEADER, LAYOUTS, BadValue, Role
from txt1.protocol.messages import Message

# bytes of data in a frame
DATA_MAX: Final = 249
# bytes of a frame that are not data: header, length, command and checksum
OVERHEAD: Final = 6
# bytes of a faulty frame that are kept for the reader
HEAD: Final = 8

# (length, command) of two older messages still sent in the field (one gain set; the PID's terms): safe to ignore
OLD_COMMANDS: Final = frozenset({(24, 0x6B), (16, 0x6D)})


class Reason(Enum):
    """Why something that began like a frame is no message."""

    BAD_CHECKSUM = "bad checksum"
    # the command exists, but not with this length; or no frame is that long
    BAD_LENGTH = "bad length"
    # this end of the line does not receive such a command
    UNKNOWN_COMMAND = "unknown command"
    # one of OLD_COMMANDS: expected from boards and hosts in the field, ignored
    OLD_COMMAND = "old command"
    # the frame is intact, but a byte of it stands for nothing, such as switch 7
    BAD_VALUE = "bad value"
    # the line fell silent in the middle of it
    EXPIRED = "expired"


@dataclass(frozen=True, slots=True)
class FrameFault:
    """Something that began like a frame at this byte of the stream and is no message."""

    reason: Reason
    offset: int
    # its first ones, at most 8: header, length, command and some data, as far as they were there
    head: bytes


Event = Message | FrameFault


class Receivable(NamedTuple):
    """How to check and read a frame of one (length, command) pair."""

    # bytes of the whole frame
    size: int
    # pairs of command and data, the odd last byte if any, the checksum
    words: Callable[[bytes, int], tuple[int, ...]]
    # whether there is an odd last byte, for the XOR
    odd: bool
    read: Callable[[bytes, int], Message]
    message: type[Message] | None


def receivable(role: Role) -> dict[bytes, Receivable]:
    """The legal frames of a receiver by their bytes of length and command; anything else is no frame."""
    table = {}
    for layout in LAYOUTS.values():
        for data in map(layout.struct, layout.counts if layout.receiver is role else ()):
            pairs, odd = divmod(1 + data.size, 2)
            words = Struct(f">{pairs}H{'B' * odd}H").unpack_from
            legal = Receivable(data.size + OVERHEAD, words, bool(odd), layout.reader(data), layout.message)
            table[bytes((data.size, layout.command))] = legal
    return table


# any other pair is no frame, and its four bytes tell
ILLEGAL: Final = Receivable(4, Struct("").unpack_from, False, lambda *_: Message(), None)


class Decoder:
    """The frames of a stream, as one end of the line receives them.

    `Decoder(Role.HOST)` understands what boards send, `Decoder(Role.BOARD)` what hosts send. It keeps no more than one
    unfinished frame, at most 241 bytes, whatever comes in, and takes time proportional to the bytes. `messages` and
    `faults` count what was delivered, by type and reason.
    """

    def __init__(self, role: Role) -> None:
        self.role = role
        self.position = 0  # bytes fed so far
        # where in the stream each event of the last `feed` or `expire` began
        self.offsets: list[int] = []
        self._table = receivable(role)
        self.messages = {legal.message: 0 for legal in self._table.values() if legal.message is not None}
        self.faults = dict.fromkeys(Reason, 0)
        # bytes that are part of no intact frame: noise, damaged frames and foreign ones
        self.skipped = 0
        self._commands = {pair[1] for pair in self._table}
        self._tail = b""
        # fewer bytes than this decide nothing
        self._wanted = 0
        # the stream up to here is in an intact frame or counted as skipped
        self._settled = 0

    @property
    def pending(self) -> int:
        """Bytes held back because they may be the beginning of a frame."""
        return len(self._tail)

    def feed(self, data: bytes | bytearray | memoryview) -> list[Event]:
        """The messages and faults that these bytes complete, in the order of the stream."""
        self.position += len(data)
        stream = self._tail + data
        if len(stream) < self._wanted:
            self._tail = stream
            self.offsets = []
            return []
        return self._scan(stream, final=False)

    def expire(self) -> list[Event]:
        """Give up on a half frame: its beginnings are faults EXPIRED, whole frames behind a false header count."""
        return self._scan(self._tail, final=True)

    def _scan(self, stream: bytes, *, final: bool) -> list[Event]:
        """The events in the bytes held back and the new ones; the unfinished rest is kept unless this is final."""
        events: list[Event] = []
        offsets: list[int] = []
        table, messages, size = self._table, self.messages, len(stream)
        base = self.position - size
        settled = self._settled - base
        # finds all headers at once; what follows is after that of each piece
        before, *pieces = stream.split(HEADER)
        at = following = len(before)
        pair = None
        for piece in pieces:
            at = following
            following = at + 2 + len(piece)
            # most frames are of the same kind as the one before
            if piece[:2] != pair:
                pair = piece[:2]
                length, unpack, odd, read, message = table.get(pair, ILLEGAL)
            end = at + length
            if end > size:
                if not final:
                    self._wanted = length
                    break
                reason, end = Reason.EXPIRED, size
            elif message is None:
                reason = self._why_illegal(stream[at + 2], stream[at + 3])
            else:
                words = unpack(stream, at + 3)
                check = words[-1]
                last = words[-2] if odd else 0
                if (sum(words) - check - last ^ last) & 0xFFFF == check:
                    # else it is inside a longer one
                    if end > settled:
                        if at > settled:
                            self.skipped += at - settled
                        settled = end
                        offsets.append(base + at)
                        try:
                            events.append(read(stream, at + 4))
                            messages[message] += 1
                        except BadValue:
                            events.append(self._fault(Reason.BAD_VALUE, base + at, stream[at:end]))
                    continue
                reason = Reason.BAD_CHECKSUM
            # what only looks like a header inside an intact frame is none
            if at >= settled:
                events.append(self._fault(reason, base + at, stream[at : min(end, at + HEAD)]))
                offsets.append(base + at)
        else:
            self._wanted = 0
            at = size
            if stream.endswith(HEADER[:1]):
                if not final:
                    at = size - 1
                elif size > settled:
                    events.append(self._fault(Reason.EXPIRED, base + size - 1, HEADER[:1]))
                    offsets.append(base + size - 1)
        if at > settled:
            self.skipped += at - settled
            settled = at
        self._settled = base + settled
        self._tail = stream[at:]
        self.offsets = offsets
        return events

    def _why_illegal(self, length: int, command: int) -> Reason:
        """What is wrong with a length and command that are not in the table."""
        if (length, command) in OLD_COMMANDS:
            return Reason.OLD_COMMAND
        return Reason.BAD_LENGTH if length > DATA_MAX or command in self._commands else Reason.UNKNOWN_COMMAND

    def _fault(self, reason: Reason, offset: int, head: bytes) -> FrameFault:
        self.faults[reason] += 1
        return FrameFault(reason, offset, head)
