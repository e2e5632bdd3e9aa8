"""Draws the maps in config/maps: three rooms, a corridor, and seven tracks for cars of 1:10 with their centre lines.

    python -m rigs.maps [FOLDER]

Rooms are rectangles of floor with rectangles of furniture on it. A track is a closed uniform cubic B-spline around its
control points; the widths on either side change slowly along it. A centre line is a .csv without a head: x, y, width to
the right and width to the left (m) in each line, 0.2 m apart in the direction of driving. Every map's (0, 0, 0) is a
place to start from; on a track it lies on the straightest part of the centre line, which leads along x there.
"""

import sys
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from txt1.maps.files import MAPS, write
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from txt1.resources import resource

CELL: Final = 0.05  # m
WALL: Final = 3  # cells that a wall is thick
SPACING: Final = 0.2  # m between two points of a centre line
APART: Final = 0.3  # m at least between two parts of a track
SHARPEST: Final = 0.9  # m, least radius of a centre line: the car of 1:10 turns within 0.74 m

Box = tuple[float, float, float, float]  # from x, y to x, y; m


class Room(NamedTuple):
    """A floor and what stands on it."""

    floor: tuple[Box, ...]
    furniture: tuple[Box, ...] = ()


class Track(NamedTuple):
    """A closed course."""

    corners: tuple[tuple[float, float], ...]  # control points, m
    width: tuple[float, float] = (2.0, 2.6)  # least and greatest, m
    waves: int = 3  # how often it grows wide on a lap
    clockwise: bool = False  # driven the other way round than its points are given


ROOMS: Final = {
    "laboratory": Room(
        ((-2.0, -2.5, 6.0, 3.5),),
        (
            (-2.0, 2.7, 2.5, 3.5), (4.0, 2.7, 6.0, 3.5), (5.3, -2.5, 6.0, 1.0), (1.8, -0.9, 3.6, 0.3),
            (-2.0, -2.5, -1.1, -1.9),
        ),
    ),
    "flat": Room(
        (
            (-2.0, -2.5, 3.0, 2.0), (-2.0, 2.15, 3.0, 6.0), (3.15, -2.5, 7.5, 1.0), (3.15, 1.15, 4.65, 6.0),
            (4.8, 1.15, 9.0, 6.0),
            # doors
            (3.0, -0.6, 3.15, 0.4), (0.0, 2.0, 1.0, 2.15), (3.4, 1.0, 4.4, 1.15), (3.0, 3.6, 3.15, 4.6),
            (4.65, 4.2, 4.8, 5.2),
        ),
        (
            (-2.0, 0.9, -1.2, 2.0), (1.2, -2.5, 3.0, -1.8), (-2.0, 5.2, 0.0, 6.0), (6.6, -2.5, 7.5, -0.5),
            (5.6, 1.15, 7.6, 1.9), (8.2, 3.0, 9.0, 6.0),
        ),
    ),
    "hall": Room(
        ((-3.0, -5.0, 13.0, 7.0),),
        (
            *((x, y, x + 0.4, y + 0.4) for x in (1.0, 5.0, 9.0) for y in (-2.2, 3.2)),
            (-3.0, 6.2, 1.0, 7.0), (12.0, -5.0, 13.0, -2.0), (6.0, -5.0, 8.5, -4.4),
        ),
    ),
    "corridor": Room(
        (
            (-2.0, -1.0, 18.0, 1.0), (16.0, -1.0, 18.0, 11.0), (-2.0, 9.2, 18.0, 11.0), (-2.0, -1.0, -0.2, 11.0),
            # doors in their niches, and a place with a copier
            (3.0, 1.0, 4.0, 1.2), (6.5, 1.0, 7.5, 1.2), (11.0, 1.0, 12.0, 1.2), (5.0, -1.2, 6.0, -1.0),
            (13.0, -1.2, 14.0, -1.0), (15.8, 3.0, 16.0, 4.0), (18.0, 6.0, 18.2, 7.0), (4.0, 11.0, 5.0, 11.2),
            (9.0, 9.0, 10.0, 9.2), (7.0, 11.0, 9.5, 12.5), (-2.2, 4.0, -2.0, 5.0),
        ),
        ((8.0, 12.0, 9.0, 12.5), (12.5, 0.8, 13.0, 1.0)),
    ),
}  # fmt: skip

TRACKS: Final = {
    "oval": Track(
        ((0, 0), (6, 0), (11, 0), (13, 4), (11, 8), (6, 8), (0, 8), (-5, 8), (-7, 4), (-5, 0)),
        (2.4, 3.0), 2,
    ),
    "kidney": Track(
        ((0, 0), (7, 0), (13, -1), (16, 4), (13, 9), (7, 6.5), (1, 6), (-3, 11), (-9, 10), (-10, 4), (-6, 0)),
        (2.2, 2.9), clockwise=True,
    ),
    "hairpins": Track(
        (
            (0, 0), (8, 0), (15, 0), (19, 1), (19, 4.2), (15, 5.2), (8, 4.8), (2, 5), (-2, 6), (-2, 9.2), (2, 10),
            (8, 9.8), (14, 9.8), (18, 10.8), (18, 14), (14, 15), (6, 15), (-2, 15), (-8, 14), (-10, 7), (-7, 1),
        ),
        (2.0, 2.4), 4,
    ),
    "chicane": Track(
        (
            (0, 0), (6, 0), (12, 0), (14.5, 3.5), (17.5, 3.5), (19, -1), (22.5, -1.5), (26, 3), (24, 9), (18, 12),
            (15, 8), (11.5, 8), (9, 12.5), (4, 12), (-2, 10), (-7, 8), (-7, 2),
        ),
        (2.0, 2.8), 5, clockwise=True,
    ),
    "clover": Track(
        (
            (0, 0), (5, 0), (9, -4), (14, -3), (15, 3), (11, 6), (11, 10), (15, 13), (12, 18), (6, 17), (4, 12),
            (-1, 12), (-4, 16), (-10, 14), (-10, 8), (-5, 6), (-6, 1),
        ),
        (2.1, 2.7), 4, clockwise=True,
    ),
    "grand-prix": Track(
        (
            (0, 0), (8, 0), (16, 0), (24, 0), (29, 3), (27, 8), (21, 7), (17, 10), (21, 14), (27, 14), (30, 18),
            (26, 22), (18, 21), (12, 22), (8, 18), (11, 14), (8, 10), (3, 12), (1, 18), (-5, 21), (-10, 17),
            (-8, 11), (-11, 6), (-8, 1),
        ),
        (2.2, 3.0), 6,
    ),
    "kart": Track(
        (
            (0, 0), (2.5, 0), (5, 0), (7.5, 0), (10, 0), (10, 2.5), (10, 5), (12.5, 5), (15, 5), (15, 7.5), (15, 10),
            (12.5, 10), (10, 10), (7.5, 10), (7.5, 7.5), (7.5, 5), (5, 5), (5, 7.5), (5, 10), (2.5, 10), (0, 10),
            (0, 7.5), (0, 5), (-2.5, 5), (-5, 5), (-5.5, 2.5), (-5, 0), (-2.5, 0),
        ),
        (1.9, 2.2), 5,
    ),
}  # fmt: skip


def centre_line(track: Track) -> np.ndarray:
    """Return the centre line of a track (n, 4), which begins at (0, 0) along x."""
    from scipy.interpolate import BSpline  # takes 0.2 s, for each process that collects the tests

    corners = np.array(track.corners[:: -1 if track.clockwise else 1], float)
    wrapped = np.concatenate((corners, corners[:3]))
    curve = BSpline(np.arange(-3.0, len(corners) + 4.0), wrapped, 3)
    fine = curve(np.linspace(0.0, len(corners), 20_000, endpoint=False))
    steps = np.hypot(*np.diff(fine, axis=0, append=fine[:1]).T)
    length = steps.sum()
    count = round(length / SPACING)
    travelled = np.concatenate(([0.0], np.cumsum(steps)))
    at = np.arange(count) * length / count
    closed = np.concatenate((fine, fine[:1]))
    points = np.stack([np.interp(at, travelled, closed[:, k]) for k in (0, 1)], axis=1)
    heading = np.unwrap(np.arctan2(*np.roll(points, -1, axis=0).T[::-1] - np.roll(points, 1, axis=0).T[::-1]))
    bends = np.abs(np.angle(np.exp(1j * (np.roll(heading, -1) - np.roll(heading, 1))))) / (2.0 * length / count)
    assert bends.max() < 1.0 / SHARPEST, f"a radius of {1.0 / bends.max():.2f} m"
    # the middle of the straightest 5 m
    window = round(5.0 / SPACING)
    straight = np.convolve(np.concatenate((bends, bends[:window])), np.ones(window), "valid")[:count]
    first = (int(straight.argmin()) + window // 2) % count
    points, heading = np.roll(points, -first, axis=0) - points[first], np.roll(heading, -first)
    c, s = np.cos(heading[0]), np.sin(heading[0])
    points = points @ np.array([[c, -s], [s, c]])
    least, most = track.width
    phase = 2.0 * np.pi * track.waves * np.arange(count) / count
    # the sides grow wide at different places; together they stay within the widths
    sides = [0.25 * (least + most) + 0.25 * (most - least) * np.cos(phase + shift) for shift in (0.0, 1.0)]
    return np.column_stack((points, *sides))


def draw_track(line: np.ndarray) -> Grid:
    """Return the map of a centre line: the track between walls, the rest unknown."""
    across = line[:, 2:].max() + 0.5
    low, high = line[:, :2].min(axis=0) - across, line[:, :2].max(axis=0) + across
    low, (columns, rows) = CELL * np.floor(low / CELL), np.ceil((high - low) / CELL).astype(int)
    x, y = np.meshgrid(low[0] + CELL * (np.arange(columns) + 0.5), low[1] + CELL * (np.arange(rows) + 0.5))
    # each cell beside the nearest of many points between the given ones
    closed = np.concatenate((line, line[:1]))
    fine = np.column_stack(
        [np.interp(np.arange(0.0, len(line), 0.05), np.arange(len(closed)), each) for each in closed.T]
    )
    ahead = np.roll(fine[:, :2], -1, axis=0) - fine[:, :2]
    _, nearest = cKDTree(fine[:, :2]).query(np.column_stack((x.ravel(), y.ravel())))
    dx, dy = x.ravel() - fine[nearest, 0], y.ravel() - fine[nearest, 1]
    to_left = ahead[nearest, 0] * dy - ahead[nearest, 1] * dx > 0.0
    free = np.hypot(dx, dy) < np.where(to_left, fine[nearest, 3], fine[nearest, 2])
    return walled(free.reshape(rows, columns), (float(low[0]), float(low[1])))


def check_apart(line: np.ndarray) -> None:
    """Raise where two parts of a track come too near to one another."""
    count = len(line)
    gap = np.hypot(*(line[:, None, :2] - line[None, :, :2]).transpose(2, 0, 1))
    apart = np.abs(np.arange(count)[:, None] - np.arange(count)[None, :])
    apart = np.minimum(apart, count - apart) * SPACING
    wide = line[:, 2:].max(axis=1)
    too_near = (apart > 6.0) & (gap < wide[:, None] + wide[None, :] + APART)
    assert not too_near.any(), f"it meets itself at {line[np.argwhere(too_near)[0]][:, :2].tolist()}"


def draw_room(room: Room) -> Grid:
    """Return the map of a room: its floor between walls, the rest unknown."""
    boxes = np.array(room.floor)
    low, high = boxes[:, :2].min(axis=0) - 0.5, boxes[:, 2:].max(axis=0) + 0.5
    columns, rows = np.round((high - low) / CELL).astype(int)
    free = np.zeros((rows, columns), bool)
    for things, value in ((room.floor, True), (room.furniture, False)):
        for x0, y0, x1, y1 in things:
            i0, j0, i1, j1 = (round(v / CELL) for v in (x0 - low[0], y0 - low[1], x1 - low[0], y1 - low[1]))
            free[j0:j1, i0:i1] = value
    return walled(free, (float(low[0]), float(low[1])))


def walled(free: np.ndarray, low: tuple[float, float]) -> Grid:
    """Return a grid with walls around what is free."""
    near = binary_dilation(free, np.ones((3, 3), bool), WALL)
    cells = np.where(free, FREE, np.where(near, OCCUPIED, UNKNOWN)).astype(np.int8)
    return Grid(cells, CELL, (round(low[0], 6), round(low[1], 6), 0.0))


def draw(name: str, folder: Path) -> None:
    """Write the files of one of them."""
    if name in ROOMS:
        write(draw_room(ROOMS[name]), folder / f"{name}.yaml")
        return
    line = centre_line(TRACKS[name])
    check_apart(line)
    write(draw_track(line), folder / f"{name}.yaml")
    rows = (",".join(f"{value + 0.0:.3f}" for value in row) for row in line)
    (folder / f"{name}_centerline.csv").write_text("\n".join(rows) + "\n")


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else resource(MAPS)
    target.mkdir(parents=True, exist_ok=True)
    for each in (*ROOMS, *TRACKS):
        draw(each, target)
