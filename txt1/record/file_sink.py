"""The recorder's sink on the disk: a file, or several in turn; it survives a full disk."""

from collections.abc import Iterator, Mapping
from itertools import count, takewhile
from pathlib import Path
from typing import Final, NamedTuple

from txt1.errors import ConfigError, RecordingError
from txt1.kernel.clock import NS_PER_S, stopwatch_ns
from txt1.record.mcap_file import Compression, McapFile
from txt1.record.mcap_records import Block

# real time after which what was written is forced to the disk with the next block
SYNC_NS: Final = NS_PER_S * 2 // 5


class Rotation(NamedTuple):
    """When to begin the next file: after bytes, or after ns of the run; 0 for never."""

    size: int = 0
    time_ns: int = 0


def part(path: Path, number: int) -> Path:
    """The file with a recording's part of that number, the first being 0: FILE.mcap, FILE.1.mcap and so on."""
    return path.with_name(f"{path.stem}.{number}{path.suffix}") if number else path


def parts(path: Path) -> Iterator[Path]:
    """The files that there are of a recording."""
    return takewhile(Path.exists, (part(path, number) for number in count()))


class FileSink:
    """Writes blocks to FILE.mcap and, where a rotation asks for it, to FILE.1.mcap, FILE.2.mcap and so on.

    A block that the disk does not take ends the recording where this is `strict`; otherwise it is lost and counted.
    Raises ConfigError: the file exists, or cannot be made.
    """

    def __init__(
        self, path: Path, metadata: Mapping[str, str], rotation: Rotation, compression: Compression, *, strict: bool
    ) -> None:
        self._path, self._metadata, self._rotation, self._strict = path, dict(metadata), rotation, strict
        self._compression: Compression = compression
        self._lost = 0
        self._parts = 1
        self._synced_ns = stopwatch_ns()
        self._began: int | None = None
        self._file = McapFile(path, self._metadata, compression)

    def write(self, block: Block) -> int:
        """How many messages of a block were lost because the disk is full; RecordingError where none may be."""
        if not block.index:
            return 0
        try:
            if self._is_full(block):
                self._next_file()
            if self._began is None:
                self._began = block.first
            self._file.add(block)
            if stopwatch_ns() - self._synced_ns >= SYNC_NS:
                self._file.sync()
                self._synced_ns = stopwatch_ns()
        except (OSError, ConfigError) as error:
            if self._strict:
                raise RecordingError(f"{self._file.path}: {_words(error)}; make room on the disk") from error
            self._lost += block.count
            return block.count
        return 0

    def close(self, dropped: int) -> None:
        """Finish the file; RecordingError: it cannot be finished, but its content can be recovered."""
        try:
            self._file.close({"dropped": str(dropped)})
        except OSError as error:
            self._file.abandon()
            raise RecordingError(
                f"{self._file.path}: cannot finish it: {_words(error)}; 'txt1 log recover' saves what is in it"
            ) from error

    def _is_full(self, block: Block) -> bool:
        size, time_ns = self._rotation
        if self._began is None:
            return False
        return bool((size and self._file.size >= size) or (time_ns and block.first - self._began >= time_ns))

    def _next_file(self) -> None:
        """Begin the next file. OSError or ConfigError: the disk takes no more; then all files are as before."""
        path = part(self._path, self._parts)
        following = McapFile(path, self._metadata | {"part": str(self._parts)}, self._compression)
        try:
            self._file.close({"dropped": str(self._lost)})
        except OSError:
            following.discard()
            raise
        self._file, self._parts, self._began = following, self._parts + 1, None


def _words(error: Exception) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)
