"""Messages as records of an MCAP file, in the order in which they were told.

How it works
============

Everything a robot tells comes as a triple of time, topic and value. `Encoder.take` makes one MCAP message record of
each, and `Encoder.block` joins all that it made to a `Block`, which a file takes as a chunk and the live view sends on.
A record is a head of fixed length (opcode, length, channel number, sequence number, and the time twice) and the message
as CDR (`txt1.record.cdr`). Most messages begin with a time stamp, and that is the record's time as well.

Two kinds of topics lead to two ways of making a record, chosen once a topic:

- A topic with `paths` tells nothing but numbers, such as odometry: all its messages have the same length, and only some
  numbers in them differ. So the record is laid out once with everything constant in it, and each message is a copy of
  it into which the numbers are put. Two of three messages are of this kind, and they are the longest: an odometry has
  72 covariances. Otherwise each of them would be written by itself.
- Every other topic has texts or sequences. Its messages are written field by field, by the message's definition.

"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final, NamedTuple

from txt1.errors import RecordingError
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.record.cdr import HEADER, MessageBuffer, encode
from txt1.telemetry.messages import fields
from txt1.telemetry.topics import Topic

RECORD: Final = struct.Struct("<BQHIQQ")
"""The head of an MCAP message record: opcode, length, channel, sequence, log time, publish time."""
MESSAGE: Final = 5
_BEHIND_LENGTH: Final = RECORD.size - 9
_HEAD: Final = struct.Struct("<BQHI16s")
"""The same, with both times as bytes."""
_VARYING: Final = ((11, "I"), (15, "16s"))
"""Offsets and struct codes of a head's changing fields: the sequence number and both times."""
_TIMES: Final = struct.Struct("<QQ")
_STAMP: Final = struct.Struct("<iI")
_STAMPED: Final = ("std_msgs/Header", "builtin_interfaces/Time")
"""Types that begin with a time stamp."""

Message = tuple[float, Topic[Any], Any]
"""Time, s of the run, topic and value."""


class TopicChannel(NamedTuple):
    """A topic in a file: its full name, with the robot's."""

    name: str
    topic: Topic[Any]


@dataclass(frozen=True, slots=True)
class Block:
    """Message records in the order of their happening, with the smallest and the largest log time, ns."""

    data: bytes
    # for each channel the log time (ns) and offset of each record, one behind the other
    index: dict[int, list[int]]
    first: int
    last: int
    # the channels so far, channel number n at place n - 1
    channels: Sequence[TopicChannel]
    # time stamp of the run's start, s since 1970
    epoch: float = 0.0

    @property
    def count(self) -> int:
        """How many messages it holds."""
        return sum(map(len, self.index.values())) // 2

    def messages(self) -> Iterator[tuple[TopicChannel, int, bytes]]:
        """Yield channel, log time in ns, and CDR bytes of every message."""
        data, start = self.data, 0
        while start < len(data):
            _, length, channel, _, time, _ = RECORD.unpack_from(data, start)
            end = start + 9 + length
            yield self.channels[channel - 1], time, data[start + RECORD.size : end]
            start = end


class Encoder:
    """Makes blocks of messages; remembers channels and sequence numbers. `epoch` s are added to the run's time.

    Encoders whose blocks go into one file have their `channels` in common.
    """

    def __init__(
        self,
        epoch: float,
        full_name: Callable[[Topic[Any]], str] = lambda topic: topic.name,
        channels: list[TopicChannel] | None = None,
    ) -> None:
        self.epoch = epoch
        """Time stamp of the run's start, s since 1970."""
        self._full_name = full_name
        self.channels = [] if channels is None else channels
        self._own: dict[Topic[Any], _OwnChannel] = {}
        # of the next block
        self._records: list[bytes | bytearray] = []
        self._stamps: list[int] = []
        self._length = 0

    def take(self, messages: Iterable[Message]) -> None:
        """Make records of messages, for the next block; RecordingError: a value is none of its topic's."""
        own, records, length = self._own, self._records, self._length
        stamp, epoch = 0, nanoseconds(self.epoch)
        known, times, seconds = None, b"", b""
        for time, topic, value in messages:
            channel = own.get(topic) or self._channel(topic)
            try:
                if time != known:
                    known, stamp = time, round(time * NS_PER_S) + epoch
                    self._stamps.append(stamp)
                    times, seconds = _TIMES.pack(stamp, stamp), _STAMP.pack(*divmod(stamp, NS_PER_S))
                record = channel.record(value, channel.sequence, times, seconds)
            except (TypeError, ValueError, IndexError, AttributeError, struct.error) as error:
                raise RecordingError(f"{topic.name}: no {topic.message} can be made of {value!r}: {error}") from error
            channel.sequence += 1
            channel.index += stamp, length
            records.append(record)
            length += len(record)
        self._length = length

    def block(self, messages: Iterable[Message] = ()) -> Block:
        """Return the records made since the last block, those of these messages last; raises RecordingError."""
        self.take(messages)
        index: dict[int, list[int]] = {}
        for channel in self._own.values():
            if channel.index:
                index[channel.number], channel.index = channel.index, []
        stamps, data = self._stamps, b"".join(self._records)
        self._records, self._stamps, self._length = [], [], 0
        return Block(data, index, min(stamps, default=0), max(stamps, default=0), self.channels, self.epoch)

    def _channel(self, topic: Topic[Any]) -> _OwnChannel:
        if topic not in self._own:
            self.channels.append(TopicChannel(self._full_name(topic), topic))
            self._own[topic] = _OwnChannel(topic, len(self.channels))
        return self._own[topic]


_Record = Callable[[Any, int, bytes, bytes], bytes | bytearray]
"""Makes a record of a value, its sequence number, and as bytes its log and publish time and its time stamp."""


class _OwnChannel:
    """A channel of this encoder: its number, the next message's sequence number, and what makes records of values.

    `index` has the log time (ns) and offset of each of its records in the block that is being made.
    """

    def __init__(self, topic: Topic[Any], number: int) -> None:
        self.number, self.sequence = number, 0
        self.index: list[int] = []
        make = _of_numbers if topic.paths else _of_fields
        self.record: _Record = make(topic, number)


def _head(channel: int, length: int, sequence: int = 0, times: bytes = b"") -> bytes:
    return _HEAD.pack(MESSAGE, _BEHIND_LENGTH + length, channel, sequence, times)


def _of_fields(topic: Topic[Any], channel: int) -> _Record:
    """Return the function that writes a topic's records field by field."""
    stamped = fields(topic.message)[0].type in _STAMPED

    def record(value: Any, sequence: int, times: bytes, stamp: bytes) -> bytes:
        values: Any = topic.make(value)
        if not isinstance(values, Mapping):
            values = values._asdict()
        message = encode(topic.message, {**topic.constants, **values})
        if stamped:
            message[len(HEADER) : len(HEADER) + len(stamp)] = stamp
        return _head(channel, len(message), sequence, times) + message

    return record


def _of_numbers(topic: Topic[Any], channel: int) -> _Record:
    """Return the function that puts a topic's numbers into a template of its record.

    One call packs the template's pieces and the numbers between them; a number at a time takes three times as long.
    Zeros at the ends of a piece are struct's padding, as most covariances and unused axes are 0.
    """
    layout = MessageBuffer(topic.message, topic.constants)
    template = _head(channel, len(layout)) + layout
    stamp = next((place for path, (place, _) in layout.places.items() if path.endswith("stamp.sec")), None)
    own = [(RECORD.size + place, code) for place, code in map(layout.places.__getitem__, topic.paths)]
    # place in the template and struct's code of all that differs, in the order in which `record` gathers it
    varying = [*_VARYING, (RECORD.size + (stamp or 0), f"{_STAMP.size}s"), *own]
    used = sorted((*each, which) for which, each in enumerate(varying) if which != 2 or stamp is not None)
    # the pieces come behind it, the first of them last
    form, pieces, order, end = "<", list[bytes](), list[int](), 0
    for place, code, which in (*used, (len(template), "", None)):
        gap = template[end:place]
        piece = gap.strip(b"\0")
        zeros = gap.index(piece)
        form += f"{zeros}x{len(piece)}s{len(gap) - zeros - len(piece)}x" if piece else f"{len(gap)}x"
        if piece:
            pieces.insert(0, piece)
            order.append(-len(pieces))
        if which is not None:
            form += code
            order.append(which)
        end = place + struct.calcsize(f"<{code}")
    pack, in_order = struct.Struct(form).pack, itemgetter(*order)
    make: Callable[[Any], Any] = topic.make

    def record(value: Any, sequence: int, times: bytes, stamp: bytes) -> bytes:
        return pack(*in_order((sequence, times, stamp, *make(value), *pieces)))

    return record
