"""Messages as records of an MCAP file, in the order in which they were told.

How it works
============

Everything a robot tells comes as a triple of time, topic and value. `Encoder.block` makes one MCAP message record of
each and joins them to a `Block`, which a file takes as a chunk and the live view sends on. A record is a head of fixed
length (opcode, length, channel number, sequence number, and the time twice) and the message as CDR
(`txt1.record.layout`). Most messages begin with a time stamp, and that is the record's time as well.

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
from txt1.record.layout import HEADER, MessageBuffer, encode
from txt1.telemetry.messages import fields
from txt1.telemetry.topics import Topic

RECORD: Final = struct.Struct("<BQHIQQ")
"""The head of an MCAP message record: opcode, length, channel, sequence, log time, publish time."""
MESSAGE: Final = 5
_BEHIND_LENGTH: Final = RECORD.size - 9
_VARYING: Final = ((11, "I"), (15, "Q"), (23, "Q"))
"""Offset and struct code of what differs from head to head: sequence number, log time and publish time."""
_STAMP: Final = struct.Struct("<iI")
_STAMPED: Final = ("std_msgs/Header", "builtin_interfaces/Time")
"""Messages that begin with one of these begin with a time stamp."""

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
        self._epoch_ns = nanoseconds(epoch)
        self._full_name = full_name
        self.channels = [] if channels is None else channels
        self._own: dict[Topic[Any], _OwnChannel] = {}

    def skip(self, lost: Mapping[Topic[Any], int]) -> None:
        """Leave gaps in the sequence numbers of topics, of so many messages each."""
        for topic, count in lost.items():
            self._channel(topic).sequence += count

    def block(self, messages: Iterable[Message]) -> Block:
        """Return the records of messages; RecordingError: a value is none of its topic's."""
        records: list[bytes | bytearray] = []
        found: dict[Topic[Any], tuple[_OwnChannel, list[int]]] = {}
        stamps: list[int] = []
        length = stamp = 0
        known, when = None, (0, 0, 0, 0)
        for time, topic, value in messages:
            channel, index = found.get(topic) or found.setdefault(topic, (self._channel(topic), []))
            if time != known:
                known, stamp = time, round(time * NS_PER_S) + self._epoch_ns
                when = stamp, stamp, *divmod(stamp, NS_PER_S)
                stamps.append(stamp)
            try:
                record = channel.record(value, channel.sequence, when)
            except (TypeError, ValueError, IndexError, AttributeError, struct.error) as error:
                raise RecordingError(f"{topic.name}: no {topic.message} can be made of {value!r}: {error}") from error
            channel.sequence += 1
            records.append(record)
            index += stamp, length
            length += len(record)
        by_channel = {channel.number: index for channel, index in found.values()}
        return Block(b"".join(records), by_channel, min(stamps, default=0), max(stamps, default=0), self.channels)

    def _channel(self, topic: Topic[Any]) -> _OwnChannel:
        if topic not in self._own:
            self.channels.append(TopicChannel(self._full_name(topic), topic))
            self._own[topic] = _OwnChannel(topic, len(self.channels))
        return self._own[topic]


_When = tuple[int, int, int, int]
"""Log time and publish time in ns, and the stamp's s and ns."""
_Record = Callable[[Any, int, _When], bytes | bytearray]
"""Makes a record of a value, its sequence number and its time."""


class _OwnChannel:
    """A channel of this encoder: its number, the next message's sequence number, and what makes records of values."""

    def __init__(self, topic: Topic[Any], number: int) -> None:
        self.number, self.sequence = number, 0
        make = _of_numbers if topic.paths else _of_fields
        self.record: _Record = make(topic, number)


def _head(channel: int, length: int, sequence: int = 0, logged: int = 0, published: int = 0) -> bytes:
    return RECORD.pack(MESSAGE, _BEHIND_LENGTH + length, channel, sequence, logged, published)


def _of_fields(topic: Topic[Any], channel: int) -> _Record:
    """Return what writes the records of a topic field by field."""
    stamped = fields(topic.message)[0].type in _STAMPED

    def record(value: Any, sequence: int, when: _When) -> bytes:
        values: Any = topic.make(value)
        if not isinstance(values, Mapping):
            values = values._asdict()
        message = encode(topic.message, {**topic.constants, **values})
        if stamped:
            _STAMP.pack_into(message, len(HEADER), *when[2:])
        return _head(channel, len(message), sequence, *when[:2]) + message

    return record


def _of_numbers(topic: Topic[Any], channel: int) -> _Record:
    """Return what puts a topic's numbers into a record in which everything else stands already.

    One call packs the template's pieces and the numbers between them; a number at a time takes three times as long.
    """
    layout = MessageBuffer(topic.message, topic.constants)
    template = _head(channel, len(layout)) + layout
    stamp = next((place for path, (place, _) in layout.places.items() if path.endswith("stamp.sec")), None)
    # each number's place in the template, and struct's code: of the head, the stamp, and the topic's own
    head = list(_VARYING)
    stamped = [] if stamp is None else [(RECORD.size + stamp, "i"), (RECORD.size + stamp + 4, "I")]
    own = [(RECORD.size + place, code) for place, code in map(layout.places.__getitem__, topic.paths)]
    # of the values that `record` gathers, those that are packed: the stamp's two are always among them, at 3 and 4
    given = [0, 1, 2, *([] if stamp is None else [3, 4]), *range(5, 5 + len(own))]
    numbers = sorted(zip([*head, *stamped, *own], given, strict=True))
    form, pieces, order, end = "<", list[bytes](), list[int](), 0
    for (place, code), which in numbers:
        form += f"{place - end}s{code}"
        order += len(pieces), len(numbers) + 1 + which
        pieces.append(bytes(template[end:place]))
        end = place + struct.calcsize(f"<{code}")
    form += f"{len(template) - end}s"
    order.append(len(pieces))
    pieces.append(bytes(template[end:]))
    pack, in_order = struct.Struct(form).pack, itemgetter(*order)
    make: Callable[[Any], Any] = topic.make

    def record(value: Any, sequence: int, when: _When) -> bytes:
        return pack(*in_order((*pieces, sequence, *when, *make(value))))

    return record
