"""Bytes in, messages and faults out; no I/O, no clock (thesis 3.5).

The decoder delivers every valid frame of a stream, unless the frame lies inside a longer valid frame. A false header
hides no frame: the search goes on two bytes later. If two valid frames overlap, both are delivered, because the
receiver cannot tell which of the two was sent.
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
KEPT_BYTES: Final = 8

# (length, command) of two obsolete messages that boards and hosts still send (one gain set; the PID's terms)
OLD_COMMANDS: Final = frozenset({(24, 0x6B), (16, 0x6D)})


class Reason(Enum):
    """The reason why a frame was rejected."""

    BAD_CHECKSUM = "bad checksum"
    # the command has no message of this length, or the length exceeds every frame's
    BAD_LENGTH = "bad length"
    # this end of the line does not receive such a command
    UNKNOWN_COMMAND = "unknown command"
    # in OLD_COMMANDS: harmless, ignored
    OLD_COMMAND = "old command"
    # the frame is intact, but a byte of it has no meaning, as switch 7
    BAD_VALUE = "bad value"
    # the line fell silent in the middle of it
    EXPIRED = "expired"


@dataclass(frozen=True, slots=True)
class FrameFault:
    """Bytes that began like a frame, but are no message."""

    reason: Reason
    offset: int
    # the first bytes of the frame, at most 8: header, length, command and some data
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
    """Return the legal frames of a receiver, by their two bytes of length and command."""
    table = {}
    for layout in LAYOUTS.values():
        for data in map(layout.struct, layout.counts if layout.receiver is role else ()):
            pairs, odd = divmod(1 + data.size, 2)
            words = Struct(f">{pairs}H{'B' * odd}H").unpack_from
            legal = Receivable(data.size + OVERHEAD, words, bool(odd), layout.reader(data), layout.message)
            table[bytes((data.size, layout.command))] = legal
    return table


# any other pair is no frame; four bytes are enough to see it
ILLEGAL: Final = Receivable(4, Struct("").unpack_from, False, lambda *_: Message(), None)


class Decoder:
    """The frames of a stream, as one end of the line receives them.

    `Decoder(Role.HOST)` decodes messages from boards, `Decoder(Role.BOARD)` messages from hosts. It keeps at most one
    unfinished frame (241 bytes), and its time is proportional to the bytes fed. `messages` counts messages by type,
    `faults` counts faults by reason.
    """

    def __init__(self, role: Role, table: dict[bytes, Receivable] | None = None) -> None:
        self.role = role
        self.position = 0  # bytes fed so far
        # offset in the stream of each event that the last `feed` or `expire` returned
        self.offsets: list[int] = []
        # the legal frames, from who makes many decoders
        self._table = receivable(role) if table is None else table
        self.messages = {legal.message: 0 for legal in self._table.values() if legal.message is not None}
        self.faults = dict.fromkeys(Reason, 0)
        # bytes outside intact frames: noise, damaged frames and unknown frames
        self.skipped = 0
        self._commands = {pair[1] for pair in self._table}
        self._tail = b""
        # no decision is possible before this many bytes are held
        self._wanted = 0
        # each byte before this offset is in an intact frame or counted in `skipped`
        self._settled = 0

    @property
    def pending(self) -> int:
        """The number of bytes kept because they may be the beginning of a frame."""
        return len(self._tail)

    def feed(self, data: bytes | bytearray | memoryview) -> list[Event]:
        """Take bytes; return the messages and faults that they complete, in the order of the stream."""
        self.position += len(data)
        stream = self._tail + data
        if len(stream) < self._wanted:
            self._tail = stream
            self.offsets = []
            return []
        return self._scan(stream, final=False)

    def expire(self) -> list[Event]:
        """Give up on an unfinished frame after a silence.

        Returns a fault EXPIRED for each unfinished frame, and the messages whose frames follow a false header.
        """
        return self._scan(self._tail, final=True)

    def _scan(self, stream: bytes, *, final: bool) -> list[Event]:
        """Return the events of the stream. An unfinished frame at its end is kept, unless `final`."""
        events: list[Event] = []
        offsets: list[int] = []
        table, messages, size = self._table, self.messages, len(stream)
        base = self.position - size
        settled = self._settled - base
        # finds all headers at once: each piece after the first follows a header
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
                    # else it is inside a longer frame
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
            # two bytes inside an intact frame that look like a header are data
            if at >= settled:
                events.append(self._fault(reason, base + at, stream[at : min(end, at + KEPT_BYTES)]))
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
        """Return why a length and command are not in the table."""
        if (length, command) in OLD_COMMANDS:
            return Reason.OLD_COMMAND
        return Reason.BAD_LENGTH if length > DATA_MAX or command in self._commands else Reason.UNKNOWN_COMMAND

    def _fault(self, reason: Reason, offset: int, head: bytes) -> FrameFault:
        self.faults[reason] += 1
        return FrameFault(reason, offset, head)
