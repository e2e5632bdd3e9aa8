"""Topics as MCAP message records.

The topics of a cycle are one row of fixed width: a batch of cycles is an array, and every number of all its messages
is filled in by one assignment. With one call per message a recorded simulation would be half as fast.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import accumulate, chain, groupby, repeat
from math import nan
from operator import itemgetter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import RecordingError
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.record.layout import CODES, HEADER, MessageBuffer, encode
from txt1.telemetry.messages import fields
from txt1.telemetry.ready import Ready
from txt1.telemetry.topics import Topic

RECORD: Final = struct.Struct("<BQHIQQ")
"""The head of an MCAP message record: opcode, length, channel, sequence, log time, publish time."""
MESSAGE: Final = 5
_BEHIND_LENGTH: Final = RECORD.size - 9
_TIMES: Final = ((11, "I"), (15, "Q"), (23, "Q"))
"""Of that head what differs from message to message, sequence and times: offset and struct code."""
_STAMP: Final = struct.Struct("<iI")
_STAMPED: Final = ("std_msgs/Header", "builtin_interfaces/Time")
"""Messages that begin with one of these begin with a time stamp."""


Sample = tuple[float, tuple[Topic[Any], ...], list[Any]]
"""The time of a controller cycle, s of the run, its topics and their values, None where there is none."""
Event = tuple[int, float, Topic[Any], Any]
"""A message between the samples: how many of its batch come before it, its time, s of the run, topic and value.

In place of the value there may be the message itself (`Ready`).
"""


class TopicChannel(NamedTuple):
    """A topic in a file: its full name, with the robot's."""

    name: str
    topic: Topic[Any]


@dataclass(frozen=True, slots=True)
class Block:
    """Message records in the order of their happening, with the smallest and the largest log time, ns."""

    data: bytes
    index: dict[int, NDArray[np.uint64]]  # for each channel the log times (ns) and offsets of its records
    first: int
    last: int
    channels: Sequence[TopicChannel]  # the channels so far, channel number n at place n - 1

    @property
    def count(self) -> int:
        """How many messages it holds."""
        return sum(len(entries) for entries in self.index.values())

    def messages(self) -> Iterator[tuple[TopicChannel, int, bytes]]:
        """Channel, log time in ns, and CDR bytes of every message."""
        data, start = self.data, 0
        while start < len(data):
            _, length, channel, _, time, _ = RECORD.unpack_from(data, start)
            end = start + 9 + length
            yield self.channels[channel - 1], time, data[start + RECORD.size : end]
            start = end


class Encoder:
    """Makes blocks of batches; remembers channels and sequence numbers. `epoch` s are added to the run's time.

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
        self._numbers: dict[Topic[Any], int] = {}
        self._sequences: dict[int, int] = {}
        self._rows: dict[tuple[Topic[Any], ...], _TopicsRow] = {}
        self._makers: dict[Topic[Any], _Make] = {}

    def skip(self, lost: Mapping[Topic[Any], int]) -> None:
        """Leave gaps in the sequence numbers of topics, of so many messages each."""
        for topic, count in lost.items():
            self._sequences[self._number(topic)] += count

    def ready(self, topic: Topic[Any], value: Any, time: float) -> Ready:
        """Make a message, `time` in s of the run; RecordingError: the value is none of the topic's."""
        stamp = round(time * NS_PER_S) + self._epoch_ns
        try:
            record = (self._makers.get(topic) or self._maker(topic))(value, (0, stamp, stamp, *divmod(stamp, NS_PER_S)))
        except _REFUSED as error:
            raise _no_message(topic, value, error) from error
        return Ready(record[RECORD.size :], self._epoch_ns, _stamp_place(topic))

    def block(self, samples: Sequence[Sample], events: Sequence[Event]) -> Block:
        """Return the records of a batch; `events` by rising position."""
        times = [round(time * NS_PER_S) + self._epoch_ns for time, _, _ in samples]
        stamps = [times[0], times[-1]] if times else []
        runs = list(self._runs(samples, times))
        data = runs[0].data if len(runs) == 1 else memoryview(b"".join(run.data for run in runs))
        bounds = [0, *accumulate(chain.from_iterable(repeat(run.row.width, len(run.times)) for run in runs))]
        pieces: list[bytes | memoryview] = []
        lengths: list[int] = []
        entries: dict[int, list[int]] = {}
        channels, sequences, makers = self._numbers, self._sequences, self._makers
        known, stamp, sec, nanosec = nan, 0, 0, 0
        done = between = 0  # samples, and bytes of events, that have their place
        for position, time, topic, value in events:
            if position != done:
                pieces.append(data[bounds[done] : bounds[position]])
                done = position
            if time != known:
                known, stamp = time, round(time * NS_PER_S) + self._epoch_ns
                sec, nanosec = divmod(stamp, NS_PER_S)
                stamps.append(stamp)
            channel = channels.get(topic) or self._number(topic)
            sequence = sequences[channel]
            sequences[channel] = sequence + 1
            when = sequence, stamp, stamp, sec, nanosec
            try:
                if type(value) is Ready:
                    record = _framed(value, self._epoch_ns, channel, when)
                else:
                    record = (makers.get(topic) or self._maker(topic))(value, when)
            except _REFUSED as error:
                raise _no_message(topic, value, error) from error
            pieces.append(record)
            if channel not in entries:
                entries[channel] = []
            entries[channel] += (stamp, bounds[position] + between)
            lengths.append(len(record))
            between += len(record)
        pieces.append(data[bounds[done] :])
        index = {channel: [_numbers(each, "Q").reshape(-1, 2)] for channel, each in entries.items()}
        shifts = np.bincount([event[0] for event in events], lengths, len(samples) + 1).cumsum()
        starts = _numbers(bounds, "Q") + shifts.astype(np.uint64)
        begin = 0
        for run in runs:
            end = begin + len(run.times)
            for channel, start in run.row.offsets.items():
                place = np.stack((run.times, starts[begin:end] + np.uint64(start)), 1)
                index.setdefault(channel, []).append(place)
            begin = end
        joined = {channel: parts[0] if len(parts) == 1 else np.concatenate(parts) for channel, parts in index.items()}
        return Block(b"".join(pieces), joined, min(stamps, default=0), max(stamps, default=0), self.channels)

    def _number(self, topic: Topic[Any]) -> int:
        """The number of a topic's channel."""
        number = self._numbers.get(topic)
        if number is None:
            self.channels.append(TopicChannel(self._full_name(topic), topic))
            number = self._numbers[topic] = len(self.channels)
            self._sequences[number] = 0
        return number

    def _runs(self, samples: Sequence[Sample], times: Sequence[int]) -> Iterator[_Run]:
        """The samples, those behind one another that have the same topics together."""
        stamps, begin = _numbers(times, "Q"), 0
        for present, group in groupby(samples, _present):
            values = [each if len(each) == len(present) else [v for v in each if v is not None] for _, _, each in group]
            row = self._rows.get(present)
            if row is None:
                row = self._rows[present] = _TopicsRow({self._number(topic): topic for topic in present})
            end = begin + len(values)
            yield _Run(row, row.fill(values, stamps[begin:end], self._sequences), stamps[begin:end])
            begin = end

    def _maker(self, topic: Topic[Any]) -> _Make:
        """The function that makes a topic's records."""
        number = self._number(topic)
        self._makers[topic] = _numbers_maker(topic, number) if topic.paths else _fields_maker(topic, number)
        return self._makers[topic]


_REFUSED: Final = (TypeError, ValueError, AttributeError, struct.error)


def _no_message(topic: Topic[Any], value: Any, error: Exception) -> RecordingError:
    return RecordingError(f"{topic.name}: no {topic.message} can be made of {value!r}: {error}")


_When = tuple[int, int, int, int, int]
"""Sequence number, log time, publish time, and the stamp's s and ns: the numbers of `_TIMES` and of the stamp."""
_Make = Callable[[Any, _When], bytes]


def _present(sample: Sample) -> tuple[Topic[Any], ...]:
    """The topics of a sample that have a value."""
    _, topics, values = sample
    if all(values):  # a quick look: what is empty or 0 is looked at closely
        return topics
    return tuple(topic for topic, value in zip(topics, values, strict=True) if value is not None)


def _numbers(values: Sequence[float], code: str) -> NDArray[Any]:
    """As numpy's array makes them, in a fifth of its time."""
    return np.frombuffer(struct.pack(f"={len(values)}{code}", *values), code)


def _template(channel: int, layout: MessageBuffer) -> tuple[bytes, list[tuple[int, str]]]:
    """A record without its numbers, and where those of its time stand, offset and struct code."""
    data = RECORD.pack(MESSAGE, _BEHIND_LENGTH + len(layout), channel, 0, 0, 0) + layout
    stamp = next((place for path, (place, _) in layout.places.items() if path.endswith("stamp.sec")), None)
    stamps = [] if stamp is None else [(RECORD.size + stamp, "i"), (RECORD.size + stamp + 4, "I")]
    return data, [*_TIMES, *stamps]


@cache
def _stamp_place(topic: Topic[Any]) -> int | None:
    """Where the time stamp stands in a topic's messages; None where they have none."""
    if not topic.paths:
        return len(HEADER) if fields(topic.message)[0].type in _STAMPED else None
    places = MessageBuffer(topic.message, topic.constants).places.items()
    return next((place for path, (place, _) in places if path.endswith("stamp.sec")), None)


def _framed(ready: Ready, epoch_ns: int, channel: int, when: _When) -> bytes:
    """The record of a message that is made already; it gets another stamp where that is of another epoch."""
    data: bytes | bytearray = ready.data
    if ready.epoch != epoch_ns and ready.stamp is not None:
        data = bytearray(data)
        _STAMP.pack_into(data, ready.stamp, *when[3:])
    return RECORD.pack(MESSAGE, _BEHIND_LENGTH + len(data), channel, *when[:3]) + data


def _packer(template: bytes, places: Iterable[tuple[int, str]]) -> Callable[[Iterable[float]], bytes]:
    """A function that puts numbers into a template at these rising offsets, in one call of struct."""
    form, at = "<", 0
    arguments: list[Any] = []  # what stands ahead of each number, the number, ..., and the rest
    for offset, code in places:
        form += f"{offset - at}s{code}"
        arguments += template[at:offset], 0
        at = offset + struct.calcsize(code)
    arguments.append(template[at:])
    pack = struct.Struct(f"{form}{len(template) - at}s").pack

    def fill(numbers: Iterable[float]) -> bytes:
        arguments[1::2] = numbers
        return pack(*arguments)

    return fill


def _numbers_maker(topic: Topic[Any], channel: int) -> _Make:
    layout = MessageBuffer(topic.message, topic.constants)
    template, times = _template(channel, layout)
    numbers = [(RECORD.size + place, code) for place, code in map(layout.places.__getitem__, topic.paths)]
    make: Callable[[Any], Any] = topic.make
    count, told = len(times), len(numbers)
    fill = _packer(template, [*times, *sorted(numbers)])
    order = sorted(range(told), key=numbers.__getitem__)
    if order == list(range(told)):
        return lambda value, when: fill((*when[:count], *make(value)[:told]))
    in_order = itemgetter(*order)  # the paths stand in another order than the fields
    return lambda value, when: fill((*when[:count], *in_order(make(value))))


def _fields_maker(topic: Topic[Any], channel: int) -> _Make:
    """A maker of records of fields; those of plain fields are laid out once for the same texts and lengths."""
    head, *rest = fields(topic.message)
    stamped = head.type in _STAMPED
    kinds = {*CODES, "string"} if stamped and not topic.constants else set()
    plain = stamped and all(
        field.type in kinds and not (field.array and (field.length or field.type == "string")) for field in rest
    )
    blanks = [(field.name, () if field.array else "" if field.type == "string" else 0) for field in rest]
    shaping = [(at, field.array) for at, field in enumerate(rest) if field.array or field.type == "string"]
    counted = [(at, field.array) for at, field in enumerate(rest) if field.type != "string"]

    @lru_cache(256)
    def packer(*texts_and_lengths: Any) -> Callable[[Iterable[float]], bytes]:
        given = zip(shaping, texts_and_lengths, strict=True)
        layout = MessageBuffer(
            topic.message, {rest[at].name: [0] * each if array else each for (at, array), each in given}
        )
        template, times = _template(channel, layout)
        names = {rest[at].name for at, _ in counted}
        numbers = [
            (RECORD.size + at, code) for path, (at, code) in layout.places.items() if path.split(".")[0] in names
        ]
        return _packer(template, [*times, *numbers])

    def make_plain(value: Any, when: _When) -> bytes:
        values: Any = topic.make(value)
        if not isinstance(values, tuple):
            values = [values.get(name, blank) for name, blank in blanks]
        shape = [len(values[at]) if array else values[at] for at, array in shaping]
        numbers = [*when]
        for at, array in counted:
            if array:
                numbers += values[at]
            else:
                numbers.append(values[at])
        return packer(*shape)(numbers)

    def make(value: Any, when: _When) -> bytes:
        values: Any = topic.make(value)
        if not isinstance(values, Mapping):
            values = values._asdict()
        message = encode(topic.message, {**topic.constants, **values} if topic.constants else values)
        if stamped:
            _STAMP.pack_into(message, len(HEADER), *when[3:])
        return RECORD.pack(MESSAGE, _BEHIND_LENGTH + len(message), channel, *when[:3]) + message

    return make_plain if plain else make


class _Run(NamedTuple):
    """Samples with the same topics as rows, and their log times."""

    row: _TopicsRow
    data: memoryview
    times: NDArray[np.uint64]


class _TopicsRow:
    """The records of a cycle's topics behind one another: their `offsets` by channel, the `width` of all in bytes."""

    def __init__(self, topics: Mapping[int, Topic[Any]]) -> None:
        self.offsets: dict[int, int] = {}
        self._topics = topics
        self._columns: dict[int, list[str]] = {}
        template = b""
        places: list[tuple[int, str]] = []
        for channel, topic in topics.items():
            start = self.offsets[channel] = len(template)
            layout = MessageBuffer(topic.message, topic.constants)
            record, times = _template(channel, layout)
            numbers = [(RECORD.size + place, code) for place, code in map(layout.places.__getitem__, topic.paths)]
            template += record
            places += [(start + place, f"<{code}") for place, code in (*times, *numbers)]
            self._columns[channel] = [str(number) for number in range(len(places))[-len(times) - len(numbers) :]]
        self.width = len(template)
        self._template = np.frombuffer(template, np.uint8)
        offsets, kinds = zip(*places, strict=True) if places else ((), ())
        names = [str(number) for number in range(len(places))]
        self._type = np.dtype(
            {"names": names, "formats": list(kinds), "offsets": list(offsets), "itemsize": self.width}
        )

    def fill(
        self, samples: Sequence[Sequence[Any]], times: NDArray[np.uint64], sequences: dict[int, int]
    ) -> memoryview:
        """The rows of these samples' values; counts them in the channels' `sequences`."""
        if not self._topics:
            return memoryview(b"")
        count = len(samples)
        rows = np.tile(self._template, count).view(self._type)
        sec, nanosec = np.divmod(times, np.uint64(NS_PER_S))
        nothing: tuple[tuple[Any, ...], NDArray[np.float64]] = (), np.empty(0)
        made: dict[Any, tuple[tuple[Any, ...], NDArray[np.float64]]] = {}
        for (channel, topic), values in zip(self._topics.items(), zip(*samples, strict=True), strict=True):
            sequence = sequences[channel]
            sequences[channel] += count
            same, numbers = made.get(topic.make, nothing)
            if same != values:
                each: Any = map(topic.make, values)
                numbers = _numbers(list(chain.from_iterable(each)), "d").reshape(count, -1).T
                made[topic.make] = values, numbers  # the next topic may tell the same
            names = self._columns[channel]
            told = len(names) - len(topic.paths)  # without a stamp the message has none of its time's numbers
            columns = (np.arange(sequence, sequence + count), times, times, sec, nanosec)[:told]
            for name, column in zip(names, (*columns, *numbers[: len(topic.paths)]), strict=True):
                rows[name] = column
        return rows.view(np.uint8).data
