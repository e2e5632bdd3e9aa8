"""A recording in words and numbers: its topics with counts, rates and gaps; its messages as lines."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final

from txt1.kernel.clock import NS_PER_S
from txt1.record.reader import Decoding, FilePass, Item

RECOVER: Final = "'txt1 log recover' makes a complete file of it"
# of the metadata, what `info` prints
SHOWN: Final = ("txt1", "hal", "seed", "clock", "wall_start")


@dataclass
class TopicSummary:
    """A topic's message type, whether it is for txt1 alone, whether other topics have its contents, its number of
    messages, first and last time and longest gap in ns, and number lost.
    """

    schema: str
    own: bool = False
    derived: bool = False
    count: int = 0
    first: int = 0
    last: int = 0
    gap: int = 0
    lost: int = 0
    _sequence: int = -1

    def add(self, time: int, sequence: int) -> None:
        """Count a message."""
        if self.count:
            self.gap = max(self.gap, time - self.last)
            self.lost += max(0, sequence - self._sequence - 1)
        else:
            self.first = time
            self.lost = sequence
        self.count, self.last, self._sequence = self.count + 1, time, sequence

    @property
    def rate(self) -> float:
        """Messages per second, from the first to the last; 0 where there are fewer than two."""
        return (self.count - 1) * NS_PER_S / (self.last - self.first) if self.last > self.first else 0.0


def summarise(reading: FilePass) -> dict[str, TopicSummary]:
    """Every topic of a recording, in the order of its channels."""
    found: dict[str, TopicSummary] = {}
    for item in reading:
        told = found.setdefault(item.topic, TopicSummary(item.kind, item.own, item.derived))
        told.add(item.message.log_time, item.message.sequence)
    order = [channel.topic for _, channel in sorted(reading.channels.items())]
    return {topic: found[topic] for topic in order if topic in found}


def info(path: Path) -> Iterator[str]:
    """A recording's summary as lines."""
    reading = FilePass(path)
    summaries = summarise(reading)
    yield f"{path}: {path.stat().st_size / 1e6:.2f} MB, {ending_of(reading)}"
    about = reading.metadata.get("txt1", {})
    yield from (f"{name:<12}{about[name]}" for name in SHOWN if name in about)
    dropped = reading.metadata.get("txt1.end", {}).get("dropped", "0")
    if dropped != "0":
        yield f"dropped     {dropped} messages, because the disk was full or too slow"
    if not summaries:
        yield "no messages"
        return
    first, last = min(s.first for s in summaries.values()), max(s.last for s in summaries.values())
    total = sum(s.count for s in summaries.values())
    began = f", a run that began at {datetime.fromtimestamp(reading.epoch, UTC).isoformat()}" if reading.epoch else ""
    start = first / NS_PER_S - reading.epoch
    yield f"{total} messages in {(last - first) / NS_PER_S:.2f} s, from {start:.2f} s on{began}"
    yield f"{'topic':<16}{'messages':>9}{'rate/Hz':>9}{'longest gap/s':>15}{'lost':>6}  type"
    for topic, each in summaries.items():
        gap = each.gap / NS_PER_S
        mark = "  *" if each.own else "  +" if each.derived else ""
        yield f"{topic:<16}{each.count:>9}{each.rate:>9.2f}{gap:>15.3f}{each.lost:>6}  {each.schema}{mark}"
    if any(each.derived for each in summaries.values()):
        yield "+ other topics have its contents, too; tables leave it out unless --topic names it"
    if any(each.own for each in summaries.values()):
        yield "* for txt1's own replay and screens; exports leave it out unless --topic names it"


def ending_of(reading: FilePass) -> str:
    """Whether a file that was read to its end is complete, in words."""
    if reading.complete and not reading.damaged:
        return "complete"
    damaged = f", {reading.damaged} damaged chunks left out" if reading.damaged else ""
    return f"breaks off{damaged}; {RECOVER}"


def chosen(reading: FilePass, topics: frozenset[str], start: float | None, end: float | None) -> Iterator[Item]:
    """The messages on these topics (all, if there are none), from `start` up to `end`, s of the run."""
    first, last = -inf if start is None else start, inf if end is None else end
    return (i for i in reading if (not topics or i.topic in topics) and first <= reading.run_time(i) <= last)


def lines(items: Iterable[Item]) -> Iterator[str]:
    """Yield each message as a line of JSON; numbers that are not finite become null."""
    decoding = Decoding()
    for item in items:
        record = {"time": item.time, "topic": item.topic, "message": _finite(decoding.values(item))}
        yield json.dumps(record, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not isfinite(value) else value
