"""The occupancy grid of a graph's scans, and its files: map_server's pair, and a drawing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import floor
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.mapping.matcher import Cloud, Kernels
from txt1.mapping.poses import placed
from txt1.maps.files import CELLS_MAX
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from txt1.maps.keep_out import Area

Array = NDArray[np.float64]

RESOLUTION: Final = 0.05
"""m."""
SOLID: Final = 0.4
"""Share of the rays through a cell that end in it, from which the cell is a wall; grazing rays pass walls, too."""
FLOOR_MARGIN: Final = 0.5
"""m round the floor that was seen."""
ROWS_AT_ONCE: Final = 256
"""Number of rows whose cells are decided at a time, which bounds the memory."""


def grid_of(clouds: Sequence[Cloud], poses: Array, loops: Kernels, resolution: float = RESOLUTION) -> Grid:
    """Return the floor as clouds saw it from these poses (m, rad): walls, free cells, and cells that no ray reached.

    A cell's side is `resolution` m; it is doubled until the grid has at most `CELLS_MAX` cells.
    """
    ends = [placed(pose, cloud.points) for cloud, pose in zip(clouds, poses, strict=True)]
    low = np.min([each.min(axis=0) for each in (*ends, poses[:, :2])], axis=0) - FLOOR_MARGIN
    high = np.max([each.max(axis=0) for each in (*ends, poses[:, :2])], axis=0) + FLOOR_MARGIN
    resolution = fitting(low, high, resolution)
    # whole cells from 0 on, so that a growing map keeps its cells
    left, bottom = (floor(each / resolution) for each in low)
    columns, rows = (floor(each / resolution) + 1 - first for each, first in zip(high, (left, bottom), strict=True))
    hits, passes = np.zeros((rows, columns), np.int32), np.zeros((rows, columns), np.int32)
    for end, pose in zip(ends, poses, strict=True):
        x, y = pose[0] / resolution - left, pose[1] / resolution - bottom
        loops.carve(hits, passes, end / resolution - (left, bottom), x, y)
    return Grid(occupancy(hits, passes), resolution, (left * resolution, bottom * resolution, 0.0))


def occupancy(hits: NDArray[np.int32], passes: NDArray[np.int32]) -> NDArray[np.int8]:
    """Return the cells of a grid, from the numbers of rays that end in each and that pass it."""
    cells = np.empty(hits.shape, np.int8)
    for first in range(0, len(hits), ROWS_AT_ONCE):
        some = slice(first, first + ROWS_AT_ONCE)
        seen = hits[some] + passes[some]
        solid = hits[some] >= SOLID * np.maximum(seen, 1)
        cells[some] = np.where(seen == 0, UNKNOWN, np.where(solid, OCCUPIED, FREE))
    return cells


def fitting(low: Array, high: Array, resolution: float) -> float:
    """Return a cell's side, m: `resolution`, doubled until a grid between two corners has at most `CELLS_MAX` cells."""
    while np.prod(np.floor(high / resolution) - np.floor(low / resolution) + 1.0) > CELLS_MAX:
        resolution *= 2.0
    return resolution


def coarser(resolution: float, asked: float) -> str:
    """Return in words that a map's cells are larger than asked for; empty if they are not."""
    if resolution <= asked:
        return ""
    return (
        f"the map's cells are {resolution:g} m, not {asked:g} m: at {asked:g} m it would have more than "
        f"{CELLS_MAX // 1_000_000} million"
    )


def picture(grid: Grid) -> bytes:
    """Return a grid as a PGM for map_server: walls 0, unknown 205, free 254, the last row first."""
    grey = np.where(grid.cells >= OCCUPIED // 2, 0, np.where(grid.cells < FREE, 205, 254)).astype(np.uint8)[::-1]
    rows, columns = grey.shape
    return f"P5\n{columns} {rows}\n255\n".encode() + grey.tobytes()


def description(grid: Grid, image: str, keep_out: tuple[Area, ...] = ()) -> str:
    """Return the text of a map's .yaml."""
    x, y, yaw = grid.origin
    areas = [[list(corner) for corner in area] for area in keep_out]
    return (
        f"image: {image}\nresolution: {grid.resolution:g}\norigin: [{x:.6g}, {y:.6g}, {yaw:g}]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n" + (f"keep_out: {areas}\n" if areas else "")
    )


def drawing(grid: Grid, ways: Iterable[tuple[str, Array]] = ()) -> str:
    """Return an SVG of a grid, with a rectangle for each run of walls in a row, and paths over it: (colour, poses)."""
    rows, columns = grid.cells.shape
    scale = 100.0 * grid.resolution
    x0, y0, _ = grid.origin
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {columns * scale:g} {rows * scale:g}">'
        f'<rect width="100%" height="100%" fill="#cdcdcd"/>'
    ]
    for colour, there in (("#fefefe", grid.cells == FREE), ("#101010", grid.cells >= OCCUPIED // 2)):
        path = []
        edges = np.diff(there.astype(np.int8), axis=1, prepend=0, append=0)
        for row in range(rows):
            begins, ends = np.flatnonzero(edges[row] == 1), np.flatnonzero(edges[row] == -1)
            top = (rows - 1 - row) * scale
            path += [
                f"M{b * scale:g} {top:g}h{(e - b) * scale:g}v{scale:g}h{(b - e) * scale:g}z"
                for b, e in zip(begins, ends, strict=True)
            ]
        parts.append(f'<path fill="{colour}" shape-rendering="crispEdges" d="{"".join(path)}"/>')
    for colour, poses in ways:
        points = " ".join(f"{(x - x0) * 100:.1f},{rows * scale - (y - y0) * 100:.1f}" for x, y in poses[:, :2])
        parts.append(f'<polyline fill="none" stroke="{colour}" stroke-width="4" points="{points}"/>')
    return "\n".join((*parts, "</svg>\n"))


def contents(
    grid: Grid, name: str, ways: Iterable[tuple[str, Array]] = (), keep_out: tuple[Area, ...] = ()
) -> dict[str, bytes]:
    """Return the contents of a map's files by suffix; the .yaml, which names the picture, is last."""
    return {
        ".pgm": picture(grid),
        ".svg": drawing(grid, ways).encode(),
        ".yaml": description(grid, f"{name}.pgm", keep_out).encode(),
    }


def save(grid: Grid, name: Path, ways: Iterable[tuple[str, Array]] = ()) -> list[Path]:
    """Write NAME.pgm, NAME.svg and NAME.yaml; each file is whole or the old one.

    Raises OSError: the disk is full, or the folder cannot be written; the old files stay.
    """
    files = {name.with_name(name.name + suffix): text for suffix, text in contents(grid, name.name, ways).items()}
    put(files)
    return list(files)


def put(files: Mapping[Path, bytes]) -> None:
    """Write files under temporary names, and rename them when all are complete.

    Raises OSError: a file cannot be written; all old files stay.
    """
    new = {file.with_name(file.name + ".new"): file for file in files}
    try:
        for (beside, _), content in zip(new.items(), files.values(), strict=True):
            beside.write_bytes(content)
        for beside, file in new.items():
            beside.replace(file)
    finally:
        for beside in new:
            beside.unlink(missing_ok=True)
