"""Tables of a recording's messages: CSV or Parquet, one for each topic.

A row is a message, a column is a number or a text, by its dotted path; `time` is the time stamp in s since 1970.

- Pictures of a CSV table are files in a folder beside it, and their cells have the names of these files. So are other
  fields of more than `BYTES_MAX` bytes. In Parquet all bytes stay in the table.
- Topics that only txt1's own replay and screens read, such as ``/reports``, are left out, unless they are asked for.
  So are topics whose contents other topics have, such as the places that a depth camera sees.

"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from txt1.errors import RecordingError
from txt1.maps.files import png
from txt1.record.reader import Decoding, Item, flat

# bytes of a field that stand in a cell of a CSV table, as hexadecimal digits
BYTES_MAX: Final = 64
# rows that are collected before they are written
ROWS_COLLECTED: Final = 2000
# encodings of sensor_msgs/Image that are written as PNG: type of a pixel, and channels
GREYS: Final = {"mono8": "u1", "8UC1": "u1", "mono16": "u2", "16UC1": "u2"}
SIGNATURES: Final = {b"\xff\xd8\xff": ".jpg", b"\x89PNG": ".png"}


class _Table(Protocol):
    """A table that is being written."""

    rows: int

    def add(self, item: Item, values: dict[str, Any]) -> None:
        """Add a message as a row."""


class _Csv:
    """A CSV file, and the folder of its pictures beside it."""

    def __init__(self, path: Path, files: ExitStack) -> None:
        self.rows = 0
        self._files = path.with_suffix("")
        self._file = files.enter_context(path.open("w", newline="", encoding="utf-8"))
        self._writer: csv.DictWriter[str] | None = None

    def add(self, item: Item, values: dict[str, Any]) -> None:
        """Add a message as a row."""
        cells = {"time": item.time} | {name: self._cell(item, name, value, values) for name, value in flat(values)}
        if self._writer is None:
            self._writer = csv.DictWriter(self._file, list(cells))
            self._writer.writeheader()
        self._writer.writerow(cells)
        self.rows += 1

    def _cell(self, item: Item, name: str, value: Any, values: dict[str, Any]) -> Any:
        if isinstance(value, list):
            return _numbers(value)
        if not isinstance(value, bytes):
            return value
        if len(value) <= BYTES_MAX:
            return value.hex(" ")
        data, suffix = _picture(item, value, values)
        which = "" if name == "data" else f"{name.replace('/', '_')}_"
        file = self._files / f"{which}{self.rows:06}{suffix}"
        self._files.mkdir(exist_ok=True)
        file.write_bytes(data)
        return f"{self._files.name}/{file.name}"


class _Parquet:
    """A Parquet file, written some rows at a time."""

    def __init__(self, path: Path, files: ExitStack) -> None:
        self.rows = 0
        self._path, self._files = path, files
        self._waiting: list[dict[str, Any]] = []
        self._writer: Any = None
        files.callback(self._write)

    def add(self, item: Item, values: dict[str, Any]) -> None:
        """Add a message as a row."""
        self._waiting.append({"time": item.time, **dict(flat(values))})
        self.rows += 1
        if len(self._waiting) == ROWS_COLLECTED:
            self._write()

    def _write(self) -> None:
        import pyarrow as pa
        from pyarrow.parquet import ParquetWriter

        rows, self._waiting = self._waiting, []
        if not rows:
            return
        try:
            if self._writer is None:
                table = pa.Table.from_pylist(rows)
                self._writer = ParquetWriter(self._path, table.schema)
                # closed after the last rows
                self._files.callback(self._writer.close)
                self._files.callback(self._write)
            self._writer.write_table(pa.Table.from_pylist(rows, schema=self._writer.schema))
        except (pa.ArrowException, ValueError) as error:
            why = " ".join(str(error).split())
            raise RecordingError(f"{self._path}: its messages are no table ({why}); write it as CSV") from None


TABLES: Final[dict[str, Callable[[Path, ExitStack], _Table]]] = {".csv": _Csv, ".parquet": _Parquet}
"""The kinds of tables, by the suffixes of their files."""


def export(items: Iterable[Item], place: Path, suffix: str = ".csv") -> dict[Path, int]:
    """Write a table for each topic, and return the number of rows of each file.

    A `place` with the suffix of a table is the file of the only topic; else it is a folder, where a table has the name
    of its topic. Raises RecordingError: a file cannot be written.
    """
    decoding = Decoding()
    single = place.suffix in TABLES
    tables: dict[str, _Table] = {}
    written: dict[Path, _Table] = {}
    try:
        (place.parent if single else place).mkdir(parents=True, exist_ok=True)
        with ExitStack() as files:
            for item in items:
                if item.topic not in tables:
                    path = place if single else place / f"{item.topic.strip('/').replace('/', '_')}{suffix}"
                    while path in written:
                        # of /a/b and /a_b
                        path = path.with_stem(f"{path.stem}_")
                    tables[item.topic] = written[path] = TABLES[path.suffix](path, files)
                tables[item.topic].add(item, decoding.values(item, as_bytes=True))
    except OSError as error:
        raise RecordingError(f"{error.filename or place}: cannot write it: {error.strerror}") from None
    return {path: table.rows for path, table in written.items()}


def without_own(items: Iterable[Item], asked: frozenset[str]) -> Iterator[Item]:
    """Yield the items but for those of txt1's own topics that are not asked for."""
    return (item for item in items if not item.own or item.topic in asked)


def without_derived(items: Iterable[Item], asked: frozenset[str]) -> Iterator[Item]:
    """Yield the items but for those whose contents other topics have, and that are not asked for."""
    return (item for item in items if not item.derived or item.topic in asked)


def _numbers(values: list[Any]) -> str:
    """Return a list as JSON; numbers of 32 bits with no more digits than they have."""
    if values and all(isinstance(each, float) for each in values):
        short = np.array(values, np.float64)
        with np.errstate(over="ignore"):
            single = short.astype(np.float32)
        if np.array_equal(single, short, equal_nan=True):
            # as JSON writes them, if not as short
            names = {"inf": "Infinity", "-inf": "-Infinity", "nan": "NaN"}
            return f"[{', '.join(names.get(text, text) for text in map(str, single))}]"
    return json.dumps(values, default=lambda data: data.hex(" "))


def _picture(item: Item, data: bytes, values: dict[str, Any]) -> tuple[bytes, str]:
    """Return the content and the suffix of the file of a field: a picture if it is one."""
    for begin, suffix in SIGNATURES.items():
        if data.startswith(begin):
            return data, suffix
    kind = GREYS.get(str(values.get("encoding")))
    if item.schema.name == "sensor_msgs/msg/Image" and kind is not None:
        order = ">" if values.get("is_bigendian") else "<"
        pixels = np.frombuffer(data, f"{order}{kind}")
        rows, columns = values.get("height", 0), values.get("width", 0)
        if len(pixels) == rows * columns > 0:
            return png(pixels.reshape(rows, columns)), ".png"
    return data, ".bin"
