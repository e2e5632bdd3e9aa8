"""What a file that somebody else made may take: its kind, its size, and the size that it unpacks to.

A name may stand for a pipe that nobody writes to, or for a device without end. A small file may unpack to gigabytes. So
every such file is opened here. A file that takes too much is refused by `FileRefused`. That is an OSError, so whoever
reads the file tells it as every other error of reading, with the file's name.
"""

import errno
import io
import os
import stat
from pathlib import Path
from typing import Final

YAML_MAX: Final = 1_000_000
"""Bytes of a configuration, a plan, a profile, a map's .yaml: a second of reading."""
JSON_MAX: Final = 64_000_000
"""Bytes of a Q-table, and of the results of an experiment."""
PICTURE_MAX: Final = 100_000_000
"""Bytes of a map's picture."""
PNG_PIECES_MAX: Final = 100_000
"""Pieces of a PNG; an ordinary program makes pieces of 8 kB or more."""
POLICY_MAX: Final = 16_000_000
"""Bytes of a policy."""
GRAPH_MAX: Final = 500_000_000
"""Bytes of a map's graph, which is not packed."""
CHUNK_MAX: Final = 256_000_000
"""Bytes that a recording's chunk unpacks to."""
UNPACKED_MAX: Final = 32_000_000
"""Bytes that any file may unpack to ..."""
UNPACKED_SHARE: Final = 1000
"""... and for each byte of the file, so many more: pictures of a dark room come near to it."""

_KINDS: Final = (
    (stat.S_ISDIR, "a directory"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


class FileRefused(OSError):
    """A file is none, or takes too much. `strerror` has the reason and the remedy."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(errno.EFBIG, reason, str(path))


def open_file(path: Path, most: int | None = None, pipes: bool = False) -> io.FileIO:
    """Open a file for reading, of at most `most` bytes; raises FileRefused for anything that is no regular file.

    It never waits, as an ordinary `open` does of a pipe that nobody writes to. With `pipes` a pipe is taken, too, and
    waited for: the user has named it, as the shell does for ``<(command)``.
    """
    wait = 0 if pipes else os.O_NONBLOCK
    opened = os.open(path, os.O_RDONLY | wait | os.O_CLOEXEC | os.O_NOCTTY)
    try:
        told = os.fstat(opened)
        for is_kind, kind in _KINDS:
            if is_kind(told.st_mode) and not (pipes and is_kind is stat.S_ISFIFO):
                raise FileRefused(path, f"it is {kind}, not a file")
        if most is not None and told.st_size > most:
            raise FileRefused(path, f"it has {told.st_size} bytes, and at most {most} are read")
        return io.FileIO(opened)
    except BaseException:
        os.close(opened)
        raise


def read_bytes(path: Path, most: int, pipes: bool = False) -> bytes:
    """Return the bytes of a file of at most `most` bytes; `pipes` as in `open_file`. Raises FileRefused."""
    with io.BufferedReader(open_file(path, most, pipes)) as file:
        # the size of a pipe is known at its end
        data = file.read(most + 1)
    if len(data) > most:
        raise FileRefused(path, f"at most {most} bytes are read")
    return data


def read_text(path: Path, most: int = YAML_MAX, pipes: bool = False) -> str:
    """Return the text of a file in UTF-8, its lines ended by newlines; raises FileRefused, UnicodeDecodeError."""
    return io.TextIOWrapper(io.BytesIO(read_bytes(path, most, pipes)), encoding="utf-8").read()
