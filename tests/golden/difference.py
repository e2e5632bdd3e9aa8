"""The largest difference between two recordings of one program."""

from __future__ import annotations

from collections import defaultdict
from math import inf, isnan
from pathlib import Path
from typing import Any, NamedTuple

from txt1.record.reader import Decoding, FilePass, flat

MEASURED = ("/diagnostics", "/steps", "/reports", "/snapshot", "/link")
"""Topics that hold what a clock measures, or that say again what others say."""


class Largest(NamedTuple):
    """The largest difference, and where it is."""

    difference: float
    topic: str = ""
    field: str = ""
    time: float = 0.0
    messages: int = 0

    def __str__(self) -> str:
        if not self.difference:
            return f"the same in {self.messages} messages"
        return f"largest difference {self.difference:g}: {self.topic} {self.field} at {self.time:.2f} s"


def largest(old: Path, new: Path) -> Largest:
    """The largest difference of two numbers in turn; inf where texts differ or messages are missing."""
    before, after = (messages(path) for path in (old, new))
    found, count = Largest(0.0), 0
    for topic in sorted(before.keys() | after.keys()):
        one, two = before.get(topic, []), after.get(topic, [])
        if len(one) != len(two) and found.difference < inf:
            found = Largest(inf, topic, f"{len(one)} messages, now {len(two)}")
        for (time, values), (_, others) in zip(one, two, strict=False):
            count += 1
            for name in values.keys() | others.keys():
                apart = _apart(values.get(name), others.get(name))
                if apart > found.difference:
                    found = Largest(apart, topic, name, time)
    return found._replace(messages=count)


def messages(path: Path) -> dict[str, list[tuple[float, dict[str, Any]]]]:
    """The messages of a recording by topic, each with its time, s of the run."""
    reading, decoding = FilePass(path), Decoding()
    found: dict[str, list[tuple[float, dict[str, Any]]]] = defaultdict(list)
    for item in reading:
        if item.name not in MEASURED:
            found[item.topic].append((reading.run_time(item), dict(flat(decoding.values(item)))))
    return found


def _apart(one: Any, two: Any) -> float:
    if isinstance(one, list) and isinstance(two, list) and len(one) == len(two):
        return max(map(_apart, one, two), default=0.0)
    if not isinstance(one, int | float) or not isinstance(two, int | float):
        return 0.0 if one == two else inf
    if one == two or (isnan(one) and isnan(two)):
        return 0.0
    apart = abs(one - two)
    return inf if isnan(apart) else apart
