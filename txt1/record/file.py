"""An MCAP file as it is being written: in chunks, each complete on the disk at once, and the index at the end.

The records are the mcap library's. Its writer is not used: it takes one call of 5 us per message, and when the disk is
full it leaves half a chunk behind. Here a chunk that does not fit is taken back, and the file stays readable.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final, Literal

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from txt1 import __version__
from txt1.errors import ConfigError
from txt1.record.encoder import Block
from txt1.telemetry.messages import schema_name, schema_text

FORMAT: Final = 2
"""Counts up when a reader has to treat files otherwise than before; a new topic or field is no reason."""
PROFILE: Final = "ros2"
LIBRARY: Final = f"txt1 {__version__}"

Compression = Literal["zstd", "lz4", "none"]

_COMPRESS: Final[dict[Compression, Callable[[bytes], bytes]]] = {
    "zstd": zstandard.ZstdCompressor(level=-1).compress,
    "lz4": lz4.frame.compress,
    "none": bytes,
}


class McapFile:
    """A file that grows by chunks.

    Args:
        path: of the file; there must be none yet.
        metadata: written first, so that it is there whatever happens later.
        compression: of the chunks.

    Raises:
        ConfigError: the file exists, or cannot be made.

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
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._first, self._last = 0, 0
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self.write(MCAP0_MAGIC + _bytes(Header(PROFILE, LIBRARY)))
        self.add_metadata("txt1", {"format": str(FORMAT)} | dict(metadata))

    def _declare(self, block: Block) -> bytes:
        """Schemas and channels that this block is the first to use; a topic that is never told is not in the file."""
        records: list[McapRecord] = []
        for number in sorted(block.index.keys() - self._channels.keys()):
            name, topic = block.channels[number - 1]
            schema = self._schemas.get(topic.message)
            if schema is None:
                schema = self._schemas[topic.message] = Schema(
                    id=len(self._schemas) + 1, data=schema_text(topic.message).encode(), encoding="ros2msg",
                    name=schema_name(topic.message),
                )  # fmt: skip
                records.append(schema)
            about = {"topic": topic.name, "about": topic.about, "units": topic.units, "rule": topic.rule.value}
            self._channels[number] = Channel(
                id=number, topic=name, message_encoding="cdr", metadata=about, schema_id=schema.id
            )
            records.append(self._channels[number])
        return _bytes(*records)

    def write(self, data: bytes) -> None:
        """Append bytes, all of them or none.

        Raises:
            OSError: the disk does not take them.

        """
        written = 0
        try:
            while written < len(data):
                written += os.write(self._file, data[written:] if written else data)
        except OSError:
            if written:
                os.ftruncate(self._file, self.size)
                os.lseek(self._file, self.size, os.SEEK_SET)
            raise
        self.size += len(data)

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Append a metadata record; raises OSError."""
        start, data = self.size, _bytes(Metadata(name, dict(metadata)))
        self.write(data)
        self._metadata.append(MetadataIndex(length=len(data), name=name, offset=start))

    def add(self, block: Block) -> None:
        """Append a block as one chunk with its index; raises OSError, and then nothing of it is in the file."""
        if not block.index:
            return
        declared = len(self._schemas), len(self._channels)
        declarations = self._declare(block)
        compressed = _COMPRESS[self._compression](block.data)
        compression = "" if self._compression == "none" else self._compression
        chunk = _bytes(
            Chunk(
                compression=compression,
                data=compressed,
                message_start_time=block.first,
                message_end_time=block.last,
                uncompressed_crc=zlib.crc32(block.data),
                uncompressed_size=len(block.data),
            )
        )
        start, pieces, offsets, behind = self.size + len(declarations), [declarations, chunk], {}, 0
        for channel, entries in block.index.items():
            offsets[channel] = start + len(chunk) + behind
            index = _message_index(channel, entries)
            pieces.append(index)
            behind += len(index)
        try:
            self.write(b"".join(pieces))
        except OSError:  # they are not in the file either
            for known in (self._schemas, self._channels):
                while len(known) > declared[known is self._channels]:
                    known.popitem()
            raise
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=start,
                compression=compression,
                compressed_size=len(compressed),
                message_end_time=block.last,
                message_index_length=behind,
                message_index_offsets=offsets,
                message_start_time=block.first,
                uncompressed_size=len(block.data),
            )
        )
        if not self._counts:
            self._first = block.first
        self._first, self._last = min(self._first, block.first), max(self._last, block.last)
        for channel, entries in block.index.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(entries)

    def sync(self) -> None:
        """See everything on the disk itself; raises OSError."""
        os.fsync(self._file)

    def close(self) -> None:
        """Append the index of the whole file and let go of it; raises OSError."""
        try:
            self.write(_bytes(DataEnd(0)) + self._summary(self.size + DATA_END_LENGTH))
            os.fsync(self._file)
        finally:
            os.close(self._file)

    def abandon(self) -> None:
        """Let go of the file as it is; what is in it can be recovered."""
        with suppress(OSError):
            os.close(self._file)

    def _summary(self, start: int) -> bytes:
        """The summary section that begins at byte `start`, the footer and the closing magic."""
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, list(self._chunks)),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]
        summary, offsets = b"", []
        for opcode, records in groups:
            group = _bytes(*records)
            if group:
                offsets.append(
                    SummaryOffset(group_length=len(group), group_opcode=opcode, group_start=start + len(summary))
                )
            summary += group
        offset_start = start + len(summary)
        summary += _bytes(*offsets)
        footer = Footer(summary_crc=0, summary_offset_start=offset_start, summary_start=start)
        footer.summary_crc = zlib.crc32(_bytes(footer)[:FOOTER_UP_TO_CRC], zlib.crc32(summary))
        return summary + _bytes(footer) + MCAP0_MAGIC

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=self._last,
            message_start_time=self._first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


FOOTER_UP_TO_CRC: Final = 25
"""Bytes of the footer record that its own checksum covers."""


def _bytes(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return _end(builder)


def _end(builder: RecordBuilder) -> bytes:
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


DATA_END_LENGTH: Final = len(_bytes(DataEnd(0)))


MESSAGE_INDEX: Final = struct.Struct("<BQHI")
"""The head of a message index record: opcode, length, channel, bytes of entries."""


def _message_index(channel: int, entries: np.ndarray[tuple[int, ...], np.dtype[np.uint64]]) -> bytes:
    """A message index record, whose entries are pairs of numbers as numpy has them already."""
    data = entries.astype("<u8", copy=False).tobytes()
    return MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(data), channel, len(data)) + data
