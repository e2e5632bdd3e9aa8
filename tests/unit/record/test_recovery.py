"""What is recovered of a recording that broke off: all that is whole, in order, and nothing else."""

from __future__ import annotations

from errno import ENOSPC
from io import BufferedWriter, RawIOBase
from os import strerror
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from txt1.errors import RecordingError
from txt1.record.reader import FilePass
from txt1.record.recovery import Recovered, recover


def recording(path: Path) -> tuple[int, int]:
    """Write a recording in which something of each kind is; where its last message ends, and the length of that."""
    with path.open("xb") as file:
        writer = Writer(file, use_chunking=False, enable_data_crcs=False)
        writer.start("ros2", "the library")
        schemas = [writer.register_schema(name, "ros2msg", name.encode()) for name in ("one", "two")]
        known = (
            writer.register_channel("/a", "cdr", schemas[1], {"topic": "/a"}),
            writer.register_channel("/b", "json", 0),  # has no schema
        )
        writer.add_metadata("txt1", {"epoch": "5"})
        writer.add_attachment(1, 2, "plan", "text/plain", b"a plan")
        orphan = writer.register_channel("/c", "cdr", 77)  # its schema is not in the file
        channels = (*known, orphan, 99)  # the last is not in the file
        for k in (2, 0, 1, 3, 4, 5):
            start = file.tell()
            writer.add_message(channels[k % 4], 1000 + k, bytes([k]), 500 + k, k)
        end = file.tell()
        writer.finish()  # type: ignore[no-untyped-call]
    return end, end - start


@pytest.mark.parametrize(("off", "complete"), [(0, True), (None, False), (5, False)])
def test_all_that_is_whole_is_recovered_in_order_and_nothing_is_made_up(
    tmp_path: Path, off: int | None, complete: bool
) -> None:
    path, target = tmp_path / "run.mcap", tmp_path / "saved.mcap"
    end, last = recording(path)
    if off != 0:
        path.write_bytes(path.read_bytes()[: end - (off or 0)])
    kept = 3 if off == 5 else 4  # of the messages whose channel is known
    assert recover(path, target) == Recovered(kept, 0, last - 5 if off == 5 else 0, complete)
    with target.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        header, summary, metadata = reader.get_header(), reader.get_summary(), list(reader.iter_metadata())
        messages, attachments = list(reader.iter_messages()), list(reader.iter_attachments())
    assert (header.profile, header.library) == ("ros2", "the library") and summary is not None
    assert [(each.name, each.encoding, each.data) for each in summary.schemas.values()] == [
        ("one", "ros2msg", b"one"),
        ("two", "ros2msg", b"two"),
    ]
    assert [
        (channel.topic, channel.message_encoding, channel.metadata, None if schema is None else schema.name)
        for schema, channel, _ in messages
    ] == [(("/a", "cdr", {"topic": "/a"}, "two"), ("/b", "json", {}, None))[k % 4] for k in (0, 1, 4, 5)[:kept]]
    assert [(each.log_time, each.publish_time, each.sequence, each.data) for _, _, each in messages] == [
        (1000 + k, 500 + k, k, bytes([k])) for k in (0, 1, 4, 5)[:kept]
    ]
    assert [(each.name, each.metadata) for each in metadata] == [("txt1", {"epoch": "5"})]
    assert [(each.create_time, each.log_time, each.name, each.media_type, each.data) for each in attachments] == [
        (1, 2, "plan", "text/plain", b"a plan")
    ]
    again = tmp_path / "again.mcap"
    assert recover(target, again) == Recovered(kept, 0, 0, True) and again.read_bytes() == target.read_bytes()


def test_a_recording_that_broke_off_at_once_becomes_an_empty_one(tmp_path: Path) -> None:
    path, target = tmp_path / "run.mcap", tmp_path / "saved.mcap"
    with pytest.raises(RecordingError, match="cannot read it: No such file"):
        recover(path, target)
    path.write_bytes(b"this is a letter, no recording")
    with pytest.raises(RecordingError, match="no MCAP file"):
        recover(path, target)
    assert not target.exists()
    path.write_bytes(b"")
    assert recover(path, target) == Recovered(0, 0, 0, False) and FilePass(target).complete is False
    assert recover(target, tmp_path / "again.mcap") == Recovered(0, 0, 0, True)


class Full(RawIOBase):
    """A file on a disk that is full."""

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        return 0

    def write(self, data: object) -> int:
        raise OSError(ENOSPC, strerror(ENOSPC))


def test_a_disk_that_is_full_only_at_the_last_byte_leaves_no_half_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, target = tmp_path / "run.mcap", tmp_path / "saved.mcap"
    recording(path)
    real = Path.open

    def opened(self: Path, mode: str) -> Any:
        if mode != "xb":
            return real(self, mode)
        self.touch()
        return BufferedWriter(Full(), 1 << 20)

    monkeypatch.setattr(Path, "open", opened)
    with pytest.raises(RecordingError, match=r"saved\.mcap: cannot write it: No space left"):
        recover(path, target)
    assert not target.exists()
