"""The walls of a grid as closed lines, few enough to draw and send ten times a second.

A line follows the border between free and solid cells from corner to corner, with the free side on the left. If two
solid cells touch at a corner, it turns left, so lines never cross. Then each line is simplified (Douglas and Peucker,
1973): a corner is removed if the line without it stays within a tolerance. The tolerance doubles until few enough
corners are left.
"""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.maps.grid import Grid

# corners (x, y) in m; the last is joined to the first
Outline = tuple[tuple[float, float], ...]

# corners of all lines together
POINTS_MAX: Final = 500
# edges of cells that are followed; if there are more, blocks of 2 x 2 cells are merged
EDGES_MAX: Final = 200_000
TOLERANCE: Final = 0.5  # cells

Corners = NDArray[np.int64]


@lru_cache(maxsize=4)
def outlines(grid: Grid, points_max: int = POINTS_MAX) -> tuple[Outline, ...]:
    """Return the borders of the free floor, m in the room, with at most `points_max` corners together."""
    solid, size = grid.solid, 1
    while (starts := _edges(solid))[0].size > EDGES_MAX:
        rows, columns = (side + side % 2 for side in solid.shape)
        padded = np.ones((rows, columns), bool)
        padded[: solid.shape[0], : solid.shape[1]] = solid
        solid = np.asarray(padded.reshape(rows // 2, 2, columns // 2, 2).any(axis=(1, 3)))
        size *= 2
    loops = _loops(*starts, solid.shape[1] + 1)
    tolerance = TOLERANCE
    while True:
        loops = [line for loop in loops if len(line := _simplified(loop, tolerance)) > 2]
        if sum(map(len, loops)) <= points_max:
            break
        tolerance *= 2.0
    found = []
    for line in loops:
        x, y = grid.to_room(*(float(size) * line.T))
        found.append(tuple(zip(np.round(x, 3).tolist(), np.round(y, 3).tolist(), strict=True)))
    return tuple(found)


def _edges(solid: NDArray[np.bool_]) -> tuple[Corners, Corners]:
    """Return the start of each edge between a free and a solid cell (n, 2: column, row) and its direction, 0 to 3.

    East, north, west and south: the free cell lies to the left.
    """
    places, directions = [], []
    # cells to the left and right of a step in each direction, and the offset of the corner from the left cell
    for direction, (left, right, dx, dy) in enumerate(
        (
            (solid[1:], solid[:-1], 0, 1),
            (solid[:, :-1], solid[:, 1:], 1, 0),
            (solid[:-1], solid[1:], 1, 1),
            (solid[:, 1:], solid[:, :-1], 1, 1),
        )
    ):
        row, column = np.nonzero(~left & right)
        places.append(np.column_stack((column + dx, row + dy)))
        directions.append(np.full(len(row), direction))
    return np.concatenate(places), np.concatenate(directions)


def _loops(places: Corners, directions: Corners, width: int) -> list[Corners]:
    """Return the closed lines of the edges: only the corners at which they turn (n, 2: column, row)."""
    begins: dict[int, dict[int, None]] = {}
    for key, direction in zip((places[:, 1] * width + places[:, 0]).tolist(), directions.tolist(), strict=True):
        begins.setdefault(key, {})[direction] = None
    steps = (1, width, -1, -width)
    found = []
    while begins:
        first = key = next(iter(begins))
        direction = next(iter(begins[key]))
        corners: list[int] = []
        before = -1
        while True:
            # left first, then ahead, then right
            turns = [(direction + turn) % 4 for turn in (1, 0, 3)] if corners or before >= 0 else [direction]
            ways = begins.get(key, {})
            ahead = next((way for way in turns if way in ways), None)
            if ahead is None:
                break
            del ways[ahead]
            if not ways:
                del begins[key]
            if ahead != before:
                corners.append(key)
            before = direction = ahead
            key += steps[ahead]
        assert key == first
        points = np.array(corners)
        found.append(np.column_stack((points % width, points // width)))
    return found


def _simplified(loop: Corners, tolerance: float) -> Corners:
    """Return the corners that a closed line needs to stay within a tolerance, cells, of the original line."""
    # two corners stay: the first, and the farthest from it
    away = int(np.argmax(((loop - loop[0]) ** 2).sum(axis=1)))
    closed = np.concatenate((loop, loop[:1])).astype(float)
    kept = np.zeros(len(closed), bool)
    kept[[0, away, len(loop)]] = True
    pieces = [(0, away), (away, len(loop))]
    while pieces:
        begin, end = pieces.pop()
        if end - begin < 2:
            continue
        chord = closed[end] - closed[begin]
        between = closed[begin + 1 : end] - closed[begin]
        length = float(np.hypot(*chord))
        off = np.abs(chord[0] * between[:, 1] - chord[1] * between[:, 0]) / length if length else np.hypot(*between.T)
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            middle = begin + 1 + worst
            kept[middle] = True
            pieces += [(begin, middle), (middle, end)]
    return loop[kept[:-1]]
