"""The files of maps: what is read, and what is refused in a line that names file, field, value and remedy."""

import sys
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest

from txt1.errors import ConfigError, MissingExtra
from txt1.maps.files import read, write
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid

MAP = "image: floor.pgm\nresolution: 0.5\norigin: [-1.0, 2.0, 0.0]\n"


def written(folder: Path, text: str = MAP, pixels: bytes = b"P5\n# drawn\n3 2\n255\n\xfe\xfe\x00\xcd\xfe\xfe") -> str:
    (folder / "floor.yaml").write_text(dedent(text))
    (folder / "floor.pgm").write_bytes(pixels)
    return str(folder / "floor.yaml")


def test_a_map_is_read_as_map_server_reads_it(tmp_path: Path) -> None:
    found = read(written(tmp_path))
    assert found.grid.cells.tolist() == [[UNKNOWN, FREE, FREE], [FREE, FREE, OCCUPIED]]
    assert (found.grid.resolution, found.grid.origin) == (0.5, (-1.0, 2.0, 0.0))
    assert found.grid.is_free([-0.9, -0.1, 0.4, 9.0], [2.1, 2.1, 2.6, 2.1]).tolist() == [False, True, False, False]


@pytest.mark.parametrize(
    ("more", "pixels"),
    [
        ("", b"P2 3 2 255  254 254 0  205 254 254\n"),
        ("negate: 1\n", b"P5 3 2 255\n\x01\x01\xff\x32\x01\x01"),
        ("", b"P5 3 2 65535\n" + np.array([65000, 65000, 0, 52685, 65000, 65000], ">u2").tobytes()),
    ],
)
def test_other_ways_to_write_the_same_map(tmp_path: Path, more: str, pixels: bytes) -> None:
    (tmp_path / "other").mkdir()
    assert read(written(tmp_path / "other", MAP + more, pixels)).digest == read(written(tmp_path)).digest


def test_a_png_is_read_with_pillow_and_told_to_need_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image = pytest.importorskip("PIL.Image")
    image.fromarray(np.array([[254, 254, 0], [205, 254, 254]], np.uint8)).save(tmp_path / "floor.png")
    file = tmp_path / "other.yaml"
    file.write_text(MAP.replace("pgm", "png"))
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(MissingExtra, match=r"floor\.png \(a \.pgm needs nothing\), needs the extra 'camera': "):
        read(str(file))
    monkeypatch.undo()
    assert read(str(file)).digest == read(written(tmp_path)).digest


@pytest.mark.parametrize(
    ("text", "pixels", "told"),
    [
        (MAP.replace("resolution: 0.5\n", ""), b"", "floor.yaml: resolution: not there; give the side of a pixel in m"),
        (MAP.replace("0.5", ".nan"), b"", "floor.yaml: resolution: nan; give the side of a pixel in m, 0.001 to 1"),
        (MAP.replace("0.5", "fine"), b"", "floor.yaml: resolution: 'fine'; give"),
        (MAP.replace("floor.pgm", "''"), b"", "floor.yaml: image: ''; give the file of the picture"),
        (MAP.replace("floor.pgm", "gone.pgm"), b"", "gone.pgm: cannot read the map: No such file"),
        (MAP.replace("2.0, 0.0", "2.0"), b"", "floor.yaml: origin: [-1.0, 2.0]; give x and y in m and yaw in rad"),
        (MAP + "negate: maybe", b"", "floor.yaml: negate: 'maybe'; give 0: white is free"),
        (MAP + "mode: rough", b"", "floor.yaml: mode: 'rough'; give one of trinary, scale, raw"),
        (MAP.replace("0.5", "'0,5'"), b"", "floor.yaml: resolution: '0,5'; give"),
        (MAP.replace("0.5", "1" + 400 * "0"), b"", "floor.yaml: resolution: 1000"),
        (MAP + "free_thresh: 20", b"", "floor.yaml: free_thresh: 20; give a share"),
        (MAP + "keep_out: [[[0, 0], [1, 0]]]", b"", "floor.yaml: keep_out: [[[0, 0], [1, 0]]]; give areas"),
        (
            MAP + "keep_out: [[[0, 0], [1, 0], [.inf, 1]]]",
            b"",
            "floor.yaml: keep_out: [[[0, 0], [1, 0], [inf, 1]]]; give",
        ),
        (MAP + "keep_out: all", b"", "floor.yaml: keep_out: 'all'; give areas, each with 3 corners"),
        ("- 1", b"", "floor.yaml: no map: it has no lines"),
        ("a: [", b"", "floor.yaml: not valid YAML: "),
        (MAP, b"P6 1 1 255 abc", "floor.pgm: neither a PGM, a PNG nor a BMP"),
        (MAP, b"P5 10000 10000 255\n", "floor.pgm: 10000 x 10000 pixels; a map has at most 32 million: cut it out"),
        (MAP, b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x27\x10\0\0\x27\x10", "floor.pgm: 10000 x 10000 pixels; a map"),
        (MAP, b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1", "floor.pgm: cannot read the picture: "),
        (MAP, b"P5 0 3 255\n", "floor.pgm: 0 x 3 pixels; a map has some"),
        (MAP, b"P5 2 2 0\nabcd", "floor.pgm: white is 0; a PGM has 1 to 65535"),
        (MAP, b"P5 3 2 255\nabc", "floor.pgm: ends after 3 of 6 pixels: copy the whole file"),
        (MAP, b"P2 1 2 255\n1 x", "floor.pgm: a pixel is no number"),
        (MAP, b"P5 1 2 255\n\xcd\xcd", "floor.yaml: free_thresh: 0.196: with it the map is unknown everywhere"),
        (MAP, b"P5 1 2 255\n\0\0", "floor.yaml: free_thresh: 0.196: with it the map is nowhere free"),
    ],
)
def test_a_map_that_cannot_be_read_is_refused_in_one_line(tmp_path: Path, text: str, pixels: bytes, told: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read(written(tmp_path, text, pixels))
    assert told in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("head", "told"),
    [
        (b"P5\n10000 10000\n255\n", "floor.pgm: 10000 x 10000 pixels; a map has at most 32 million: cut it out, or"),
        (b"", "floor.pgm: 100000001 bytes; a map's picture has at most 100000000: cut it out, or make it coarser"),
    ],
)
def test_a_map_of_100_megabytes_is_refused_by_its_head(tmp_path: Path, head: bytes, told: str) -> None:
    file = written(tmp_path, MAP, head)
    with (tmp_path / "floor.pgm").open("r+b") as picture:
        picture.truncate(100_000_001)
    with pytest.raises(ConfigError) as refused:
        read(file)
    assert told in str(refused.value) and "\n" not in str(refused.value)


def test_a_map_that_is_not_there_is_told_with_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"there is no map 'cellar'; there are: .*; or give a \.yaml"):
        read("cellar")
    written(tmp_path)
    with pytest.raises(ConfigError, match=r"floor\.pgm is a picture: give the \.yaml beside it"):
        read(str(tmp_path / "floor.pgm"))


def test_a_map_that_is_written_is_read_again_without_pillow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    cells = np.random.default_rng(1).choice([FREE, OCCUPIED, UNKNOWN], (7, 5)).astype(np.int8)
    write(Grid(cells, 0.1, (-1.0, 2.0, 0.5)), tmp_path / "made.yaml")
    found = read(str(tmp_path / "made.yaml")).grid
    assert found.cells.tolist() == cells.tolist()
    assert (found.resolution, found.origin) == (0.1, (-1.0, 2.0, 0.5))
