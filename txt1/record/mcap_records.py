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
Their templates stand one behind the other, and when a block is joined, the numbers of all its cycles are put there by
column: a number for each message at a time would take twice as long.

"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np

from txt1.errors import RecordingError
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.record.cdr import HEADER, MessageBuffer, begin, encode
from txt1.telemetry.messages import fields
from txt1.telemetry.topics import Topic

RECORD: Final = struct.Struct("<BQHIQQ")
"""The head of an MCAP message record: opcode, length, channel, sequence, log time, publish time."""
MESSAGE: Final = 5
_BEHIND_LENGTH: Final = RECORD.size - 9
_VARYING: Final = ((11, "I", 0), (15, "Q", 1), (23, "Q", 1))
"""Of a head's changing fields, offset, struct code and place in what differs: the sequence number and both times."""
_STAMP: Final = struct.Struct("<iI")
_STAMPED: Final = ("std_msgs/Header", "builtin_interfaces/Time")
"""Types that begin with a time stamp."""
_REFUSED: Final = (TypeError, ValueError, IndexError, AttributeError, ArithmeticError, struct.error)
"""Errors of values that are none of their topic's."""

Message = tuple[float, Topic[Any], Any]
"""Time, s of the run, topic and value."""
Told = tuple[float, tuple[Topic[Any], ...], Sequence[Any]]
"""Time, s of the run, and topics that are told together, with their values; several topics tell numbers only."""
_When = tuple[int, int, int]
"""The time of a record in ns, and as a stamp's s and ns."""


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
        self._rows: dict[tuple[Topic[Any], ...], _Single | _Cycle] = {}
        # of the next block
        self._records: list[bytes | bytearray] = []
        self._length = 0

    def take(self, told: Iterable[Told]) -> None:
        """Make records of rows, for the next block; RecordingError: a value is none of its topic's."""
        rows, records, length, epoch = self._rows, self._records, self._length, nanoseconds(self.epoch)
        known, when = None, (0, 0, 0)
        for time, topics, values in told:
            row = rows.get(topics) or self._row(topics)
            if time != known:
                known, stamp = time, round(time * NS_PER_S) + epoch
                when = stamp, *divmod(stamp, NS_PER_S)
            record = row.record(values, when)
            row.stamps.append(when[0])
            row.starts.append(length)
            records.append(record)
            length += len(record)
        self._length = length

    def block(self, messages: Iterable[Message] = ()) -> Block:
        """Return the records made since the last block, those of these messages last; raises RecordingError."""
        self.take((time, (topic,), (value,)) for time, topic, value in messages)
        index: dict[int, list[tuple[int, int]]] = {}
        stamps: list[int] = []
        data = bytearray().join(self._records)
        for row in self._rows.values():
            if row.starts:
                row.fill(data)
                for number, place in row.places:
                    index.setdefault(number, []).extend(zip(row.stamps, map(place.__add__, row.starts), strict=True))
                stamps += min(row.stamps), max(row.stamps)
                row.stamps, row.starts = [], []
        for entries in index.values():
            # a channel may be in several rows
            entries.sort(key=itemgetter(1))
        self._records, self._length = [], 0
        return Block(bytes(data), index, min(stamps, default=0), max(stamps, default=0), self.channels, self.epoch)

    def _row(self, topics: tuple[Topic[Any], ...]) -> _Single | _Cycle:
        channels = [self._channel(topic) for topic in topics]
        self._rows[topics] = _Single(*channels) if len(channels) == 1 else _Cycle(channels)
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


class _Single:
    """A row of one topic."""

    def __init__(self, channel: _OwnChannel) -> None:
        self._topic = channel.topic
        self._make = _of_numbers(channel) if channel.topic.paths else _of_fields(channel)
        # each channel's number, and the place of its record in the row
        self.places = [(channel.number, 0)]
        # log time (ns) and offset of each row in the block that is being made
        self.stamps: list[int] = []
        self.starts: list[int] = []

    def record(self, values: Sequence[Any], when: _When) -> bytes | bytearray:
        """Return the record of a value."""
        try:
            return self._make(values[0], when)
        except _REFUSED as error:
            raise _no_message(self._topic, values[0], error) from error

    def fill(self, data: bytearray) -> None:
        """Add what the records in a block lack: nothing."""


class _Cycle:
    """A row of several topics of numbers."""

    def __init__(self, channels: Sequence[_OwnChannel]) -> None:
        self.places: list[tuple[int, int]] = []
        self.stamps: list[int] = []
        self.starts: list[int] = []
        self._sequences = [channel.sequence for channel in channels]
        # topics, and of each varying number its name in the templates and its place in the topic's columns
        self._topics: list[tuple[Topic[Any], list[tuple[str, int]]]] = []
        self._templates = b""
        offsets, codes = list[int](), list[str]()
        for topic, number, _ in channels:
            head = len(self._templates)
            template, varying = _template(topic, number)
            named = [(str(name), at) for name, (_, _, at) in enumerate(varying, len(codes))]
            offsets += [head + place for place, _, _ in varying]
            codes += [f"<{code}" for _, code, _ in varying]
            self.places.append((number, head))
            self._topics.append((topic, named))
            self._templates += template
        names, width = list(map(str, range(len(codes)))), len(self._templates)
        self._type = np.dtype({"names": names, "formats": codes, "offsets": offsets, "itemsize": width})
        self._values: list[Sequence[Any]] = []
        self._times: list[int] = []

    def record(self, values: Sequence[Any], when: _When) -> bytes:
        """Return the records of values without their numbers."""
        self._values.append(values)
        self._times += (*when, *map(next, self._sequences))
        return self._templates

    def fill(self, data: bytearray) -> None:
        """Put the numbers into the records in a block."""
        told, self._values = self._values, []
        times, self._times = _columns(self._times, "q", len(told)), []
        rows = np.tile(np.frombuffer(self._templates, np.uint8), len(told)).view(self._type)
        for (topic, named), sequence, values in zip(self._topics, times[3:], zip(*told, strict=True), strict=True):
            try:
                numbers = _columns(list(chain.from_iterable(map(topic.make, values))), "d", len(told))
                columns = sequence, *times[:3], *numbers
                with np.errstate(over="raise", invalid="raise"):
                    for name, at in named:
                        rows[name] = columns[at]
            except _REFUSED as error:
                raise _no_message(topic, values, error) from error
        filled, width = rows.view(np.uint8).data, len(self._templates)
        for at, start in enumerate(self.starts):
            data[start : start + width] = filled[at * width : (at + 1) * width]


def _columns(numbers: Sequence[float], code: str, rows: int) -> np.ndarray[Any, Any]:
    """Return the columns of numbers that come row by row, in a third of the time of numpy's own function."""
    return np.frombuffer(struct.pack(f"{len(numbers)}{code}", *numbers), code).reshape(rows, -1).T


def _no_message(topic: Topic[Any], value: Any, error: Exception) -> RecordingError:
    return RecordingError(f"{topic.name}: no {topic.message} can be made of {value!r}: {error}")


def _of_fields(channel: _OwnChannel) -> Callable[[Any, _When], bytes]:
    """Return the function that writes a topic's records field by field."""
    topic, number, sequence = channel
    first = fields(topic.message)[0]
    stamped = first.type in _STAMPED
    begun = begin(topic.message, topic.constants)

    def record(value: Any, when: _When) -> bytes:
        values: Any = topic.make(value)
        if not isinstance(values, Mapping):
            values = values._asdict()
        if first.name in values:
            message = encode(topic.message, {**topic.constants, **values})
        else:
            message = encode(topic.message, {**topic.constants, **values}, begun)
        if stamped:
            _STAMP.pack_into(message, len(HEADER), *when[1:])
        head = RECORD.pack(MESSAGE, _BEHIND_LENGTH + len(message), number, next(sequence), when[0], when[0])
        return head + message

    return record


def _of_numbers(channel: _OwnChannel) -> Callable[[Any, _When], bytes]:
    """Return the function that puts a topic's numbers into a template of its record.

    One call packs the template's pieces and the numbers between them; a number at a time takes three times as long.
    Zeros at the ends of a piece are struct's padding, as most covariances and unused axes are 0.
    """
    topic, number, sequence = channel
    template, varying = _template(topic, number)
    # the pieces come behind the numbers, the first of them last
    form, pieces, order, end = "<", list[bytes](), list[int](), 0
    for place, code, at in (*sorted(varying), (len(template), "", None)):
        gap = template[end:place]
        piece = gap.strip(b"\0")
        zeros = gap.index(piece)
        form += f"{zeros}x{len(piece)}s{len(gap) - zeros - len(piece)}x" if piece else f"{len(gap)}x"
        if piece:
            pieces.insert(0, piece)
            order.append(-len(pieces))
        if at is not None:
            form += code
            order.append(at)
        end = place + struct.calcsize(f"<{code}")
    pack, in_order = struct.Struct(form).pack, itemgetter(*order)
    make: Callable[[Any], Any] = topic.make
    return lambda value, when: pack(*in_order((next(sequence), *when, *make(value), *pieces)))


def _template(topic: Topic[Any], number: int) -> tuple[bytes, list[tuple[int, str, int]]]:
    """Return a record of a topic of numbers, and offset and struct's code of each number that differs.

    The third of each is its place in all of them: sequence number, time in ns, stamp's s and ns, the topic's numbers.
    """
    layout = MessageBuffer(topic.message, topic.constants)
    head = RECORD.pack(MESSAGE, _BEHIND_LENGTH + len(layout), number, 0, 0, 0)
    stamps = [place for path, (place, _) in layout.places.items() if path.endswith("stamp.sec")][:1]
    within = [(place + more, code, at) for place in stamps for more, code, at in ((0, "i", 2), (4, "I", 3))]
    within += [(*layout.places[path], at) for at, path in enumerate(topic.paths, 4)]
    return head + layout, [*_VARYING, *((RECORD.size + place, code, at) for place, code, at in within)]
