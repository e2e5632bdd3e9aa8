"""An MCAP file as it is being written: in chunks, each complete on the disk at once, and the index at the end.

The records are the mcap library's. Its writer is not used: it takes one call of 5 us per message, and when the disk is
full it leaves half a chunk behind. Here a chunk that does not fit is taken back, and the file stays readable.
"""

import json
import os
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any, Final, Literal

import lz4.frame
import zstandard
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from txt1.errors import ConfigError
from txt1.record.mcap_records import Block
from txt1.telemetry.messages import schema_name, schema_text
from txt1.telemetry.topics import Rule
from txt1.version import __version__

# counts up when a reader has to treat files otherwise than before; a new topic or field is no reason
FORMAT: Final = 3
# bytes of the footer record that its own checksum covers
FOOTER_UP_TO_CRC: Final = 25
MESSAGE_INDEX: Final = struct.Struct("<BQHI")
"""The head of a message index record: opcode, length, channel, bytes of entries."""

# rosbag2's numbers of qualities of service, as all its versions up to 8 of the metadata have them
KEEP_LAST, RELIABLE, TRANSIENT_LOCAL, VOLATILE, AUTOMATIC = 1, 1, 1, 2, 1
FOREVER: Final = {"sec": 9223372036, "nsec": 854775807}
ROSBAG2: Final = json.dumps(
    {
        "version": 4,
        "storage_identifier": "mcap",
        "relative_file_paths": [],
        "duration": {"nanoseconds": 0},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 0,
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
    }
)
"""Metadata of rosbag2: their version, by which it reads the qualities of service. It takes the counts from the file."""

Compression = Literal["zstd", "lz4", "none"]

_COMPRESS: Final[dict[Compression, Callable[[bytes], bytes]]] = {
    "zstd": zstandard.ZstdCompressor(level=-1).compress,
    "lz4": lz4.frame.compress,
    "none": bytes,
}


class McapFile:
    """A file that grows by chunks; the metadata come first, so that they are there whatever happens later.

    Raises ConfigError: the file exists already, or cannot be made. No file is left behind then.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str], compression: Compression = "zstd") -> None:
        self.path = path
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except FileExistsError:
            raise ConfigError(f"{path}: there is such a file already; choose another name for the recording") from None
        except OSError as error:
            raise ConfigError(f"{path}: cannot make the recording: {error.strerror}; choose another place") from None
        self.size = 0
        """Bytes on the disk."""
        self._compression = compression
        # time stamp of the run's start as the metadata have it, s since 1970
        self._epoch = float(metadata.get("epoch", "0"))
        self._schemas: dict[str, mcap.Schema] = {}
        self._channels: dict[int, mcap.Channel] = {}
        # their index, as it goes to the end of the file, packed: a day of two chunks a second has 0.1 GB of it
        self._chunks, self._packing = bytearray(), zlib.compressobj(1)
        self._chunk_count = 0
        # of all messages, ns
        self._span: tuple[int, int] | None = None
        self._metadata: list[mcap.MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        head = MCAP0_MAGIC + _bytes(mcap.Header("ros2", f"txt1 {__version__}"))
        about = self._metadata_record("txt1", {"format": str(FORMAT)} | dict(metadata), len(head))
        about += self._metadata_record("rosbag2", {"serialized_metadata": ROSBAG2}, len(head) + len(about))
        try:
            self._write(head + about)
        except OSError as error:
            self.discard()
            raise ConfigError(f"{path}: cannot make the recording: {error.strerror}; make room on the disk") from None

    def _write(self, data: bytes) -> None:
        """Append bytes, all of them or none; raises OSError when the disk does not take them."""
        written = 0
        try:
            while written < len(data):
                written += os.write(self._file, data[written:] if written else data)
        except OSError:
            if written:
                self._cut(self.size)
            raise
        self.size += len(data)

    def _cut(self, size: int) -> None:
        """Take back everything after this number of bytes; raises OSError."""
        os.ftruncate(self._file, size)
        os.lseek(self._file, size, os.SEEK_SET)
        self.size = size

    def _metadata_record(self, name: str, metadata: Mapping[str, str], start: int) -> bytes:
        """Return a metadata record, which the summary refers to from now on, for byte `start` of the file."""
        data = _bytes(mcap.Metadata(name, dict(metadata)))
        self._metadata.append(mcap.MetadataIndex(length=len(data), name=name, offset=start))
        return data

    def add(self, block: Block) -> None:
        """Append a block as one chunk with its index; raises OSError, and then nothing of it is in the file."""
        if not block.index:
            return
        schemas, channels = self._declared(block)
        indexed, declarations = len(self._metadata), b""
        if block.epoch != self._epoch:
            declarations = self._metadata_record("txt1.time", {"epoch": repr(block.epoch)}, self.size)
        declarations += _bytes(*schemas.values(), *channels.values())
        compressed = _COMPRESS[self._compression](block.data)
        about: dict[str, Any] = {
            "compression": "" if self._compression == "none" else self._compression,
            "message_start_time": block.first,
            "message_end_time": block.last,
            "uncompressed_size": len(block.data),
        }
        chunk = _bytes(mcap.Chunk(data=compressed, uncompressed_crc=zlib.crc32(block.data), **about))
        start, index, offsets = self.size + len(declarations), b"", {}
        for channel, entries in block.index.items():
            offsets[channel] = start + len(chunk) + len(index)
            index += _message_index(channel, entries)
        try:
            self._write(declarations + chunk + index)
        except OSError:
            del self._metadata[indexed:]
            raise
        self._epoch = block.epoch
        self._schemas |= schemas
        self._channels |= channels
        entry = mcap.ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=start,
            compressed_size=len(compressed),
            message_index_length=len(index),
            message_index_offsets=offsets,
            **about,
        )
        self._chunks += self._packing.compress(_bytes(entry))
        self._chunk_count += 1
        first, last = self._span or (block.first, block.last)
        self._span = min(first, block.first), max(last, block.last)
        self._counts.update({channel: len(entries) for channel, entries in block.index.items()})

    def _declared(self, block: Block) -> tuple[dict[str, mcap.Schema], dict[int, mcap.Channel]]:
        """Schemas and channels that this block is the first to use; a topic that is never told is not in the file."""
        schemas: dict[str, mcap.Schema] = {}
        channels: dict[int, mcap.Channel] = {}
        for number in sorted(block.index.keys() - self._channels.keys()):
            name, topic = block.channels[number - 1]
            schema = self._schemas.get(topic.message) or schemas.get(topic.message)
            if schema is None:
                schema = schemas[topic.message] = mcap.Schema(
                    id=len(self._schemas) + len(schemas) + 1,
                    data=schema_text(topic.message).encode(),
                    encoding="ros2msg",
                    name=schema_name(topic.message),
                )
            about = {"topic": topic.name, "about": topic.about, "units": topic.units, "rule": topic.rule.value}
            about |= {"own": str(topic.own), "derived": str(topic.derived)}
            about["offered_qos_profiles"] = offered_qos(topic.rule)
            channels[number] = mcap.Channel(
                id=number, topic=name, message_encoding="cdr", metadata=about, schema_id=schema.id
            )
        return schemas, channels

    def sync(self) -> None:
        """See everything on the disk itself; raises OSError."""
        os.fsync(self._file)

    def close(self, end: Mapping[str, str]) -> None:
        """Append the metadata of the end and the index of the whole file, and close the file.

        Raises OSError: the disk does not take them; then none of them is in the file, which is still open.
        """
        last = self._metadata_record("txt1.end", end, self.size) + _bytes(mcap.DataEnd(0))
        size = self.size
        try:
            self._write(last + self._summary(size + len(last)))
            os.fsync(self._file)
        except OSError:
            self._metadata.pop()
            self._cut(size)
            raise
        os.close(self._file)

    def abandon(self) -> None:
        """Close the file as it is; its content can be recovered."""
        with suppress(OSError):
            os.close(self._file)

    def discard(self) -> None:
        """Close the file and delete it."""
        self.abandon()
        with suppress(OSError):
            self.path.unlink()

    def _summary(self, start: int) -> bytes:
        """The summary section that begins at byte `start`, the footer and the closing magic."""
        first, last = self._span or (0, 0)
        statistics = mcap.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=self._chunk_count,
            message_count=self._counts.total(),
            message_start_time=first,
            message_end_time=last,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        # the packing goes on where the file cannot be closed
        chunks = zlib.decompress(self._chunks + self._packing.copy().flush())
        summary, offsets = b"", []
        for opcode, group in (
            (Opcode.SCHEMA, _bytes(*self._schemas.values())),
            (Opcode.CHANNEL, _bytes(*self._channels.values())),
            (Opcode.STATISTICS, _bytes(statistics)),
            (Opcode.CHUNK_INDEX, chunks),
            (Opcode.METADATA_INDEX, _bytes(*self._metadata)),
        ):
            if group:
                offsets.append(
                    mcap.SummaryOffset(group_length=len(group), group_opcode=opcode, group_start=start + len(summary))
                )
            summary += group
        footer = mcap.Footer(summary_start=start, summary_offset_start=start + len(summary), summary_crc=0)
        summary += _bytes(*offsets)
        footer.summary_crc = zlib.crc32(_bytes(footer)[:FOOTER_UP_TO_CRC], zlib.crc32(summary))
        return summary + _bytes(footer) + MCAP0_MAGIC


def offered_qos(rule: Rule) -> str:
    """Return the quality of service of a topic's publisher in ROS 2, as rosbag2 writes it: `ros2 bag play` offers it.

    Values that are told on change are kept for late subscribers.
    """
    kept = rule in (Rule.CHANGE, Rule.SECOND)
    return json.dumps(
        [
            {
                "history": KEEP_LAST,
                "depth": 1 if kept else 10,
                "reliability": RELIABLE,
                "durability": TRANSIENT_LOCAL if kept else VOLATILE,
                "deadline": FOREVER,
                "lifespan": FOREVER,
                "liveliness": AUTOMATIC,
                "liveliness_lease_duration": FOREVER,
                "avoid_ros_namespace_conventions": False,
            }
        ]
    )


def _bytes(*records: mcap.McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def _message_index(channel: int, entries: Sequence[tuple[int, int]]) -> bytes:
    """Return a message index record; its entries are pairs of log time (ns) and offset."""
    length = 16 * len(entries)
    return MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + length, channel, length) + struct.pack(
        f"<{2 * len(entries)}Q", *chain.from_iterable(entries)
    )
