"""A map's files, as of map_server: a .yaml, which defines how to read the picture, and a .pgm or .png.

The fields are those of ROS (https://docs.nav2.org/configuration/packages/configuring-map-server.html): image,
resolution, origin, negate, occupied_thresh, free_thresh, mode. A pixel p of 0 to 255 is occupied with probability (255
- p) / 255, or p / 255 if negate is 1. Above occupied_thresh it is a wall, below free_thresh it is free, else unknown.
"""

import re
import reprlib as short
import struct
import zlib
from collections.abc import Iterator
from functools import lru_cache
from hashlib import sha256
from itertools import islice
from math import inf
from os import fstat
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeGuard
from warnings import catch_warnings

import numpy as np
import yaml
from numpy.typing import NDArray

from txt1.errors import ConfigError, MissingExtra
from txt1.file_limits import PICTURE_MAX, PNG_PIECES_MAX, open_file, read_bytes, read_text
from txt1.maps.grid import FREE, OCCUPIED, OCCUPIED_FROM, UNKNOWN, Grid
from txt1.resources import resource
from txt1.safe_yaml import read_yaml

MAPS: Final = "config/maps"
# cells; 200 m x 200 m at 5 cm: their distances take some seconds
CELLS_MAX: Final = 16_000_000
# bytes of a picture that contain its size
HEAD: Final = 1000
PICTURES: Final = (".pgm", ".png")
KEYS: Final = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
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
    picture = file.parent / fields["image"]
    data = _bytes_of(picture)
    # kept, so that the robots of a team and all sensors share the arrays
    return Map(name, file, *_read(file, text, picture, data))


@lru_cache(maxsize=4)
def _read(file: Path, text: str, picture: Path, data: bytes) -> tuple[Grid, str]:
    fields = _fields(file, text)
    pixels, full = _png(picture, data) if data.startswith(_PNG) else _pgm(picture, data)
    share = pixels / full
    occupied = share if fields["negate"] else 1.0 - share
    free = occupied < fields["free_thresh"]
    cells = np.where(free, FREE, np.where(occupied > fields["occupied_thresh"], OCCUPIED, UNKNOWN)).astype(np.int8)
    if not free.any():
        what = "unknown everywhere" if (cells == UNKNOWN).all() else "nowhere free"
        raise ConfigError(
            f"{file}: free_thresh: {fields['free_thresh']:g}: with it the map is {what}; raise it, or is negate wrong?"
        )
    cells = np.ascontiguousarray(cells[::-1])
    grid = Grid(cells, fields["resolution"], fields["origin"])
    told = repr((cells.shape, grid.resolution, grid.origin)).encode()
    return grid, sha256(told + cells.tobytes()).hexdigest()


def _bytes_of(file: Path) -> bytes:
    """Return the content of a picture's file."""
    try:
        with open_file(file) as opened:
            size = fstat(opened.fileno()).st_size
            header = _HEADER.match(opened.read(HEAD)) if size > PICTURE_MAX else None
        if header is not None:
            _check_size(file, int(header[2]), int(header[3]))
        if size > PICTURE_MAX:
            raise ConfigError(
                f"{file}: {size} bytes; a map's picture has at most {PICTURE_MAX}: cut it out, or make it coarser"
            )
        return read_bytes(file, PICTURE_MAX)
    except OSError as error:
        raise ConfigError(f"{file}: cannot read the map: {error.strerror}; put the file there") from None


def _fields(file: Path, text: str) -> dict[str, Any]:
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

    image, negate, mode = tree.get("image"), tree.get("negate", 0), tree.get("mode", "trinary")
    if not isinstance(image, str) or not image or "\0" in image:
        raise wrong("image", "the file of the picture, a .pgm or .png")
    resolution = tree.get("resolution")
    if not _is_number(resolution) or not 0.001 <= resolution <= 1.0:
        raise wrong("resolution", "the side of a pixel in m, 0.001 to 1")
    origin = tree.get("origin")
    if (
        not isinstance(origin, list)
        or len(origin) != 3
        or not all(_is_number(each) and abs(each) < 1e6 for each in origin)
    ):
        raise wrong("origin", "x and y in m and yaw in rad of the lower left pixel, [0, 0, 0] for none")
    if negate not in (0, 1, False, True):
        raise wrong("negate", "0: white is free; 1: black is free")
    if mode not in ("trinary", "scale"):
        raise wrong("mode", "trinary or scale; in a raw map it is unknown which values are walls")
    shares = {}
    for field, usual in (("free_thresh", FREE_BELOW), ("occupied_thresh", OCCUPIED_ABOVE)):
        shares[field] = tree.get(field, usual)
        if not _is_number(shares[field]) or not 0.0 < shares[field] <= 1.0:
            raise wrong(field, "a share, more than 0 and at most 1")
    if shares["free_thresh"] > shares["occupied_thresh"]:
        raise wrong("free_thresh", f"at most occupied_thresh, {shares['occupied_thresh']:g}")
    return {
        "image": image,
        "resolution": float(resolution),
        "origin": tuple(map(float, origin)),
        "negate": bool(negate),
        **shares,
    }


def _is_number(value: Any) -> TypeGuard[float]:
    # an integer may have more digits than a float can have
    return isinstance(value, int | float) and not isinstance(value, bool) and -inf < value < inf


def _check_size(file: Path, width: int, height: int) -> None:
    if width * height > CELLS_MAX:
        raise ConfigError(
            f"{file}: {width} x {height} pixels; a map has at most {CELLS_MAX // 1_000_000} million: cut it out, or "
            "make its resolution coarser"
        )
    if min(width, height) < 1:
        raise ConfigError(f"{file}: {width} x {height} pixels; a map has some: draw it again")


_PNG: Final = b"\x89PNG\r\n\x1a\n"
# head of a PNG: eight bits, grey, not interlaced
_GREY: Final = bytes((8, 0, 0, 0, 0))
# separates the numbers in a PGM's head; a comment goes to the end of its line
_GAP: Final = rb"(?:\s|#[^\n]*\n)+"
_HEADER: Final = re.compile(rb"(P[25])" + 3 * (_GAP + rb"(\d{1,9})") + rb"\s")


def _pgm(file: Path, data: bytes) -> tuple[NDArray[np.uint16], int]:
    """Return the grey pixels of a PGM (netpbm), and the value of white."""
    header = _HEADER.match(data)
    if header is None:
        raise ConfigError(f"{file}: neither a PGM nor a PNG: give a grey picture as map_saver writes it")
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
    return np.clip(pixels[: rows * columns].reshape(rows, columns), 0, full).astype(np.uint16), full


def write(grid: Grid, file: Path) -> None:
    """Write a grid as a map: the .yaml, and a .png of the same name; walls 0, unknown 205, free 254.

    The rows of the picture are not filtered, so `read` needs no library for it.
    """
    solid = grid.cells >= OCCUPIED_FROM
    pixels = np.where(solid, 0, np.where(grid.cells < FREE, 205, 254)).astype(np.uint8)[::-1]
    rows, columns = pixels.shape
    lines = np.hstack((np.zeros((rows, 1), np.uint8), pixels)).tobytes()
    chunks = ((b"IHDR", struct.pack(">II", columns, rows) + _GREY), (b"IDAT", zlib.compress(lines, 9)), (b"IEND", b""))
    picture = file.with_suffix(".png")
    picture.write_bytes(
        _PNG + b"".join(struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    )
    text = f"image: {picture.name}\nresolution: {grid.resolution:g}\norigin: {list(grid.origin)}\n"
    file.write_text(f"{text}negate: 0\noccupied_thresh: {OCCUPIED_ABOVE}\nfree_thresh: {FREE_BELOW}\n")


def _plain_png(data: bytes, rows: int, columns: int) -> NDArray[np.uint16] | None:
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
    return None if table[:, 0].any() else table[:, 1:].astype(np.uint16)


def _pieces(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the kind and the content of each piece of a PNG after its head."""
    at = 33
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        at += 12 + size


def _png(file: Path, data: bytes) -> tuple[NDArray[np.uint16], int]:
    """Return the grey pixels of a PNG, and the value of white."""
    # the size is in the head: a picture that is too large is not unpacked
    columns, rows = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    _check_size(file, columns, rows)
    if next(islice(_pieces(data), PNG_PIECES_MAX, None), None) is not None:
        raise ConfigError(f"{file}: a PNG of more than {PNG_PIECES_MAX} pieces; save it again")
    if (pixels := _plain_png(data, rows, columns)) is not None:
        return pixels, 255
    try:
        from PIL import Image
    except ImportError:
        raise MissingExtra(f"a map from a PNG, {file} (a .pgm needs nothing),", "camera") from None
    from io import BytesIO

    try:
        with Image.open(BytesIO(data), formats=["PNG"]) as picture:
            grey = np.asarray(picture.convert("L"))
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        raise ConfigError(f"{file}: cannot read the picture: {error}; save it again as a grey PNG or a PGM") from None
    return grey.astype(np.uint16), 255
