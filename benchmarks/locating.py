"""How quick locating is: 2500 particles, each with 61 rays, by numba and by NumPy, on one core.

    python -m benchmarks.locating [MAP.yaml] [--seconds 3]

A pass weighs all particles against one scan. They stand on free floor, with any heading; the ranges are those that a
laser of 10 m would measure from there, so no ray is cheap because its particle fits.
"""

import argparse
import sys
from math import pi
from time import process_time

import numpy as np

from txt1.mapping.locate import COUNT, RAYS, Locator
from txt1.maps import files
from txt1.maps.grid import FREE, OCCUPIED, Grid
from txt1.maps.rays import cast

AIM = 80.0  # passes a second
FAR = 10.0  # m


def room() -> Grid:
    """A hall of 20 m x 15 m with pillars, at 5 cm."""
    cells = np.full((300, 400), OCCUPIED, np.int8)
    cells[2:-2, 2:-2] = FREE
    for row in range(60, 300, 80):
        for column in range(50, 400, 90):
            cells[row : row + 12, column : column + 16] = OCCUPIED
    return Grid(cells, 0.05)


def rate(grid: Grid, form: str, seconds: float) -> float:
    """Return how many passes a second of processor time one core makes."""
    locator = Locator(grid, 1, form)
    rng = np.random.default_rng(1)
    free = np.argwhere(~grid.solid)
    chosen = free[rng.integers(0, len(free), COUNT)]
    x, y = grid.to_room(chosen[:, 1] + 0.5, chosen[:, 0] + 0.5)
    poses = np.column_stack((x, y, rng.uniform(-pi, pi, COUNT)))
    angles = np.linspace(-2.0, 2.0, RAYS)
    ranges = np.minimum(cast(grid, x[0], y[0], poses[0, 2] + angles), FAR)
    # compiled, and in the cache
    locator.weights(poses, ranges, angles)
    begin, passes = process_time(), 0
    while process_time() - begin < seconds:
        locator.weights(poses, ranges, angles)
        passes += 1
    return passes / (process_time() - begin)


def main() -> int:
    """Print the rates, losses first."""
    parser = argparse.ArgumentParser(prog="benchmarks.locating", description=__doc__.split("\n\n")[0])
    parser.add_argument("map", nargs="?", help="map_server's .yaml; default: a hall of 20 m x 15 m with pillars")
    parser.add_argument("--seconds", type=float, default=3.0, help="of processor time for each form (default 3)")
    given = parser.parse_args()
    grid = files.read(given.map).grid if given.map else room()
    rows, columns = grid.cells.shape
    found = {form: rate(grid, form, given.seconds) for form in ("numba", "numpy")}
    print(f"{COUNT} particles x {RAYS} rays on {columns} x {rows} cells, processor time of one core")
    for form, passes in found.items():
        print(f"- {form}: {passes:.1f} a second")
    print(f"{'holds' if found['numba'] >= AIM else 'DOES NOT HOLD'}: at least {AIM:g} a second by numba")
    return 0


if __name__ == "__main__":
    sys.exit(main())
