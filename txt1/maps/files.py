"""A map's files, as of map_server: a .yaml, which defines how to read the picture, and a .pgm, .png or .bmp.

The fields are those of ROS (https://docs.nav2.org/configuration/packages/configuring-map-server.html): image,
resolution, origin, negate, occupied_thresh, free_thresh, mode. The shade of a pixel is the mean of its colours, 0 for
black to 1 for white. It is occupied with probability 1 - shade, or shade if negate is 1.

====================  ================================================================================================
mode                  the cell of a pixel
====================  ================================================================================================
trinary, the default  above occupied_thresh a wall, else below free_thresh free, else unknown; transparency counts as
                      one more colour, as in nav2
scale                 the same, but in between a share of the way from free_thresh to occupied_thresh, in per cent; a
                      pixel that is not opaque is unknown
raw                   the pixel of 0 to 255 itself: 0 to 100 per cent, more is unknown
====================  ================================================================================================

One field is our own: keep_out, a list of polygons, each a list of at least three corners [x, y] in m, into which a
robot that drives in the map does not go. map_server ignores it.

The savers of maps write an unknown cell as grey 205, which is occupied with probability 0.196. From ROS 2 Galactic to
Humble they wrote free_thresh 0.25 beside it, by which map_server takes the cell for free. It is unknown here, as the
saver meant it.
"""

import os
import re
import reprlib as short
import struct
import zlib
from collections.abc import Iterator
from functools import lru_cache
from hashlib import sha256
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple
from warnings import catch_warnings

import numpy as np
import yaml
from numpy.typing import NDArray

from txt1.errors import ConfigError, MissingExtra
from txt1.file_limits import PICTURE_MAX, PNG_PIECES_MAX, open_file, read_bytes, read_text
from txt1.maps.grid import FREE, OCCUPIED, OCCUPIED_FROM, UNKNOWN, Grid
from txt1.maps.keep_out import Area
from txt1.resources import resource
from txt1.safe_yaml import read_yaml

MAPS: Final = "config/maps"
# cells; 280 m x 280 m at 5 cm: their distances take some seconds
CELLS_MAX: Final = 32_000_000
# bytes of a picture that contain its size
SIZE_BYTES: Final = 1000
PICTURES: Final = (".pgm", ".png", ".bmp")
MODES: Final = ("trinary", "scale", "raw")
# of a pixel of 0 to 255: how savers of maps write an unknown cell
UNKNOWN_GREY: Final = 205
# a number in quotes, or one that YAML 1.1 takes for a word, such as 5e-2; ROS's YAML takes it for a number
_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_TRUTHS: Final = {"0": 0, "1": 1, "false": 0, "true": 1, "no": 0, "yes": 1, "off": 0, "on": 1, "n": 0, "y": 1}
# map_server's default
FREE_BELOW: Final = 0.196
# map_server's default
OCCUPIED_ABOVE: Final = 0.65


class Map(NamedTuple):
    """A map as read from its files."""

    name: str
    """The name by which it was requested."""
    file: Path
    """Its .yaml file."""
    grid: Grid
    digest: str
    """SHA-256 of its cells, resolution and origin: equal for files of equal meaning."""
    remarks: tuple[str, ...] = ()
    """What was read otherwise than the letter of the .yaml says, a line each, with the remedy."""
    keep_out: tuple[Area, ...] = ()
    """The areas that a robot keeps out of."""


class _Fields(NamedTuple):
    """The checked fields of a .yaml."""

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    mode: str
    free_thresh: float
    occupied_thresh: float
    keep_out: tuple[Area, ...] = ()


class _Picture(NamedTuple):
    """The shades of a picture, (rows, columns), 0 for black to 1 for white; `alpha` likewise, 1 for opaque."""

    shade: NDArray[np.float64]
    alpha: NDArray[np.float64] | None = None


def names() -> list[str]:
    """Return the names of the maps that come with the package."""
    return sorted(path.stem for path in resource(MAPS).glob("*.yaml"))


def file_of(name: str) -> Path:
    """Return the .yaml of a map, given by the name of a map in the package or by its path; raises ConfigError
    if it is missing.
    """
    file = Path(name) if name.endswith((".yaml", ".yml")) else resource(MAPS) / f"{name}.yaml"
    if not file.is_file():
        picture = f"; {name} is a picture: give the .yaml beside it" if name.endswith(PICTURES) else ""
        raise ConfigError(f"there is no map '{name}'; there are: {', '.join(names())}; or give a .yaml{picture}")
    return file


def read(name: str) -> Map:
    """Return a map by its name or its .yaml.

    Raises ConfigError: a field or the picture is wrong; the message names file, field, value and remedy. Raises
    MissingExtra: a .png without pillow.
    """
    file = file_of(name)
    try:
        text = read_text(file)
    except OSError as error:
        raise ConfigError(f"{file}: cannot read the map: {error.strerror}; put the file there") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{file}: not a text file in UTF-8; see config/maps for maps") from None
    fields = _fields(file, text)
    picture, moved = _picture_of(file, fields.image)
    data = _bytes_of(picture)
    # kept, so that the robots of a team and all sensors share the arrays
    grid, digest, remarks = _read(file, text, picture, data)
    return Map(name, file, grid, digest, (*moved, *remarks), fields.keep_out)


def _picture_of(file: Path, image: str) -> tuple[Path, tuple[str, ...]]:
    """Return the file of a map's picture, and what to remark of it.

    A .yaml often names the place of the picture on the computer that made it.
    """
    named = file.parent / os.path.expanduser(image)
    beside = file.parent / named.name
    if named == beside or os.path.lexists(named) or not os.path.lexists(beside):
        return named, ()
    return beside, (f"{file}: image: {image} is not there, so {named.name} beside the .yaml is read",)


@lru_cache(maxsize=4)
def _read(file: Path, text: str, picture: Path, data: bytes) -> tuple[Grid, str, tuple[str, ...]]:
    fields = _fields(file, text)
    cells, remarks = _cells(file, fields, _pixels(picture, data))
    if not ((cells >= FREE) & (cells < OCCUPIED_FROM)).any():
        what = "unknown everywhere" if (cells == UNKNOWN).all() else "nowhere free"
        raise ConfigError(
            f"{file}: free_thresh: {fields.free_thresh:g}: with it the map is {what}; raise it, or is negate wrong?"
        )
    cells = np.ascontiguousarray(cells[::-1])
    grid = Grid(cells, fields.resolution, fields.origin)
    told = repr((cells.shape, grid.resolution, grid.origin)).encode()
    return grid, sha256(told + cells.tobytes()).hexdigest(), remarks


def _cells(file: Path, fields: _Fields, picture: _Picture) -> tuple[NDArray[np.int8], tuple[str, ...]]:
    """Return the cells of a picture, the top row first, and what to remark of them."""
    shade, alpha = picture
    free, occupied = fields.free_thresh, fields.occupied_thresh
    if fields.mode == "raw":
        value = np.rint(shade * 255.0)
        return np.where(value <= OCCUPIED, value, UNKNOWN).astype(np.int8), ()
    if alpha is not None and fields.mode == "trinary":
        shade = (3.0 * shade + alpha) / 4.0
    probability = shade if fields.negate else 1.0 - shade
    between = np.full(shade.shape, UNKNOWN, np.int8)
    if fields.mode == "scale" and occupied > free:
        share = np.clip((probability - free) / (occupied - free), 0.0, 1.0)
        between = np.rint(OCCUPIED * share).astype(np.int8)
    below = np.where(probability < free, FREE, between)
    cells = np.where(probability > occupied, OCCUPIED, below).astype(np.int8)
    remarks = []
    if free > occupied:
        remarks.append(
            f"{file}: free_thresh {free:g} is above occupied_thresh {occupied:g}: as in map_server, a cell above "
            "occupied_thresh is a wall and every other one is free"
        )
    if fields.mode == "scale" and alpha is not None:
        cells[alpha < 1.0] = UNKNOWN
    if fields.mode == "trinary" and alpha is None and not fields.negate and free > 1.0 - UNKNOWN_GREY / 255:
        meant = (cells == FREE) & (np.abs(255.0 * shade - UNKNOWN_GREY) < 0.01)
        if meant.any():
            cells[meant] = UNKNOWN
            remarks.append(
                f"{file}: grey {UNKNOWN_GREY} is unknown, {meant.mean():.0%} of the map, as its saver meant it, though "
                f"by free_thresh {free:g} it would be free; {FREE_BELOW:g} says the same everywhere"
            )
    return cells, tuple(remarks)


def _bytes_of(file: Path) -> bytes:
    """Return the content of a picture's file."""
    try:
        with open_file(file) as opened:
            size = os.fstat(opened.fileno()).st_size
            header = _HEADER.match(opened.read(SIZE_BYTES)) if size > PICTURE_MAX else None
        if header is not None:
            _check_size(file, int(header[2]), int(header[3]))
        if size > PICTURE_MAX:
            raise ConfigError(
                f"{file}: {size} bytes; a map's picture has at most {PICTURE_MAX}: cut it out, or make it coarser"
            )
        return read_bytes(file, PICTURE_MAX)
    except OSError as error:
        raise ConfigError(f"{file}: cannot read the map: {error.strerror}; put the file there") from None


def _fields(file: Path, text: str) -> _Fields:
    """Return the checked fields of a .yaml."""
    try:
        tree = read_yaml(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"{file}: not valid YAML: {str(error).splitlines()[0]}; see config/maps for maps") from None
    if not isinstance(tree, dict):
        raise ConfigError(f"{file}: no map: it has no lines 'image: FILE' and 'resolution: M'")

    def wrong(field: str, takes: str) -> ConfigError:
        given = f"{field}: {short.repr(tree[field])}" if field in tree else f"{field}: not there"
        return ConfigError(f"{file}: {given}; give {takes}")

    image, mode = tree.get("image"), tree.get("mode", MODES[0])
    if not isinstance(image, str) or not image or "\0" in image:
        raise wrong("image", "the file of the picture, a .pgm, .png or .bmp")
    resolution = _number(tree.get("resolution"))
    if resolution is None or not 0.001 <= resolution <= 1.0:
        raise wrong("resolution", "the side of a pixel in m, 0.001 to 1")
    given = tree.get("origin")
    origin = [number for each in given if (number := _number(each)) is not None] if isinstance(given, list) else []
    if not isinstance(given, list) or not len(given) == len(origin) == 3 or max(map(abs, origin)) >= 1e6:
        raise wrong("origin", "x and y in m and yaw in rad of the lower left pixel, [0, 0, 0] for none")
    negate = tree.get("negate", 0)
    if isinstance(negate, str):
        negate = _TRUTHS.get(negate.lower())
    if negate not in (0, 1):
        raise wrong("negate", "0: white is free; 1: black is free")
    if not isinstance(mode, str) or mode.lower() not in MODES:
        raise wrong("mode", f"one of {', '.join(MODES)}")
    shares = []
    for field, usual in (("free_thresh", FREE_BELOW), ("occupied_thresh", OCCUPIED_ABOVE)):
        share = _number(tree.get(field, usual))
        if share is None or not 0.0 <= share <= 1.0:
            raise wrong(field, "a share, 0 to 1")
        shares.append(share)
    areas = _areas(tree.get("keep_out", []))
    if areas is None:
        raise wrong("keep_out", "areas, each with 3 corners [x, y] in m or more: [[[1, 0], [2, 0], [2, 1]]]")
    x, y, yaw = origin
    free, occupied = shares
    return _Fields(image, resolution, (x, y, yaw), bool(negate), mode.lower(), free, occupied, areas)


def keep_out_of(file: Path) -> tuple[Area, ...]:
    """Return the areas to keep out of in a map's .yaml; none if there is no such file."""
    try:
        return _fields(file, read_text(file)).keep_out
    except (OSError, UnicodeDecodeError, ConfigError):
        return ()


def _areas(tree: Any) -> tuple[Area, ...] | None:
    """Return the areas of a field; None if it has another form."""
    if not isinstance(tree, list):
        return None
    found: list[Area] = []
    for area in tree:
        if not isinstance(area, list) or len(area) < 3:
            return None
        corners: list[tuple[float, float]] = []
        for corner in area:
            given = corner if isinstance(corner, list) else []
            numbers = [number for each in given if (number := _number(each)) is not None]
            if not len(given) == len(numbers) == 2 or max(map(abs, numbers)) >= 1e6:
                return None
            corners.append((numbers[0], numbers[1]))
        found.append(tuple(corners))
    return tuple(found)


def _number(value: Any) -> float | None:
    """Return a value of a .yaml as ROS's YAML reads it, also in quotes; None if it is no finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and not _NUMBER.fullmatch(value.strip()):
        return None
    try:
        number = float(value)
    except OverflowError:
        # an integer may have more digits than a float can have
        return None
    return number if isfinite(number) else None


def _check_size(file: Path, width: int, height: int) -> None:
    if width * height > CELLS_MAX:
        raise ConfigError(
            f"{file}: {width} x {height} pixels; a map has at most {CELLS_MAX // 1_000_000} million: cut it out, or "
            "make its resolution coarser"
        )
    if min(width, height) < 1:
        raise ConfigError(f"{file}: {width} x {height} pixels; a map has some: draw it again")


_PNG: Final = b"\x89PNG\r\n\x1a\n"
_BMP: Final = b"BM"
# head of a PNG: eight bits, grey, not interlaced
_GREY: Final = bytes((8, 0, 0, 0, 0))
# separates the numbers in a PGM's head; a comment goes to the end of its line
_GAP: Final = rb"(?:\s|#[^\n]*\n)+"
_HEADER: Final = re.compile(rb"(P[25])" + 3 * (_GAP + rb"(\d{1,9})") + rb"\s")


def _pixels(file: Path, data: bytes) -> _Picture:
    """Return the shades of a picture."""
    if data.startswith(_PNG):
        return _png(file, data)
    if data.startswith(_BMP):
        # the height is negative if the top row comes first
        _check_size(file, *(abs(int.from_bytes(data[at : at + 4], "little", signed=True)) for at in (18, 22)))
        return _unpacked(file, data, "BMP")
    return _pgm(file, data)


def _pgm(file: Path, data: bytes) -> _Picture:
    """Return the shades of a PGM (netpbm)."""
    header = _HEADER.match(data)
    if header is None:
        raise ConfigError(f"{file}: neither a PGM, a PNG nor a BMP: give a grey picture as map_saver writes it")
    kind, width, height, white = header.groups()
    columns, rows, full = int(width), int(height), int(white)
    _check_size(file, columns, rows)
    if not 0 < full < 65536:
        raise ConfigError(f"{file}: white is {full}; a PGM has 1 to 65535: write it again")
    rest = data[header.end() :]
    if kind == b"P2":
        numbers = re.sub(rb"#[^\n]*", b"", rest) if b"#" in rest else rest
        try:
            with catch_warnings(action="error"):
                # numpy reads the wanted pixels only, without an object for each
                pixels = np.fromstring(numbers, np.int64, rows * columns, sep=" ")
        except (ValueError, DeprecationWarning):
            raise ConfigError(f"{file}: a pixel is no number: write the picture again") from None
    else:
        wide = np.dtype(">u2" if full > 255 else "u1")
        pixels = np.frombuffer(rest[: len(rest) // wide.itemsize * wide.itemsize], wide).astype(np.int64)
    if len(pixels) < rows * columns:
        raise ConfigError(f"{file}: ends after {len(pixels)} of {rows * columns} pixels: copy the whole file")
    return _Picture(np.clip(pixels[: rows * columns].reshape(rows, columns), 0, full) / full)


def write(grid: Grid, file: Path) -> None:
    """Write a grid as a map: the .yaml, and a .png of the same name; walls 0, unknown 205, free 254.

    The rows of the picture are not filtered, so `read` needs no library for it.
    """
    solid = grid.cells >= OCCUPIED_FROM
    pixels = np.where(solid, 0, np.where(grid.cells < FREE, 205, 254)).astype(np.uint8)[::-1]
    picture = file.with_suffix(".png")
    picture.write_bytes(png(pixels))
    text = f"image: {picture.name}\nresolution: {grid.resolution:g}\norigin: {list(grid.origin)}\n"
    file.write_text(f"{text}negate: 0\noccupied_thresh: {OCCUPIED_ABOVE}\nfree_thresh: {FREE_BELOW}\n")


def png(pixels: NDArray[np.unsignedinteger[Any]]) -> bytes:
    """Return a grey picture of 8 or 16 bits, (rows, columns), as a PNG; its rows are not filtered."""
    rows, columns = pixels.shape
    wide = pixels.astype(f">u{pixels.itemsize}").view(np.uint8).reshape(rows, -1)
    lines = np.hstack((np.zeros((rows, 1), np.uint8), wide)).tobytes()
    head = struct.pack(">II", columns, rows) + bytes((8 * pixels.itemsize,)) + _GREY[1:]
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b""))
    return _PNG + b"".join(struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)


def _plain_png(data: bytes, rows: int, columns: int) -> NDArray[np.uint8] | None:
    """Return the pixels of a PNG as written by `write`; None for any other, or a damaged file."""
    if data[24:29] != _GREY:
        return None
    packed = b"".join(piece for kind, piece in _pieces(data) if kind == b"IDAT")
    try:
        lines = zlib.decompressobj().decompress(packed, rows * (columns + 1))
    except zlib.error:
        return None
    if len(lines) != rows * (columns + 1):
        return None
    table = np.frombuffer(lines, np.uint8).reshape(rows, columns + 1)
    return None if table[:, 0].any() else table[:, 1:]


def _pieces(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the kind and the content of each piece of a PNG after its head."""
    at = 33
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        at += 12 + size


def _png(file: Path, data: bytes) -> _Picture:
    """Return the shades of a PNG."""
    # the size is in the head: a picture that is too large is not unpacked
    columns, rows = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    _check_size(file, columns, rows)
    if next(islice(_pieces(data), PNG_PIECES_MAX, None), None) is not None:
        raise ConfigError(f"{file}: a PNG of more than {PNG_PIECES_MAX} pieces; save it again")
    if (pixels := _plain_png(data, rows, columns)) is not None:
        return _Picture(pixels / 255)
    return _unpacked(file, data, "PNG")


def _unpacked(file: Path, data: bytes, kind: str) -> _Picture:
    """Return the shades of a picture that Pillow unpacks; raises MissingExtra without it."""
    try:
        from PIL import Image
    except ImportError:
        raise MissingExtra(f"a map from a {kind}, {file} (a .pgm needs nothing),", "camera") from None
    from io import BytesIO

    try:
        # a picture that Pillow warns of is too large for a map
        with catch_warnings(action="ignore"), Image.open(BytesIO(data), formats=[kind]) as picture:
            _check_size(file, *picture.size)
            if picture.mode.startswith("I"):
                # grey of 16 bits
                return _Picture(np.asarray(picture).astype(np.float64) / 65535)
            opaque = picture.mode in ("1", "L", "P", "RGB") and "transparency" not in picture.info
            table = np.asarray(picture.convert("RGB" if opaque else "RGBA"))
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise ConfigError(f"{file}: cannot read the picture: {error}; save it again as a grey PNG or a PGM") from None
    shade = table[:, :, :3].sum(axis=2, dtype=np.uint16) / 765
    return _Picture(shade, None if opaque else table[:, :, 3] / 255)
