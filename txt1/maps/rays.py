"""Rays against an occupancy grid: the distance to the first solid cell. Lasers, pictures and filters share this caster.

How it works. A ray goes from cell to cell. At each step it crosses the next vertical or horizontal line of the grid,
whichever is nearer. It ends at the line where a solid cell begins (Amanatides and Woo, Eurographics 1987). So a range
is exact for the grid in every direction. The grid's frame of solid cells ends every ray.

numba (extra `fast`) compiles this loop. Without it many rays advance together as arrays (`_together`): each ray first
leaps by the distance of the nearest solid cell, then steps from line to line as above. The ranges are the same, except
for rays that meet a corner; it takes several times as long.
"""

import warnings
from collections.abc import Callable
from functools import cache
from math import cos, floor, inf, sin
from typing import Any, Final

import numpy as np

from txt1.installing import installs
from txt1.maps.grid import REACH, Bools, Floats, Grid

# up to this number, rays are quicker singly than as arrays
SINGLY_MAX: Final = 8
# more than two half diagonals of a cell, cells
ACROSS: Final = 1.5


def cast(grid: Grid, x: Floats | float, y: Floats | float, angles: Floats | float, range_max: float = inf) -> Floats:
    """Return the distances, m, from places in the room along angles, rad, to the first solid cell; inf beyond
    `range_max`.

    x and y, m, and the angles are broadcast against each other; the result has their common shape. A ray that begins in
    a solid cell or off the map has length 0; a ray with a number that is not finite has length inf.
    """
    u, v = grid.to_cells(x, y)
    turned = np.asarray(angles, float) - grid.origin[2]
    u, v, turned = np.broadcast_arrays(u, v, turned)
    flat = tuple(np.ascontiguousarray(each, float).ravel() for each in (u, v, turned))
    lengths = _caster(flat[0].size)(grid, *flat, range_max / grid.resolution)
    found: Floats = lengths.reshape(u.shape) * grid.resolution
    return found


@cache
def prepare() -> bool:
    """Compile the caster, so that no ray waits for it; return whether that was possible, and warn once if not.

    It takes a second or two, once: the machine code is kept beside the source. Sensors that cast rays while a robot
    runs call it when they are made.
    """
    if _compiled() is None:
        # the warning is for the caller's caller
        warnings.warn(f"rays against a map take long without numba: {installs('fast')}", RuntimeWarning, stacklevel=3)
    return _compiled() is not None


def _trace(solid: Bools, u: Floats, v: Floats, angles: Floats, far: float, lengths: Floats) -> None:
    """Write the lengths of rays, cells. Plain loops, for numba."""
    rows, columns = solid.shape
    for k in range(len(u)):
        px, py, du, dv = u[k], v[k], cos(angles[k]), sin(angles[k])
        if not (abs(px) < 1e9 and abs(py) < 1e9 and abs(du) <= 1.0):
            lengths[k] = inf
            continue
        i, j = floor(px), floor(py)
        if i < 0 or j < 0 or i >= columns or j >= rows or solid[j, i]:
            lengths[k] = 0.0
            continue
        step_i, step_j = 1 if du > 0.0 else -1, 1 if dv > 0.0 else -1
        per_i, per_j = 1.0 / du if du else inf, 1.0 / dv if dv else inf
        edge_i, edge_j = (i + 1 if du > 0.0 else i) - px, (j + 1 if dv > 0.0 else j) - py
        next_i, next_j = edge_i * per_i if du else inf, edge_j * per_j if dv else inf
        per_i, per_j = abs(per_i), abs(per_j)
        t = 0.0
        while not solid[j, i] and t <= far:
            if next_i < next_j:
                t = next_i
                next_i += per_i
                i += step_i
            else:
                t = next_j
                next_j += per_j
                j += step_j
        lengths[k] = t if t <= far else inf


@cache
def _compiled() -> Callable[..., Any] | None:
    """Return `_trace` as machine code; None without numba."""
    try:
        from numba import njit
    except ImportError:
        return None
    line = "float64[::1]"
    signature = f"void(boolean[:, ::1], {line}, {line}, {line}, float64, {line})"
    made: Callable[..., Any]
    try:
        made = njit(signature, nogil=True, error_model="numpy", cache=True)(_trace)
    except RuntimeError:
        # no folder in which the machine code may be kept
        made = njit(signature, nogil=True, error_model="numpy")(_trace)
    return made


def _caster(count: int) -> Callable[..., Floats]:
    """Return the function that casts `count` rays."""
    trace = _compiled()
    if trace is None and count >= SINGLY_MAX:
        return _together
    return lambda grid, u, v, angles, far: _one_by_one(trace or _trace, grid, u, v, angles, far)


def _one_by_one(trace: Callable[..., Any], grid: Grid, u: Floats, v: Floats, angles: Floats, far: float) -> Floats:
    lengths = np.empty(len(u))
    trace(grid.solid, u, v, angles, far, lengths)
    return lengths


def _together(grid: Grid, u: Floats, v: Floats, angles: Floats, far: float) -> Floats:
    """Return the lengths of rays, cells, by leaps and steps of all rays together."""
    solid, clear = grid.solid.ravel(), grid.clear.ravel()
    rows, columns = grid.solid.shape
    i: Any
    j: Any
    lengths = np.full(len(u), inf)
    du, dv = np.cos(angles), np.sin(angles)
    finite = (np.abs(u) < 1e9) & (np.abs(v) < 1e9) & np.isfinite(du)
    i, j = (np.floor(np.where(finite, each, 0.0)).astype(np.int64) for each in (u, v))
    on_map = (i >= 0) & (j >= 0) & (i < columns) & (j < rows)
    cell = np.where(on_map, j * columns + i, 0)
    lengths[finite & (solid[cell] | ~on_map)] = 0.0
    left = np.flatnonzero(finite & on_map & ~solid[cell])
    i, j, px, py, du, dv = (each[left] for each in (i, j, u, v, du, dv))
    with np.errstate(divide="ignore"):
        per_i, per_j = 1.0 / du, 1.0 / dv
    step_i, step_j = np.where(du > 0.0, 1, -1), np.where(dv > 0.0, 1, -1)
    ahead_i, ahead_j = step_i > 0, step_j > 0
    t = np.zeros(len(left))
    while len(left):
        leap = clear[j * columns + i] - ACROSS
        leaps = leap > 1.0
        with np.errstate(invalid="ignore"):
            next_i, next_j = (i + ahead_i - px) * per_i, (j + ahead_j - py) * per_j
        next_i, next_j = np.where(du == 0.0, inf, next_i), np.where(dv == 0.0, inf, next_j)
        along = next_i < next_j
        t = np.where(leaps, t + leap, np.where(along, next_i, next_j))
        i = np.where(leaps, np.floor(px + t * du), i + step_i * along).astype(np.int64)
        j = np.where(leaps, np.floor(py + t * dv), j + step_j * ~along).astype(np.int64)
        hit = solid[j * columns + i]
        # a leap ends on free floor, so a hit is on the line crossed last
        lengths[left[hit]] = np.where(t[hit] <= far, t[hit], inf)
        on = ~hit & (t <= far)
        left, i, j, px, py, du, dv, per_i, per_j, step_i, step_j, ahead_i, ahead_j, t = (
            each[on] for each in (left, i, j, px, py, du, dv, per_i, per_j, step_i, step_j, ahead_i, ahead_j, t)
        )
    return lengths


assert REACH > ACROSS + 1.0
