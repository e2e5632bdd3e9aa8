"""Messages as records of an MCAP file, in the order in which they were told.

How it works
============

Everything a robot tells comes with its time, as topics that are told together and a value of each: a row.
`Encoder.take` makes one MCAP message record of each value, and `Encoder.block` joins all that it made to a `Block`,
which a file takes as a chunk and the live view sends on. A record is a head of fixed length (opcode, length, channel
number, sequence number, and the time twice) and the message as CDR (`txt1.record.cdr`). Most messages begin with a time
stamp, and that is the record's time as well.

Two kinds of topics lead to two ways of making a record, chosen once a topic:

- A topic with `paths` tells nothing but numbers, such as odometry: all its messages have the same length, and only some
  numbers in them differ. So the record is laid out once with everything constant in it, and each message is a copy of
  it into which the numbers are put. Most messages are of this kind, and they are the longest: an odometry has 72
  covariances. Otherwise each of them would be written by itself.
- Every other topic has texts or sequences. Its messages are written field by field, by the message's definition.

A row of several topics is what a robot tells in each of its cycles: seven of eight messages. All of these tell numbers.
Their templates stand one behind the other, and all their numbers are put there at once.

"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from operator import itemgetter
from typing import Any, Final, NamedTuple

from txt1.errors import RecordingError
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.record.cdr import HEADER, MessageBuffer, begin, encode
from txt1.telemetry.messages import fields
from txt1.telemetry.topics import Topic

RECORD: Final = struct.Struct("<BQHIQQ")
"""The head of an MCAP message record: opcode, length, channel, sequence, log time, publish time."""
MESSAGE: Final = 5
_BEHIND_LENGTH: Final = RECORD.size - 9
_HEAD: Final = struct.Struct("<BQHI16s")
"""The same, with both times as bytes."""
_SEQUENCE: Final = 11
"""Offset of a head's sequence number; both times follow it."""
_TIMES: Final = struct.Struct("<QQ")
_STAMP: Final = struct.Struct("<iI")
_STAMPED: Final = ("std_msgs/Header", "builtin_interfaces/Time")
"""Types that begin with a time stamp."""

Message = tuple[float, Topic[Any], Any]
"""Time, s of the run, topic and value."""
Told = tuple[float, tuple[Topic[Any], ...], Sequence[Any]]
"""Time, s of the run, and topics that are told together, with their values; several topics tell numbers only."""


class TopicChannel(NamedTuple):
    """A topic in a file: its full name, with the robot's."""

    name: str
    topic: Topic[Any]


@dataclass(frozen=True, slots=True)
class Block:
    """Message records in the order of their happening, with the smallest and the largest log time, ns."""

    data: bytes
    # for each channel the log time (ns) and offset of each record
    index: dict[int, list[tuple[int, int]]]
    first: int
    last: int
    # the channels so far, channel number n at place n - 1
    channels: Sequence[TopicChannel]
    # time stamp of the run's start, s since 1970
    epoch: float = 0.0

    @property
    def count(self) -> int:
        """How many messages it holds."""
        return sum(map(len, self.index.values()))

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
        self._rows: dict[tuple[Topic[Any], ...], _CycleRow] = {}
        # of the next block
        self._records: list[bytes | bytearray] = []
        self._length = 0

    def take(self, told: Iterable[Told]) -> None:
        """Make records of rows, for the next block; RecordingError: a value is none of its topic's."""
        rows, records, length, epoch = self._rows, self._records, self._length, nanoseconds(self.epoch)
        known, stamp, when = None, 0, (b"", b"")
        for time, topics, values in told:
            row = rows.get(topics) or self._row(topics)
            try:
                if time != known:
                    known, stamp = time, round(time * NS_PER_S) + epoch
                    when = _TIMES.pack(stamp, stamp), _STAMP.pack(*divmod(stamp, NS_PER_S))
                record = row.record(values, when)
            except (TypeError, ValueError, IndexError, AttributeError, struct.error) as error:
                if len(topics) > 1:
                    # the one that is at fault is refused by itself, too
                    Encoder(self.epoch).take(
                        (time, (each,), (value,)) for each, value in zip(topics, values, strict=True)
                    )
                name, message = topics[0].name, topics[0].message
                raise RecordingError(f"{name}: no {message} can be made of {values[0]!r}: {error}") from error
            row.stamps.append(stamp)
            row.starts.append(length)
            records.append(record)
            length += len(record)
        self._length = length

    def block(self, messages: Iterable[Message] = ()) -> Block:
        """Return the records made since the last block, those of these messages last; raises RecordingError."""
        self.take((time, (topic,), (value,)) for time, topic, value in messages)
        index: dict[int, list[tuple[int, int]]] = {}
        stamps: list[int] = []
        for row in self._rows.values():
            if row.starts:
                for number, place in row.places:
                    index.setdefault(number, []).extend(zip(row.stamps, map(place.__add__, row.starts), strict=True))
                stamps += min(row.stamps), max(row.stamps)
                row.stamps, row.starts = [], []
        for entries in index.values():
            # a channel may be in several rows
            entries.sort(key=itemgetter(1))
        data, self._records, self._length = b"".join(self._records), [], 0
        return Block(data, index, min(stamps, default=0), max(stamps, default=0), self.channels, self.epoch)

    def _row(self, topics: tuple[Topic[Any], ...]) -> _CycleRow:
        make = _of_numbers if topics[0].paths else _of_fields
        self._rows[topics] = make([self._channel(topic) for topic in topics])
        return self._rows[topics]

    def _channel(self, topic: Topic[Any]) -> _OwnChannel:
        if topic not in self._own:
            self.channels.append(TopicChannel(self._full_name(topic), topic))
            self._own[topic] = _OwnChannel(topic, len(self.channels), count())
        return self._own[topic]


class _OwnChannel(NamedTuple):
    """A channel of this encoder: its topic, its number, and the sequence numbers of its messages to come."""

    topic: Topic[Any]
    number: int
    sequence: Iterator[int]


@dataclass(slots=True)
class _CycleRow:
    """Topics that are told together."""

    record: Callable[[Sequence[Any], tuple[bytes, bytes]], bytes]
    """Makes the records of their values, one behind the other; given as bytes log and publish time, and time stamp."""
    # each channel's number, and the place of its record among them
    places: list[tuple[int, int]]
    # log time (ns) and offset of each row in the block that is being made
    stamps: list[int] = field(default_factory=list)
    starts: list[int] = field(default_factory=list)


def _head(channel: int, length: int, sequence: int = 0, times: bytes = b"") -> bytes:
    return _HEAD.pack(MESSAGE, _BEHIND_LENGTH + length, channel, sequence, times)


def _of_fields(channels: Sequence[_OwnChannel]) -> _CycleRow:
    """Return a row of one topic, whose records are written field by field."""
    ((topic, number, sequence),) = channels
    first = fields(topic.message)[0]
    stamped = first.type in _STAMPED
    begun = begin(topic.message, topic.constants)

    def record(values: Sequence[Any], when: tuple[bytes, bytes]) -> bytes:
        times, stamp = when
        told: Any = topic.make(values[0])
        if not isinstance(told, Mapping):
            told = told._asdict()
        message = encode(topic.message, {**topic.constants, **told}, b"" if first.name in told else begun)
        if stamped:
            message[len(HEADER) : len(HEADER) + len(stamp)] = stamp
        return _head(number, len(message), next(sequence), times) + message

    return _CycleRow(record, [(number, 0)])


def _of_numbers(channels: Sequence[_OwnChannel]) -> _CycleRow:
    """Return a row whose numbers are put into a template of its records.

    One call packs the template's pieces and the numbers between them; a number at a time takes three times as long.
    """
    template, places = b"", list[tuple[int, int]]()
    # place in the template and struct's code of all that differs
    varying: list[tuple[int, str]] = []
    # of each topic its sequence numbers, what makes its numbers, their count, and what sorts all if they need it
    makes: list[tuple[Iterator[int], Callable[[Any], Any], int, Callable[[Any], Any] | None]] = []
    for topic, number, sequence in channels:
        head = len(template)
        places.append((number, head))
        layout = MessageBuffer(topic.message, topic.constants)
        template += _head(number, len(layout)) + layout
        message = head + RECORD.size
        stamps = [place for path, (place, _) in layout.places.items() if path.endswith("stamp.sec")]
        own = [(head + _SEQUENCE, "I"), (head + _SEQUENCE + 4, f"{_TIMES.size}s")]
        # without a stamp, nothing of it is written
        own.append((message + stamps[0], f"{_STAMP.size}s") if stamps else (message, "0s"))
        own += [(message + place, code) for place, code in map(layout.places.__getitem__, topic.paths)]
        varying += sorted(own)
        in_order = None if own == sorted(own) else itemgetter(*sorted(range(len(own)), key=own.__getitem__))
        makes.append((sequence, topic.make, len(topic.paths), in_order))
    # what stands ahead of each number, the number, ..., and the rest
    form, arguments, end = "<", list[Any](), 0
    for place, code in varying:
        form += f"{place - end}s{code}"
        arguments += template[end:place], 0
        end = place + struct.calcsize(f"<{code}")
    arguments.append(template[end:])
    pack = struct.Struct(f"{form}{len(template) - end}s").pack

    def record(values: Sequence[Any], when: tuple[bytes, bytes]) -> bytes:
        told: list[Any] = []
        for value, (sequence, make, length, in_order) in zip(values, makes, strict=True):
            if in_order is None:
                told.append(next(sequence))
                told += when
                told += make(value)[:length]
            else:
                told += in_order((next(sequence), *when, *make(value)))
        arguments[1::2] = told
        return pack(*arguments)

    return _CycleRow(record, places)
