"""The loops of `kernels` in NumPy and SciPy, for use without numba: slower, and not equal to the last bit.

`thin` and `carve` go over a single scan, so the same code runs uncompiled.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from txt1.mapping import kernels

thin, carve = kernels.thin, kernels.carve


def stamp(field: Any, points: Any, x0: float, y0: float, cell: float, table: Any) -> None:
    """Raise the field round each point to a bell's values; as `kernels.stamp`."""
    parts, width = table.shape[0], table.shape[2]
    reach = width // 2
    place = (points - (x0, y0)) / cell
    corner = np.floor(place).astype(np.int64)
    within = ((place - corner) * parts).astype(np.int64)
    inside = (
        (corner >= reach).all(axis=1)
        & (corner[:, 1] < field.shape[0] - reach)
        & (corner[:, 0] < field.shape[1] - reach)
    )
    corner, within = corner[inside], within[inside]
    for i in range(width):
        for j in range(width):
            np.maximum.at(
                field, (corner[:, 1] - reach + i, corner[:, 0] - reach + j), table[within[:, 1], within[:, 0], i, j]
            )


def search(
    fine: Any,
    middle: Any,
    coarse: Any,
    points: Any,
    x0: float,
    y0: float,
    cell: float,
    angles: Any,
    reach: int,
    costs: Any,
    at_least: float,
) -> Any:
    """Return (score, dx in cells, dy in cells, number of the angle); as `kernels.search`, without its middle field."""
    wide = kernels.WIDE
    rows, columns = fine.shape
    # with a row and a column of zeros, where all that lies outside is looked up
    fine, coarse = np.pad(fine, (0, 1)), np.pad(coarse, (0, 1))
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    xs = np.floor((cosine * points[:, 0] - sine * points[:, 1] - x0) / cell).astype(np.int64)
    ys = np.floor((sine * points[:, 0] + cosine * points[:, 1] - y0) / cell).astype(np.int64)
    blocks = np.arange((2 * reach) // wide + 1) * wide - reach
    turned = costs[1] * (np.arange(len(angles)) - len(angles) // 2) ** 2
    bounds = np.empty((len(angles), len(blocks), len(blocks)))
    for k in range(len(angles)):
        x, y = xs[k] + blocks[:, None], ys[k] + blocks[:, None]
        x = np.where((x > -wide) & (x < columns), np.maximum(x, 0) >> 2, coarse.shape[1] - 1)
        y = np.where((y > -wide) & (y < rows), np.maximum(y, 0) >> 2, coarse.shape[0] - 1)
        bounds[k] = _at(coarse, x, y).mean(axis=2) / 255.0 - turned[k]
    best, found = at_least, (0, 0, -1)
    for block in np.argsort(-bounds, axis=None, kind="stable"):
        k, by, bx = (int(each) for each in np.unravel_index(int(block), bounds.shape))
        if bounds[k, by, bx] <= best:
            break
        oy = np.arange(blocks[by], min(blocks[by] + wide, reach + 1))
        ox = np.arange(blocks[bx], min(blocks[bx] + wide, reach + 1))
        x, y = xs[k] + ox[:, None], ys[k] + oy[:, None]
        x = np.where((x >= 0) & (x < columns), x, columns)
        y = np.where((y >= 0) & (y < rows), y, rows)
        values = _at(fine, x, y).mean(axis=2) / 255.0
        values -= turned[k] + costs[0] * (oy[:, None] ** 2 + ox[None] ** 2)
        at = np.unravel_index(int(values.argmax()), values.shape)
        if values[at] > best:
            best, found = float(values[at]), (int(ox[at[1]]), int(oy[at[0]]), k)
    return best, *found


def _at(field: Any, x: Any, y: Any) -> Any:
    """Return the field's values, by rows of `y`, rows of `x` and points."""
    return field.ravel().take((y * field.shape[1])[:, None] + x[None])


def listed(points: Any, x0: float, y0: float, cell: float, rows: int, columns: int) -> Any:
    """Return a tree of the points, and nothing else; `align` takes both."""
    from scipy.spatial import cKDTree

    return cKDTree(points), None


def _pairs(pose: Any, points: Any, normals: Any, there_normals: Any, tree: Any, near: float) -> Any:
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    rotation = np.array([[cosine, sine], [-sine, cosine]])
    count = len(there_normals)
    distances, places = tree.query(points @ rotation + pose[:2], k=min(8, count), distance_upper_bound=near)
    distances, places = distances.reshape(len(points), -1), places.reshape(len(points), -1)
    turned = normals @ rotation
    own = np.vstack((there_normals, np.zeros(2)))[places]
    known = (normals != 0.0).any(axis=1)[:, None]
    fits = (own != 0.0).any(axis=2) & (~known | (np.einsum("nki,ni->nk", own, turned) > 0.7)) & (distances < np.inf)
    first = fits.argmax(axis=1)
    return np.where(fits.any(axis=1), places[np.arange(len(points)), first], -1)


def align(
    start: Any,
    centre: Any,
    prior: Any,
    points: Any,
    normals: Any,
    there: Any,
    there_normals: Any,
    first: Any,
    following: Any,
    x0: float,
    y0: float,
    cell: float,
    near: Any,
    scale: float,
) -> Any:
    """Return (pose, information, share of points that fit, rms of these); as `kernels.align`."""
    pose, information, fit, rms = start.copy(), np.zeros((3, 3)), 0.0, 0.0
    for distance in near:
        belongs = _pairs(pose, points, normals, there_normals, first, float(distance))
        used = belongs >= 0
        for _ in range(2):
            cosine, sine = np.cos(pose[2]), np.sin(pose[2])
            rotated = points[used] @ np.array([[cosine, sine], [-sine, cosine]])
            normal = there_normals[belongs[used]]
            r = np.einsum("ni,ni->n", normal, pose[:2] + rotated - there[belongs[used]])
            jacobian = np.column_stack((normal, normal[:, 1] * rotated[:, 0] - normal[:, 0] * rotated[:, 1]))
            weighted = jacobian / (1.0 + (r / scale) ** 2)[:, None]
            information = weighted.T @ jacobian
            fitting = np.abs(r) < 2.0 * scale
            fit = float(fitting.sum()) / len(points)
            rms = float(np.sqrt(np.mean(r[fitting] ** 2))) if fitting.any() else 0.0
            step = -np.linalg.solve(information + prior, weighted.T @ r + prior @ (pose - centre))
            pose = pose + step
            if np.abs(step).sum() < 1e-5:
                break
    return pose, information, fit, rms
