"""The matcher's loops over points and cells, as numba compiles them.

Arrays of points are (n, 2) in m, of normals (n, 2) of length 1, or 0 where the surface is unknown. A normal points to
the laser that saw the surface, so the two sides of a wall are never confused.
"""

from __future__ import annotations

from math import cos, floor, sin, sqrt
from typing import Any

import numpy as np

MIDDLE_WIDENED = 2
WIDE = 8
"""Cells on the side of a block in the search."""


def thin(points: Any, gap: float, broken: float) -> Any:
    """Return points at least `gap` apart and their normals; the points are in the order of the beams from (0, 0).

    Neighbouring points are replaced by their mean. The normal is that of the line through up to five points in turn
    (total least squares); a surface ends where the next point is farther away than `broken` or 8 % of its range.
    """
    count = points.shape[0]
    thinned = np.empty((count, 2))
    kept = 0
    start = 0
    while start < count:
        end = start + 1
        x, y = points[start, 0], points[start, 1]
        while end < count:
            dx, dy = points[end, 0] - points[start, 0], points[end, 1] - points[start, 1]
            if dx * dx + dy * dy >= gap * gap:
                break
            x += points[end, 0]
            y += points[end, 1]
            end += 1
        thinned[kept, 0] = x / (end - start)
        thinned[kept, 1] = y / (end - start)
        kept += 1
        start = end
    normals = np.zeros((kept, 2))
    for i in range(kept):
        limit = max(broken, 0.08 * sqrt(thinned[i, 0] ** 2 + thinned[i, 1] ** 2))
        low, high = i, i
        while low > 0 and low > i - 2:
            dx, dy = thinned[low, 0] - thinned[low - 1, 0], thinned[low, 1] - thinned[low - 1, 1]
            if dx * dx + dy * dy > limit * limit:
                break
            low -= 1
        while high < kept - 1 and high < i + 2:
            dx, dy = thinned[high, 0] - thinned[high + 1, 0], thinned[high, 1] - thinned[high + 1, 1]
            if dx * dx + dy * dy > limit * limit:
                break
            high += 1
        used = high - low + 1
        if used < 3:
            continue
        mx, my = 0.0, 0.0
        for j in range(low, high + 1):
            mx += thinned[j, 0]
            my += thinned[j, 1]
        mx /= used
        my /= used
        xx, xy, yy = 0.0, 0.0, 0.0
        for j in range(low, high + 1):
            dx, dy = thinned[j, 0] - mx, thinned[j, 1] - my
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
        half = 0.5 * (xx - yy)
        root = sqrt(half * half + xy * xy)
        middle = 0.5 * (xx + yy)
        if middle - root > 0.1 * (middle + root):
            continue
        nx, ny = xy, middle - root - xx
        if nx * nx + ny * ny < 1e-18:
            nx, ny = middle - root - yy, xy
        length = sqrt(nx * nx + ny * ny)
        if length < 1e-12:
            continue
        if nx * thinned[i, 0] + ny * thinned[i, 1] > 0.0:
            length = -length
        normals[i, 0] = nx / length
        normals[i, 1] = ny / length
    return thinned[:kept].copy(), normals


def stamp(field: Any, points: Any, x0: float, y0: float, cell: float, table: Any) -> None:
    """Raise the field round each point to a bell's values.

    Args:
        field: uint8, (rows, columns).
        points: m. x0, y0, cell: corner and cell of the field.
        table: uint8, (n, n, w, w), from `bell`: the bell for each of n x n places of a point within its cell.

    """
    parts, reach = table.shape[0], table.shape[2] // 2
    rows, columns = field.shape
    for k in range(points.shape[0]):
        px, py = (points[k, 0] - x0) / cell, (points[k, 1] - y0) / cell
        column, row = floor(px), floor(py)
        if row < reach or column < reach or row >= rows - reach or column >= columns - reach:
            continue
        bell = table[int((py - row) * parts), int((px - column) * parts)]
        for i in range(2 * reach + 1):
            for j in range(2 * reach + 1):
                if bell[i, j] > field[row - reach + i, column - reach + j]:
                    field[row - reach + i, column - reach + j] = bell[i, j]


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
    """Return (score, dx in cells, dy in cells, number of the angle) of the pose at which the points lie highest
    on the field.

    The score is the mean of the field over the points, 1 at best, minus the costs of the distance from the middle:
    costs[0] a cell^2 and costs[1] an angle step^2. Branch and bound: `middle` and `coarse` hold the maxima of blocks of
    cells of `fine`. So no offset of a block is better than the block's value there (Olson 2009, Hess 2016).

    Args:
        fine: the field, uint8.
        middle: a cell for 2 x 2 cells: the maximum of `MIDDLE_WIDENED` + 2 cells a side, to the right and up.
        coarse: a cell for 4 x 4 cells: the maximum of `WIDE` + 4 cells a side.
        points: points relative to the centre of rotation. x0, y0: m from the centre of rotation to the field's corner,
            negative within.
        cell: m.
        angles: rad, the angles to try, around the middle angle.
        reach: offsets to try, cells to each side.
        costs: costs of a cell^2 and of an angle step^2.
        at_least: lower scores do not count; without a better score the number of the angle is -1.

    """
    count = points.shape[0]
    rows, columns = fine.shape
    total = angles.shape[0]
    xs, ys = np.empty((total, count), np.int32), np.empty((total, count), np.int32)
    for k in range(total):
        c, s = cos(angles[k]), sin(angles[k])
        for i in range(count):
            xs[k, i] = floor((c * points[i, 0] - s * points[i, 1] - x0) / cell)
            ys[k, i] = floor((s * points[i, 0] + c * points[i, 1] - y0) / cell)
    wide, narrow = WIDE, MIDDLE_WIDENED
    blocks = (2 * reach) // wide + 1
    bounds = np.empty(total * blocks * blocks)
    scale = 1.0 / (255.0 * count)
    n = 0
    for k in range(total):
        for by in range(blocks):
            oy = by * wide - reach
            for bx in range(blocks):
                ox = bx * wide - reach
                score = 0
                for i in range(count):
                    x, y = xs[k, i] + ox, ys[k, i] + oy
                    # a block may begin outside and reach inside: its corner is then moved to the edge
                    if x > -wide and y > -wide and x < columns and y < rows:
                        score += coarse[max(y, 0) >> 2, max(x, 0) >> 2]
                bounds[n] = score * scale - costs[1] * (k - total // 2) ** 2
                n += 1
    order = np.argsort(-bounds)
    best, found_x, found_y, found_k = at_least, 0, 0, -1
    for number in order:
        if bounds[number] <= best:
            break
        k = number // (blocks * blocks)
        by, bx = (number // blocks) % blocks, number % blocks
        turned = costs[1] * (k - total // 2) ** 2
        for my in range(0, wide, narrow):
            for mx in range(0, wide, narrow):
                ox, oy = bx * wide - reach + mx, by * wide - reach + my
                if ox > reach or oy > reach:
                    continue
                score = 0
                for i in range(count):
                    x, y = xs[k, i] + ox, ys[k, i] + oy
                    if x > -narrow and y > -narrow and x < columns and y < rows:
                        score += middle[max(y, 0) >> 1, max(x, 0) >> 1]
                if score * scale - turned <= best:
                    continue
                for fy in range(oy, min(oy + narrow, reach + 1)):
                    for fx in range(ox, min(ox + narrow, reach + 1)):
                        score = 0
                        for i in range(count):
                            x, y = xs[k, i] + fx, ys[k, i] + fy
                            if x >= 0 and y >= 0 and x < columns and y < rows:
                                score += fine[y, x]
                        value = score * scale - turned - costs[0] * (fx * fx + fy * fy)
                        if value > best:
                            best, found_x, found_y, found_k = value, fx, fy, k
    return best, found_x, found_y, found_k


def bounds_of(field: Any, blocks: Any, points: Any, cell: float, angles: Any, block: int, bounds: Any) -> None:
    """Write an upper bound of the score of each block of places at each angle: (angles, blocks).

    Args:
        field: maxima of `block` x `block` cells to the right and up, uint8, with `block` cells before the first.
        blocks: (n, 2), row and column of each block.
        points: (n, 2), m, in the frame of the pose. cell: m. angles: rad.
        bounds: written here.

    """
    rows, columns = field.shape
    count = points.shape[0]
    xs, ys = np.empty(count, np.int64), np.empty(count, np.int64)
    for k in range(angles.shape[0]):
        c, s = cos(angles[k]), sin(angles[k])
        for i in range(count):
            xs[i] = floor((c * points[i, 0] - s * points[i, 1]) / cell) + block
            ys[i] = floor((s * points[i, 0] + c * points[i, 1]) / cell) + block
        for n in range(blocks.shape[0]):
            row, column = blocks[n, 0] * block, blocks[n, 1] * block
            score = 0
            for i in range(count):
                x, y = xs[i] + column, ys[i] + row
                if 0 <= x < columns and 0 <= y < rows:
                    score += field[y, x]
            bounds[k, n] = score / (255.0 * count)


def refined(
    fields: Any,
    frees: Any,
    blocks: Any,
    order: Any,
    bounds: Any,
    points: Any,
    cell: float,
    angles: Any,
    tile: int,
    behind: float,
    most: int,
    best: Any,
    found: Any,
) -> tuple[int, int]:
    """Find the best place of each tile and sector of angles, by branch and bound.

    Return how many blocks are done, and how many bounds were computed.

    Args:
        fields: maxima of 1, 2, 4 and 8 cells, as for `bounds_of`, with 8 cells before the first.
        frees: whether blocks of as many cells have a place at which the laser may be, (rows, columns).
        blocks, bounds, points, cell, angles: as for `bounds_of`; `bounds` is flat.
        order: numbers of bounds, the best first.
        tile: side of a tile, cells.
        behind: a score lower than the best of all by this much does not count.
        most: number of bounds after which no other block is begun.
        best: (rows, columns, sectors) of scores, at first the least that counts; written here.
        found: (rows, columns, sectors, 3): row and column of the place, and the angle's number; written here.

    """
    count, total, sectors = points.shape[0], angles.shape[0], best.shape[2]
    stack, values = np.empty((64, 3), np.int64), np.empty(64)
    top, looked, done = best.max(), 0, 0
    for number in order:
        if looked > most:
            break
        done += 1
        if bounds[number] <= top - behind:
            return order.shape[0], looked
        k, n = number // blocks.shape[0], number % blocks.shape[0]
        sector = (k * sectors) // total
        c, s = cos(angles[k]), sin(angles[k])
        size = 1
        stack[0, 0], stack[0, 1], stack[0, 2], values[0] = 3, blocks[n, 0], blocks[n, 1], bounds[number]
        while size > 0:
            size -= 1
            level, row, column, value = stack[size, 0], stack[size, 1], stack[size, 2], values[size]
            side = 1 << level
            v, u = (row * side) // tile, (column * side) // tile
            if value <= best[v, u, sector] or value <= top - behind:
                continue
            if level == 0:
                best[v, u, sector] = value
                found[v, u, sector, 0], found[v, u, sector, 1], found[v, u, sector, 2] = row, column, k
                top = max(top, value)
                continue
            field, free = fields[level - 1], frees[level - 1]
            rows, columns = field.shape
            half = side // 2
            for part in range(4):
                below, beside = 2 * row + part // 2, 2 * column + part % 2
                if not free[below, beside]:
                    continue
                score = 0
                for i in range(count):
                    x = floor((c * points[i, 0] - s * points[i, 1]) / cell) + 8 + beside * half
                    y = floor((s * points[i, 0] + c * points[i, 1]) / cell) + 8 + below * half
                    if 0 <= x < columns and 0 <= y < rows:
                        score += field[y, x]
                looked += 1
                value = score / (255.0 * count)
                if value > best[v, u, sector] and value > top - behind:
                    stack[size, 0], stack[size, 1], stack[size, 2], values[size] = level - 1, below, beside, value
                    size += 1
    return done, looked


def listed(points: Any, x0: float, y0: float, cell: float, rows: int, columns: int) -> Any:
    """Return (first, following): the number of each cell's first point, and of the point after each point; -1: none."""
    first = np.full((rows, columns), -1, np.int32)
    following = np.full(points.shape[0], -1, np.int32)
    for k in range(points.shape[0]):
        column, row = floor((points[k, 0] - x0) / cell), floor((points[k, 1] - y0) / cell)
        if 0 <= row < rows and 0 <= column < columns:
            following[k] = first[row, column]
            first[row, column] = k
    return first, following


def pairs(
    x: float,
    y: float,
    theta: float,
    points: Any,
    normals: Any,
    there: Any,
    there_normals: Any,
    first: Any,
    following: Any,
    x0: float,
    y0: float,
    cell: float,
    near: float,
) -> Any:
    """Return the number of the map's point for each point at this pose, -1 for none.

    It is the nearest point of the map closer than `near` (at most `cell`), with a normal within 45 degrees.
    """
    rows, columns = first.shape
    c, s = cos(theta), sin(theta)
    found = np.full(points.shape[0], -1, np.int32)
    for i in range(points.shape[0]):
        px, py = x + c * points[i, 0] - s * points[i, 1], y + s * points[i, 0] + c * points[i, 1]
        nx, ny = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
        known = nx != 0.0 or ny != 0.0
        column, row = floor((px - x0) / cell), floor((py - y0) / cell)
        least = near * near
        for a in range(max(row - 1, 0), min(row + 2, rows)):
            for b in range(max(column - 1, 0), min(column + 2, columns)):
                k = first[a, b]
                while k >= 0:
                    dx, dy = there[k, 0] - px, there[k, 1] - py
                    square = dx * dx + dy * dy
                    if square < least:
                        alike = there_normals[k, 0] * nx + there_normals[k, 1] * ny
                        if (there_normals[k, 0] != 0.0 or there_normals[k, 1] != 0.0) and (not known or alike > 0.7):
                            least = square
                            found[i] = k
                    k = following[k]
    return found


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
    """Return (pose, information, share of points that fit, their rms): the points aligned with the map's lines.

    Gauss-Newton on the distances from the points to the lines through their partners on the map (Censi 2008). Each has
    Cauchy's weight 1 / (1 + (r / scale)^2). `prior` is the information of the centre: it holds the pose in a direction
    that the lines do not determine, as along a corridor. The returned information of x, y and theta is that of the
    lines alone, in 1 / m^2 for points of 1 m deviation.

    Args:
        start: x, y, theta (m, rad), where the search begins.
        centre: x, y, theta, the centre of the prior.
        prior: (3, 3), for points of 1 m deviation. points, normals: the cloud in the pose's frame. there,
        there_normals: points and normals of the map; `first` and `following` list them by cells, as from `listed`. x0,
            y0, cell: corner and side of these cells.
        near: largest distance of a pair in each round, m; at most `cell`.
        scale: scale of the weights, m.

    """
    pose = start.copy()
    information = np.zeros((3, 3))
    fit, rms = 0.0, 0.0
    for turn in range(near.shape[0]):
        belongs = pairs(
            pose[0], pose[1], pose[2], points, normals, there, there_normals, first, following, x0, y0, cell, near[turn]
        )
        for _ in range(2):
            c, s = cos(pose[2]), sin(pose[2])
            matrix, vector = np.zeros((3, 3)), np.zeros(3)
            fitting, squares = 0, 0.0
            for i in range(points.shape[0]):
                k = belongs[i]
                if k < 0:
                    continue
                rx, ry = c * points[i, 0] - s * points[i, 1], s * points[i, 0] + c * points[i, 1]
                nx, ny = there_normals[k, 0], there_normals[k, 1]
                r = nx * (pose[0] + rx - there[k, 0]) + ny * (pose[1] + ry - there[k, 1])
                turning = ny * rx - nx * ry
                w = 1.0 / (1.0 + (r / scale) ** 2)
                matrix[0, 0] += w * nx * nx
                matrix[0, 1] += w * nx * ny
                matrix[0, 2] += w * nx * turning
                matrix[1, 1] += w * ny * ny
                matrix[1, 2] += w * ny * turning
                matrix[2, 2] += w * turning * turning
                vector[0] += w * nx * r
                vector[1] += w * ny * r
                vector[2] += w * turning * r
                if abs(r) < 2.0 * scale:
                    fitting += 1
                    squares += r * r
            matrix[1, 0], matrix[2, 0], matrix[2, 1] = matrix[0, 1], matrix[0, 2], matrix[1, 2]
            information = matrix
            fit = fitting / points.shape[0]
            rms = sqrt(squares / fitting) if fitting else 0.0
            full = matrix + prior
            wanted = vector + prior @ (pose - centre)
            step = -np.linalg.solve(full, wanted)
            pose = pose + step
            if abs(step[0]) + abs(step[1]) + abs(step[2]) < 1e-5:
                break
    return pose, information, fit, rms


def carve(hits: Any, passes: Any, points: Any, x: float, y: float) -> None:
    """Count on a grid the cells that rays from (x, y) pass, and the cells in which they end; all in cells.

    A ray counts a cell once, from line to line of the grid (Amanatides and Woo 1987), up to the cell in which it ends.
    """
    rows, columns = hits.shape
    for k in range(points.shape[0]):
        column, row = floor(x), floor(y)
        last_column, last_row = floor(points[k, 0]), floor(points[k, 1])
        dx, dy = points[k, 0] - x, points[k, 1] - y
        right, up = 1 if dx > 0 else -1, 1 if dy > 0 else -1
        per_x, per_y = abs(1.0 / dx) if dx != 0.0 else 1e30, abs(1.0 / dy) if dy != 0.0 else 1e30
        next_x = ((column + 1 - x) if dx > 0 else (x - column)) * per_x
        next_y = ((row + 1 - y) if dy > 0 else (y - row)) * per_y
        for _ in range(abs(last_column - column) + abs(last_row - row)):
            if 0 <= row < rows and 0 <= column < columns:
                passes[row, column] += 1
            if next_x < next_y:
                next_x += per_x
                column += right
            else:
                next_y += per_y
                row += up
        if 0 <= last_row < rows and 0 <= last_column < columns:
            hits[last_row, last_column] += 1
