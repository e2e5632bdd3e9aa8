"""A disk that is full when one file of a recording ends and the next begins, and has room again later."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.examples import some
from txt1.errors import ConfigError
from txt1.model.odometry import Odometry
from txt1.record import mcap_file
from txt1.record.file_sink import FileSink, Rotation, parts
from txt1.record.mcap_records import Block, Encoder
from txt1.tasks.encoder import ODOMETRY

BLOCKS, MESSAGES = 30, 40
"""So many blocks of so many messages are written."""
SHARES = [k / 40 for k in range(41)]
"""Shares of all bytes for which there is room at first."""


class Disk:
    """Takes so many bytes, then nothing more until it is given room, as the kernel does: the last write is partial."""

    def __init__(self, room: float) -> None:
        self.room = room

    def __getattr__(self, name: str) -> object:
        return getattr(os, name)

    def write(self, file: int, data: bytes) -> int:
        taken = int(min(self.room, len(data)))
        if not taken:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.room -= taken
        return os.write(file, data[:taken])


def blocks() -> list[Block]:
    encoder = Encoder(0.0)
    times = [k / 50.0 for k in range(BLOCKS * MESSAGES)]
    messages = [(time, ODOMETRY, Odometry(time, 0.0, 0.0, 1.0, 0.0)) for time in times]
    return [encoder.block(messages[k : k + MESSAGES]) for k in range(0, len(messages), MESSAGES)]


def recorded(path: Path) -> int:
    """How many messages are in the files of a recording, all of which have to be complete."""
    count = 0
    for each in parts(path):
        with each.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None and summary.statistics is not None
        count += summary.statistics.message_count
    return count


def open_in(folder: Path) -> list[str]:
    """The files of a folder that this process has open."""
    links = []
    for each in os.listdir("/dev/fd"):
        # the listing's own descriptor is closed again
        with suppress(OSError):
            links.append(os.readlink(f"/dev/fd/{each}"))
    return [each for each in links if each.startswith(str(folder))]


def sink(path: Path) -> FileSink:
    return FileSink(path, {}, Rotation(size=8000), "zstd", strict=False)


@pytest.mark.parametrize("share", some(*SHARES[::4], rest=[each for k, each in enumerate(SHARES) if k % 4]))
def test_what_is_written_once_there_is_room_again_is_recorded(
    share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.mcap"
    whole = sink(tmp_path / "whole.mcap")
    assert not any(map(whole.write, blocks()))
    whole.close(0)
    needed = sum(each.stat().st_size for each in parts(tmp_path / "whole.mcap"))
    disk = Disk(1000.0 + share * (needed - 1000.0))
    monkeypatch.setattr(mcap_file, "os", disk)
    file, lost, full_since = sink(path), 0, None
    for k, block in enumerate(blocks()):
        now = file.write(block)
        lost += now
        if now and full_since is None:
            full_since = k
        if full_since is not None and k == full_since + 4:
            disk.room = float("inf")
        assert not now or full_since is None or k <= full_since + 4
    disk.room = float("inf")
    file.close(lost)
    assert recorded(path) == BLOCKS * MESSAGES - lost
    assert lost <= 5 * MESSAGES
    assert not open_in(tmp_path)


def test_a_recording_that_finds_a_full_disk_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_file, "os", Disk(20.0))
    with pytest.raises(ConfigError, match="No space left on device; make room on the disk"):
        sink(tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())
