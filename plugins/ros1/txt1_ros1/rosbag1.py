"""A recording as a bag of ROS 1, for the tools of that time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from rosbags.convert.converter import is_same_wireformat, migrate_bytes
from rosbags.rosbag1 import Writer, WriterError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from txt1.errors import ConfigError, RecordingError
from txt1.record.reader import Item


class Converter:
    """Makes ROS 1's messages of ROS 2's; types of our own are the same in both."""

    def __init__(self) -> None:
        self.store = get_typestore(Stores.ROS1_NOETIC)
        """The types of ROS 1."""
        self._source = get_typestore(Stores.ROS2_JAZZY)
        self._cache: dict[str, object] = {}
        self._functions: dict[str, Callable[[bytes], Any]] = {}

    def add(self, kind: str, text: str) -> None:
        """Register a message, ``package/msg/Name``, by its definition and its parts' definitions."""
        found = get_types_from_msg(text, kind)
        for store in (self._source, self.store):
            store.register({name: fields for name, fields in found.items() if name not in store.fielddefs})
        if is_same_wireformat(self._source, self.store, kind, kind):
            self._functions[kind] = partial(self._source.cdr_to_ros1, typename=kind)
        else:
            self._functions[kind] = partial(
                migrate_bytes, self._source, self.store, kind, kind, self._cache, src_is2=True, dst_is2=False
            )

    def convert(self, kind: str, data: bytes) -> bytes:
        """The bytes of a message in ROS 1, from its CDR."""
        return bytes(self._functions[kind](data))


def export(items: Iterable[Item], file: Path) -> int:
    """Write messages to a bag that is not there yet, and return how many.

    Raises ConfigError: it is there; RecordingError: a message or its definition is damaged, and there is no bag then.
    """
    try:
        bag = Writer(file)
        bag.open()
    except WriterError as error:
        told = "is there already" if file.exists() else str(error)
        raise ConfigError(f"{file}: {told}; choose another name with -o") from None
    try:
        count = _write(items, bag)
        bag.close()
    except BaseException:
        # half a bag is none
        file.unlink(missing_ok=True)
        if bag.bio is not None:
            # of a full disk, once more
            with suppress(OSError):
                bag.bio.close()
        raise
    return count


def _write(items: Iterable[Item], bag: Writer) -> int:
    converter = Converter()
    connections: dict[int, tuple[Any, str]] = {}
    count = 0
    for item in items:
        try:
            if item.channel.id not in connections:
                kind = item.schema.name
                converter.add(kind, item.schema.data.decode())
                connections[item.channel.id] = bag.add_connection(item.topic, kind, typestore=converter.store), kind
            connection, kind = connections[item.channel.id]
            bag.write(connection, item.message.log_time, converter.convert(kind, item.message.data))
        except OSError:
            raise
        except Exception as error:
            # whatever the library says to bytes that are no message
            raise RecordingError(
                f"{item.topic}: a message cannot be put in a bag, so it or its definition is damaged "
                f"({type(error).__name__}: {' '.join(str(error).split())[:200]}); choose other topics with --topic"
            ) from error
        count += 1
    return count
