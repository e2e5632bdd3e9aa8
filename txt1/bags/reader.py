"""Bags of ROS 1 and ROS 2: their topics, and their messages with times.

A bag is a file of ROS 1 (.bag), a file of ROS 2 (.db3, .mcap), or the folder that `ros2 bag record` makes. The library
rosbags decodes them; no ROS is needed. A bag without definitions of its messages, as ROS 2 wrote before Iron, is read
with those of Humble.
"""

from __future__ import annotations

import atexit
from collections.abc import Collection, Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Final, NamedTuple

from txt1.errors import MissingExtra, Txt1Error

SUFFIXES: Final = (".bag", ".db3", ".mcap")
METADATA: Final = "metadata.yaml"
"""In the folder that `ros2 bag record` makes."""
OWN: Final = b"txt1"
HEADER_BYTES: Final = 64
"""Bytes at the beginning of an MCAP file that hold its header's library."""
NS_PER_S: Final = 1e9


class BagError(Txt1Error):
    """A bag cannot be read, or has not what was asked for."""


class BagTopic(NamedTuple):
    """A topic of a bag."""

    name: str
    kind: str
    """Type of its messages, such as sensor_msgs/LaserScan: the same for ROS 1 and ROS 2."""
    messages: int
    """Number of messages."""


class Timed(NamedTuple):
    """A message of a bag."""

    topic: str
    time: float
    """s since 1970: of its header if it has one, else of its recording."""
    recorded: float
    """s since 1970 when it was recorded."""
    value: Any
    """The message, with its fields as attributes."""


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag of ROS: by its suffix, or as a folder; an MCAP file if txt1 did not write it."""
    if path.is_dir():
        return any(each.name == METADATA or is_bag(each) for each in path.iterdir() if each.is_file())
    if path.suffix != ".mcap":
        return path.suffix in SUFFIXES
    try:
        with path.open("rb") as file:
            return OWN not in file.read(HEADER_BYTES)
    except OSError:
        return False


class Bag:
    """An open bag; a context."""

    def __init__(self, path: Path) -> None:
        """Prepare to read; raises MissingExtra."""
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise MissingExtra("reading a bag of ROS", "record") from None
        self.path = path
        self._opened = ExitStack()
        with _Told(path):
            self._reader = AnyReader(_files(path), default_typestore=get_typestore(Stores.ROS2_HUMBLE))

    def __enter__(self) -> Bag:
        with _Told(self.path):
            self._opened.enter_context(self._reader)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.close()

    @property
    def is_ros2(self) -> bool:
        """Whether ROS 2 made it."""
        return bool(self._reader.is2)

    @property
    def begin(self) -> float:
        """When its first message was recorded, s since 1970."""
        return float(self._reader.start_time / NS_PER_S)

    @property
    def length(self) -> float:
        """The time from its first message to its last, s."""
        return float(self._reader.duration / NS_PER_S)

    @property
    def topics(self) -> list[BagTopic]:
        """The topics, by name."""
        counts: dict[tuple[str, str], int] = {}
        for each in self._reader.connections:
            key = each.topic, each.msgtype.replace("/msg/", "/")
            counts[key] = counts.get(key, 0) + each.msgcount
        return [BagTopic(name, kind, count) for (name, kind), count in sorted(counts.items())]

    def of_kind(self, *kinds: str) -> list[str]:
        """Return the names of the topics that have messages of these types."""
        return [each.name for each in self.topics if each.kind in kinds and each.messages]

    def chosen(self, asked: str | None, option: str, *kinds: str) -> str | None:
        """Return the topic that was asked for, else the one with most messages of these types, None: there is none.

        Raises BagError: the topic that was asked for is not there.
        """
        there = [each for each in self.topics if each.kind in kinds and each.messages]
        if asked is not None and asked not in (each.name for each in there):
            names = ", ".join(each.name for each in there) or "none"
            raise BagError(f"{self.path}: {option} {asked}: no topic of {' or '.join(kinds)}; there are: {names}")
        if asked is not None or not there:
            return asked
        return max(there, key=lambda each: each.messages).name

    def messages(self, topics: Collection[str]) -> Iterator[Timed]:
        """Yield the messages on these topics, in the order of their recording; raises BagError."""
        with _Told(self.path):
            wanted = [each for each in self._reader.connections if each.topic in topics]
            if not wanted:
                return
            for connection, stamp, data in self._reader.messages(connections=wanted):
                value: Any = self._reader.deserialize(data, connection.msgtype)
                yield Timed(connection.topic, _stamped(value) or stamp / NS_PER_S, stamp / NS_PER_S, value)


def _files(path: Path) -> list[Path]:
    """Return what the library reads for a bag."""
    paths = [path]
    if path.is_dir() and not (path / METADATA).exists():
        paths = sorted(each for each in path.iterdir() if each.is_file() and is_bag(each))
    if not paths:
        raise BagError(f"{path}: no bag in this folder: no metadata.yaml, .bag, .db3 or .mcap")
    return paths


@cache
def as_mcap(path: Path) -> Path:
    """Return a bag as an MCAP file of ROS 2, which is there until the process ends; raises BagError, MissingExtra."""
    try:
        from rosbags.convert import convert
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtra("reading a bag of ROS", "record") from None
    folder = TemporaryDirectory(prefix="txt1-")
    atexit.register(folder.cleanup)
    made, humble = Path(folder.name, "bag"), get_typestore(Stores.ROS2_HUMBLE)
    with _Told(path):
        # of ROS 1, the types of ROS 2 have fewer fields
        to = humble if path.suffix == ".bag" else None
        convert(_files(path), made, "mcap", 9, None, "none", humble, to, (), (), (), ())
        (file,) = made.glob("*.mcap")
    return file


class _Told:
    """Turns every error of the library into a BagError that names the file: each layer of it has its own."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, Exception) and not isinstance(error, Txt1Error):
            reason = str(error) or type(error).__name__
            raise BagError(f"{self._path}: no bag of ROS that can be read: {reason}") from error


def _stamped(message: Any) -> float:
    """Return the time in a message's header, s; 0 without one."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0.0 if stamp is None else float(stamp.sec) + float(stamp.nanosec) / NS_PER_S
