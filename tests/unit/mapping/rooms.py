"""A room of walls and boxes, scanned from anywhere, and a drive round it."""

import numpy as np

from txt1.maps.grid import FREE, OCCUPIED, Grid
from txt1.maps.rays import cast

BEAMS = np.radians(np.arange(-120.0, 120.0, 2.0))


def room(corridor: bool = False) -> Grid:
    """8 m x 6 m with boxes at 2.5 cm, its corner at (-4, -3); or a corridor of 40 m without features."""
    if corridor:
        cells = np.full((80, 1600), OCCUPIED, np.int8)
        cells[2:-2, 2:-2] = FREE
        return Grid(cells, 0.025, (-20.0, -1.0, 0.0))
    cells = np.full((240, 320), OCCUPIED, np.int8)
    cells[4:-4, 4:-4] = FREE
    for low, left, height, width in ((90, 120, 50, 70), (4, 4, 30, 60), (200, 250, 30, 40), (20, 290, 70, 26)):
        cells[low : low + height, left : left + width] = OCCUPIED
    return Grid(cells, 0.025, (-4.0, -3.0, 0.0))


def scan(grid: Grid, pose, rng, noise: float = 0.01, far: float = 5.6):
    """Points in m as seen from a pose, in the order of the beams."""
    x, y, theta = pose
    ranges = cast(grid, x, y, theta + BEAMS, far)
    good = np.isfinite(ranges)
    ranges = ranges[good] + noise * rng.standard_normal(good.sum())
    return np.column_stack((ranges * np.cos(BEAMS[good]), ranges * np.sin(BEAMS[good])))


def drive(laps: float = 2.0, step: float = 0.15):
    """Poses round the room's middle box, on an oval."""
    count = int(laps * 13.0 / step)
    way = np.linspace(0.0, laps * 2.0 * np.pi, count)
    x, y = 2.6 * np.cos(way), 1.9 * np.sin(way)
    theta = np.arctan2(1.9 * np.cos(way), -2.6 * np.sin(way))
    return np.column_stack((x, y, theta))
