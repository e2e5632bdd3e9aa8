"""Topics as MCAP message records.

The topics of a cycle are one row of fixed width: a batch of cycles is an array, and every number of all its messages
is filled in by one assignment. With one call per message a recorded simulation would be half as fast.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from math import nan
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.errors import RecordingError
from txt1.kernel.clock import NS_PER_S, nanoseconds
from txt1.record.layout import CODES, HEADER, Layout, encode
from txt1.telemetry.messages import fields
from txt1.telemetry.topics import Topic

RECORD: Final = struct.Struct("<BQHIQQ")
"""The head of an MCAP message record: opcode, length, channel, sequence, log time, publish time."""
MESSAGE: Final = 5
_BEHIND_LENGTH: Final = RECORD.size - 9
_TIMES: Final = (("sequence", "<u4", 11), ("log", "<u8", 15), ("publish", "<u8", 23))
"""Of that head what differs from message to message: name, type and offset."""
_STAMP: Final = struct.Struct("<iI")


class Sample(NamedTuple):
    """The topics of a controller cycle at `time` s of the run; None where there is no value."""

    time: float
    topics: tuple[Topic[Any], ...]
    values: list[Any]


class Event(NamedTuple):
    """A message between the samples: how many of its batch come before it, its time in s of the run, and what it is."""

    position: int
    time: float
    topic: Topic[Any]
    value: Any


class Channel(NamedTuple):
    """A topic in a file: its full name, with the robot's."""

    name: str
    topic: Topic[Any]


@dataclass(frozen=True, slots=True)
class Block:
    """Message records in the order of their happening.

    Attributes:
        data: the records.
        index: for each channel the log times (ns) and offsets of its records.
        first: the smallest log time, ns.
        last: the largest.
        channels: the channels so far, channel number n at place n - 1.

    """

    data: bytes
    index: dict[int, NDArray[np.uint64]]
    first: int
    last: int
    channels: Sequence[Channel]

    @property
    def count(self) -> int:
        """How many messages it holds."""
        return sum(len(entries) for entries in self.index.values())

    def messages(self) -> Iterator[tuple[Channel, int, bytes]]:
        """Channel, log time in ns, and CDR bytes of every message."""
        data, start = self.data, 0
        while start < len(data):
            _, length, channel, _, time, _ = RECORD.unpack_from(data, start)
            end = start + 9 + length
            yield self.channels[channel - 1], time, data[start + RECORD.size : end]
            start = end


class Encoder:
    """Makes blocks of batches; remembers channels and sequence numbers.

    Args:
        epoch: added to the run's time, s.
        full_name: a topic's name with the robot's before it.

    """

    def __init__(self, epoch: float, full_name: Callable[[Topic[Any]], str] = lambda topic: topic.name) -> None:
        self._epoch_ns = nanoseconds(epoch)
        self._full_name = full_name
        self.channels: list[Channel] = []
        self._numbers: dict[Topic[Any], int] = {}
        self._sequences: list[int] = [0]
        self._rows: dict[tuple[Topic[Any], ...], _Row] = {}
        self._makers: dict[Topic[Any], Callable[[Any, int, int], bytes | bytearray]] = {}

    def skip(self, topics: Sequence[Topic[Any]], samples: int) -> None:
        """Leave a gap in the sequence numbers of topics where samples were lost."""
        for topic in topics:
            self._sequences[self._number(topic)] += samples

    def block(self, samples: Sequence[Sample], events: Sequence[Event]) -> Block:
        """Return the records of a batch; `events` by rising position."""
        times = [round(sample.time * NS_PER_S) + self._epoch_ns for sample in samples]
        pieces: list[bytes | bytearray] = []
        entries: dict[int, list[int]] = {}
        runs = self._runs(samples, times)
        run: _Run | None = None
        offset = done = 0
        stamps = [times[0], times[-1]] if times else []

        def rows_up_to(position: int) -> None:
            nonlocal run, offset, done
            while done < position:
                if run is None or done == run.end:
                    run = next(runs)
                    all_runs.append(run)
                end, width = min(position, run.end), run.row.width
                pieces.append(run.data[(done - run.begin) * width : (end - run.begin) * width])
                run.starts.extend(range(offset, offset + (end - done) * width, width))
                offset += (end - done) * width
                done = end

        all_runs: list[_Run] = []
        numbers, sequences, makers = self._numbers, self._sequences, self._makers
        known, stamp, sec, nanosec = nan, 0, 0, 0
        for position, time, topic, value in events:
            if position > done:
                rows_up_to(position)
            if time != known:
                known, stamp = time, round(time * NS_PER_S) + self._epoch_ns
                sec, nanosec = divmod(stamp, NS_PER_S)
                stamps.append(stamp)
            channel = numbers.get(topic) or self._number(topic)
            sequence = sequences[channel]
            sequences[channel] = sequence + 1
            try:
                message = (makers.get(topic) or self._maker(topic))(value, sec, nanosec)
            except (TypeError, ValueError, AttributeError, struct.error) as error:
                raise RecordingError(f"{topic.name}: no {topic.message} can be made of {value!r}: {error}") from error
            pieces += (RECORD.pack(MESSAGE, _BEHIND_LENGTH + len(message), channel, sequence, stamp, stamp), message)
            if channel not in entries:
                entries[channel] = []
            entries[channel] += (stamp, offset)
            offset += RECORD.size + len(message)
        rows_up_to(len(samples))
        index = {channel: [_numbers(each, "Q").reshape(-1, 2)] for channel, each in entries.items()}
        for run in all_runs:
            starts = _numbers(run.starts, "Q")
            for channel, start in run.row.offsets.items():
                index.setdefault(channel, []).append(np.stack((run.times, starts + np.uint64(start)), 1))
        joined = {channel: parts[0] if len(parts) == 1 else np.concatenate(parts) for channel, parts in index.items()}
        return Block(b"".join(pieces), joined, min(stamps, default=0), max(stamps, default=0), self.channels)

    def _number(self, topic: Topic[Any]) -> int:
        """The number of a topic's channel."""
        number = self._numbers.get(topic)
        if number is None:
            self.channels.append(Channel(self._full_name(topic), topic))
            number = self._numbers[topic] = len(self.channels)
            self._sequences.append(0)
        return number

    def _runs(self, samples: Sequence[Sample], times: Sequence[int]) -> Iterator[_Run]:
        """The samples, those behind one another that have the same topics together."""
        stamps = _numbers(times, "Q")
        begin, count = 0, len(samples)
        present = _present(samples[0]) if samples else ()
        for end in range(1, count + 1):
            following = _present(samples[end]) if end < count else ()
            if end == count or following != present:
                row = self._rows.get(present)
                if row is None:
                    row = self._rows[present] = _Row(present, [self._number(topic) for topic in present])
                values = [
                    each if len(each) == len(present) else [value for value in each if value is not None]
                    for _, _, each in samples[begin:end]
                ]
                data = row.fill(values, stamps[begin:end], self._sequences)
                yield _Run(begin, end, row, data, stamps[begin:end], [])
                begin, present = end, following

    def _maker(self, topic: Topic[Any]) -> Callable[[Any, int, int], bytes | bytearray]:
        """The function that makes a topic's messages."""
        self._makers[topic] = _numbers_maker(topic) if topic.paths else _fields_maker(topic)
        return self._makers[topic]


def _present(sample: Sample) -> tuple[Topic[Any], ...]:
    """The topics of a sample that have a value."""
    _, topics, values = sample
    if all(values):  # a quick look: what is empty or 0 is looked at closely
        return topics
    return tuple(topic for topic, value in zip(topics, values, strict=True) if value is not None)


def _numbers(values: Sequence[float], code: str) -> NDArray[Any]:
    """As numpy's array makes them, in a fifth of its time."""
    return np.frombuffer(struct.pack(f"={len(values)}{code}", *values), code)


def _layout(topic: Topic[Any]) -> tuple[Layout, list[int]]:
    """A topic's message without its numbers, and the places of its time stamps."""
    layout = Layout(topic.message, topic.constants)
    return layout, [place for path, (place, _) in layout.places.items() if path.endswith("stamp.sec")]


def _numbers_maker(topic: Topic[Any]) -> Callable[[Any, int, int], bytes | bytearray]:
    layout, stamps = _layout(topic)
    fillers = [
        (struct.Struct(f"<{code}").pack_into, place) for place, code in map(layout.places.__getitem__, topic.paths)
    ]
    template = bytes(layout)

    def make(value: Any, sec: int, nanosec: int) -> bytearray:
        message = bytearray(template)
        for place in stamps:
            _STAMP.pack_into(message, place, sec, nanosec)
        for (fill, place), number in zip(fillers, topic.make(value), strict=True):
            fill(message, place, number)
        return message

    return make


def _fields_maker(topic: Topic[Any]) -> Callable[[Any, int, int], bytes | bytearray]:
    """What makes messages of fields; one of plain fields is laid out once for the same texts and lengths."""
    head, *rest = fields(topic.message)
    stamped = head.type in ("std_msgs/Header", "builtin_interfaces/Time")
    kinds = {*CODES, "string"} if stamped and not topic.constants else set()
    plain = stamped and all(
        field.type in kinds and not (field.array and (field.length or field.type == "string")) for field in rest
    )
    shaping = [field for field in rest if field.array or field.type == "string"]

    @lru_cache(256)
    def shape(*texts_and_lengths: Any) -> tuple[bytes, list[tuple[Callable[..., None], int, str, bool]]]:
        given = zip(shaping, texts_and_lengths, strict=True)
        layout = Layout(topic.message, {field.name: [0] * each if field.array else each for field, each in given})
        fillers = []
        for field in rest:
            count = sum(path.startswith(f"{field.name}.") for path in layout.places) if field.array else 1
            if field.type != "string" and count:
                place, code = layout.places[f"{field.name}.0" if field.array else field.name]
                fillers.append((struct.Struct(f"<{count}{code}").pack_into, place, field.name, field.array))
        return bytes(layout), fillers

    def make(value: Any, sec: int, nanosec: int) -> bytearray:
        values: Any = topic.make(value)
        if plain:
            template, fillers = shape(
                *[len(values.get(f.name, ())) if f.array else values.get(f.name, "") for f in shaping]
            )
            message = bytearray(template)
            for fill, place, name, array in fillers:
                fill(message, place, *values[name]) if array else fill(message, place, values.get(name, 0))
        else:
            message = encode(topic.message, {**topic.constants, **values} if topic.constants else values)
        if stamped:
            _STAMP.pack_into(message, len(HEADER), sec, nanosec)
        return message

    return make


class _Run(NamedTuple):
    """Samples from `begin` up to `end` of a batch as rows, their log times, and where each comes to stand."""

    begin: int
    end: int
    row: _Row
    data: bytes
    times: NDArray[np.uint64]
    starts: list[int]


class _Row:
    """The records of a cycle's topics behind one another.

    Attributes:
        offsets: of the records by their channels.
        width: of all of them in bytes.

    """

    def __init__(self, topics: Sequence[Topic[Any]], channels: Sequence[int]) -> None:
        self.offsets: dict[int, int] = {}
        self._topics = topics
        self._stamps: list[str] = []
        template = b""
        places: dict[str, tuple[str, int]] = {}
        for k, (topic, channel) in enumerate(zip(topics, channels, strict=True)):
            start = self.offsets[channel] = len(template)
            layout, stamps = _layout(topic)
            template += RECORD.pack(MESSAGE, _BEHIND_LENGTH + len(layout), channel, 0, 0, 0) + layout
            places |= {f"{k} {name}": (kind, start + place) for name, kind, place in _TIMES}
            for path in topic.paths:
                place, code = layout.places[path]
                places[f"{k}.{path}"] = f"<{code}", start + RECORD.size + place
            for place in stamps:
                self._stamps.append(f"stamp {len(self._stamps)}")
                places[self._stamps[-1]] = "(2,)<u4", start + RECORD.size + place
        self.width = len(template)
        self._template = np.frombuffer(template, np.uint8)
        kinds, offsets = zip(*places.values(), strict=True) if places else ((), ())
        self._type = np.dtype(
            {"names": list(places), "formats": list(kinds), "offsets": list(offsets), "itemsize": self.width}
        )

    def fill(self, samples: Sequence[Sequence[Any]], times: NDArray[np.uint64], sequences: list[int]) -> bytes:
        """The rows of these samples' values; counts them in the channels' `sequences`."""
        count = len(samples)
        if not self._topics:
            return b""
        rows = np.tile(self._template, count).view(self._type)
        for k, channel in enumerate(self.offsets):
            rows[f"{k} sequence"] = np.arange(sequences[channel], sequences[channel] + count)
            rows[f"{k} log"] = rows[f"{k} publish"] = times
            sequences[channel] += count
        stamps = np.stack(np.divmod(times, np.uint64(NS_PER_S)), 1)
        for name in self._stamps:
            rows[name] = stamps
        for k, (topic, values) in enumerate(zip(self._topics, zip(*samples, strict=True), strict=True)):
            made: Any = map(topic.make, values)
            columns = _numbers(list(chain.from_iterable(made)), "d").reshape(count, -1).T
            for path, column in zip(topic.paths, columns, strict=True):
                rows[f"{k}.{path}"] = column
        return rows.tobytes()
