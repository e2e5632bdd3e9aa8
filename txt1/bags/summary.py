"""A bag of ROS in words and numbers: its topics with counts and rates; its messages as lines."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from txt1.bags.reader import Bag, BagError


def info(path: Path) -> Iterator[str]:
    """Return a bag's summary as lines; raises BagError, MissingExtra."""
    with Bag(path) as bag:
        topics, length = bag.topics, bag.length
        yield f"{path}: a bag of ROS {2 if bag.is_ros2 else 1}"
        if not any(each.messages for each in topics):
            yield "no messages"
            return
        began = datetime.fromtimestamp(bag.begin, UTC).isoformat()
        yield f"{sum(each.messages for each in topics)} messages in {length:.2f} s, which began at {began}"
        yield f"{'topic':<24}{'messages':>9}{'rate/Hz':>9}  type"
        for each in topics:
            rate = each.messages / length if length else 0.0
            yield f"{each.name:<24}{each.messages:>9}{rate:>9.2f}  {each.kind}"


def lines(path: Path, topics: Sequence[str], start: float | None, end: float | None) -> Iterator[str]:
    """Yield each message as a line of JSON, of these topics or of all; numbers that are not finite become null.

    Raises BagError: a topic is not there, or the bag cannot be read; MissingExtra.
    """
    first, last = -inf if start is None else start, inf if end is None else end
    with Bag(path) as bag:
        names = [each.name for each in bag.topics]
        for topic in topics:
            if topic not in names:
                raise BagError(f"--topic {topic}: not in {path}, which has {', '.join(names) or 'none'}")
        for message in bag.messages(topics or names):
            if first <= message.recorded <= last:
                record = {"time": message.recorded, "topic": message.topic, "message": plain(message.value)}
                yield json.dumps(record, allow_nan=False)


def plain(value: Any) -> Any:
    """Return a message as plain values: dictionaries, lists, numbers, texts."""
    if isinstance(value, np.ndarray):
        return [plain(each) for each in value.tolist()]
    if isinstance(value, list):
        return [plain(each) for each in value]
    if isinstance(value, float):
        return value if isfinite(value) else None
    fields = getattr(value, "__dataclass_fields__", None)
    if fields is None:
        return value
    return {name: plain(getattr(value, name)) for name in fields if not name.startswith("_")}
