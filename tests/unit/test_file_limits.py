"""Files of others: a pipe, a device, a file that unpacks to gigabytes, or values of other types take one line each."""

from __future__ import annotations

import os
import socket
import struct
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.writer import MCAP0_MAGIC

from txt1.cli import execute
from txt1.config import load
from txt1.errors import ConfigError, Txt1Error
from txt1.experiments import recording as samples
from txt1.experiments import run_folder
from txt1.experiments.profile import load_profile
from txt1.file_limits import CHUNK_MAX, FileRefused, open_file, read_bytes, read_text
from txt1.fleet.plan import plan_of
from txt1.learning import qtable
from txt1.mapping import graph_file
from txt1.maps import files as maps
from txt1.record import reader
from txt1.record.reader import FilePass
from txt1.teaching import policy
from txt1.teaching.lessons import sha256_of

READERS: dict[str, Callable[[Path], object]] = {
    "config.yaml": lambda path: load(path),
    "map.yaml": lambda path: maps.read(str(path)),
    "fleet.yaml": lambda path: plan_of(str(path)),
    "profile.yaml": lambda path: load_profile(str(path)),
    "qtable.json": qtable.load,
    "policy.onnx": policy.load,
    "map.graph": graph_file.load,
    "run.mcap": lambda path: list(FilePass(path).records()),
    "lesson.mcap": sha256_of,
    "run": run_folder.read,
    "samples": samples.load,
}
WITHIN = {"run": run_folder.METRICS, "samples": samples.FILE}
"""The name of the file that is read in a folder."""


def pipe(path: Path) -> None:
    os.mkfifo(path)


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def folder(path: Path) -> None:
    path.mkdir()


def listener(path: Path) -> None:
    os.chdir(path.parent)  # the name of a socket is short
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(path.name)


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("make", [pipe, device, folder, listener])
def test_what_is_no_file_is_told_at_once_by_its_name(
    name: str, make: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "config.yaml" and make is pipe:
        pytest.skip("a configuration may come from a pipe")
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name
    if name in WITHIN:
        path.mkdir()
    make(path / WITHIN.get(name, ""))
    with pytest.raises(Txt1Error) as told:
        READERS[name](path)
    assert str(path) in str(told.value) and "\n" not in str(told.value)


@pytest.mark.parametrize("make", [pipe, device])
def test_a_map_whose_picture_is_no_file_is_told(make: Callable[[Path], None], tmp_path: Path) -> None:
    make(tmp_path / "floor.pgm")
    (tmp_path / "floor.yaml").write_text("image: floor.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with pytest.raises(ConfigError, match=r"floor\.pgm: cannot read the map: it is a (pipe|device), not a file"):
        maps.read(str(tmp_path / "floor.yaml"))


def test_a_configuration_may_come_from_a_pipe() -> None:
    end, other = os.pipe()
    os.write(other, b"seed: 7\n")
    os.close(other)
    assert load(Path(f"/dev/fd/{end}")).config.seed == 7
    os.close(end)


def test_a_file_that_is_larger_than_its_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(bytes(1001))
    with pytest.raises(FileRefused, match="at most 1000 are read"):
        read_bytes(tmp_path / "large", 1000)
    assert len(read_text(tmp_path / "large", 1001)) == 1001
    with open_file(tmp_path / "large") as file:
        assert len(file.read()) == 1001


# -- recordings --------------------------------------------------------------------------------------------------


@cache
def packed_zeros(size: int) -> bytes:
    """So many zeros as zstandard packs them, without ever having them all."""
    packing, piece = zstandard.ZstdCompressor(level=1).compressobj(size=size), bytes(1 << 24)
    whole, rest = divmod(size, len(piece))
    return b"".join([*(packing.compress(piece) for _ in range(whole)), packing.compress(bytes(rest)), packing.flush()])


def recording(path: Path, *chunks: tuple[int, bytes]) -> Path:
    """A recording of chunks, each with the size that it says to unpack to."""
    builder = RecordBuilder()
    mcap.Header("ros2", "by hand").write(builder)
    for size, data in chunks:
        mcap.Chunk(
            compression="zstd",
            data=data,
            message_start_time=0,
            message_end_time=0,
            uncompressed_crc=0,
            uncompressed_size=size,
        ).write(builder)
    mcap.DataEnd(0).write(builder)
    path.write_bytes(MCAP0_MAGIC + builder.end() + MCAP0_MAGIC)  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize("words", [["info"], ["cat"], ["recover", "-o", "out.mcap"]])
def test_a_small_recording_that_unpacks_to_gigabytes_takes_a_line(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = recording(tmp_path / "bomb.mcap", (3_000_000_000, packed_zeros(3_000_000_000)))
    assert path.stat().st_size < 1_000_000
    began = process_time()
    assert execute(["log", words[0], str(path), *words[1:]]) not in (0, None)
    told = capsys.readouterr().err
    assert "bomb.mcap: a small file that unpacks to 3000 MB or more is no recording" in told
    assert process_time() - began < 5.0, "nothing was unpacked"
    assert not (tmp_path / "out.mcap").exists()


def test_many_small_chunks_may_not_unpack_to_more_either(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "UNPACKED_MAX", 1_000_000)
    size = 500_000
    path = recording(tmp_path / "bomb.mcap", *[(size, packed_zeros(size))] * 40)
    assert size < CHUNK_MAX
    with pytest.raises(Txt1Error, match=r"bomb\.mcap: a small file that unpacks to"):
        list(FilePass(path).records())


def test_a_chunk_that_lies_about_its_size_is_left_out(tmp_path: Path) -> None:
    lying = FilePass(recording(tmp_path / "run.mcap", (2000, packed_zeros(1000))))
    assert [type(each).__name__ for each in lying.records()] == ["Header"]
    assert lying.damaged == 1


# -- maps --------------------------------------------------------------------------------------------------------


def yaml_of(tmp_path: Path, **fields: str) -> str:
    given = {"image": "floor.png", "resolution": "0.05", "origin": "[0, 0, 0]"} | fields
    file = tmp_path / "floor.yaml"
    file.write_text("".join(f"{name}: {value}\n" for name, value in given.items()))
    return str(file)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("image", '"floor\\0.png"'),
        ("resolution", "9" * 400),
        ("resolution", "!!timestamp 2026-11-29"),
        ("resolution", "!!timestamp x"),
        ("origin", f"[0, {'9' * 400}, 0]"),
        ("free_thresh", "9" * 400),
        ("negate", "!!timestamp 2026-11-29"),
        ("mode", "!!binary x"),
    ],
)
def test_odd_values_of_a_map_are_told_with_its_name(field: str, value: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"floor\.yaml") as told:
        maps.read(yaml_of(tmp_path, **{field: value}))
    assert field in str(told.value) or "not valid YAML" in str(told.value)


def png(*pieces: tuple[bytes, bytes]) -> bytes:
    head = (b"IHDR", struct.pack(">II", 10, 10) + bytes((8, 0, 0, 0, 0)))
    parts = (head, *pieces, (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    )


def test_a_png_of_millions_of_pieces_is_refused(tmp_path: Path) -> None:
    data = zlib.compress(bytes(11 * 10))
    pieces = [(b"IDAT", data[k : k + 1]) for k in range(len(data))]
    (tmp_path / "floor.png").write_bytes(png(*pieces))
    assert maps.read(yaml_of(tmp_path, negate="1")).grid.cells.shape == (10, 10), "some pieces are no fault"
    (tmp_path / "floor.png").write_bytes(png(*pieces, *[(b"IDAT", b"")] * 200_000))
    with pytest.raises(ConfigError, match=r"floor\.png: a PNG of more than 100000 pieces"):
        maps.read(yaml_of(tmp_path))


def test_a_plain_pgm_with_text_behind_its_pixels_takes_no_object_for_each_number(tmp_path: Path) -> None:
    (tmp_path / "floor.pgm").write_bytes(b"P2\n2 2\n255\n" + b"254 " * 5_000_000)
    began = process_time()
    assert maps.read(yaml_of(tmp_path, image="floor.pgm")).grid.cells.shape == (2, 2)
    read = process_time() - began
    began = process_time()
    (tmp_path / "floor.pgm").read_bytes().split()
    assert read < 0.5 * (process_time() - began)


def graph(tmp_path: Path, **parts: Any) -> Path:
    told = np.frombuffer(b'{"version": 1}', np.uint8)
    given = {name: np.zeros((2, *shape), kind) for name, (kind, shape) in graph_file.PARTS.items()} | {"about": told}
    with (tmp_path / "floor.graph").open("wb") as file:
        np.savez(file, **(given | parts))
    return tmp_path / "floor.graph"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("poses", np.zeros((2, 3), "datetime64[s]")),
        ("counts", np.array([1e300, 1e300])),
        ("counts", np.array([-1, 1])),
        ("points", np.zeros((2, 3))),
        ("first", np.array(["a", "b"])),
        ("second", np.array([-1, -1])),
        ("about", np.frombuffer(b"[" * 100_000, np.uint8)),
        ("times", np.zeros((), float)),
    ],
)
def test_a_graph_with_values_of_another_type_is_told_with_its_name(name: str, value: Any, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"floor\.graph: no graph of a map, or a damaged one"):
        graph_file.load(graph(tmp_path, **{name: value}))
