"""Recordings that have come to harm."""

from __future__ import annotations

from pathlib import Path

from mcap.reader import make_reader


def spoil_second_chunk(path: Path, target: Path) -> None:
    """A copy with one bit inverted in the middle of its second chunk."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[1]
    data = bytearray(path.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0x10
    target.write_bytes(data)
