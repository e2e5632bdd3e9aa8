"""How quick locating is: 2500 particles, each with 61 rays, by numba and by NumPy, on one core.

    python -m benchmarks.locating [MAP.yaml] [--seconds 3]
    python -m benchmarks.locating --wrong 100    # pairs of a wrong map and a right one
    python -m benchmarks.locating [MAP.yaml] --kidnaps 100 [--range 10] [--times 2] [--keep FILE]

A pass weighs all particles against one scan. They stand on free floor, with any heading; the ranges are those that a
laser of 10 m would measure from there, so no ray is cheap because its particle fits.

A kidnapping: the filter knows its place, the robot is put down elsewhere, drives on for 10 s at 0.5 m/s, and turns
where it must. It scans ten times a second, 240 degrees up to 5.6 m (`--range`), with 1 cm of noise; odometry has an
error of 5 % on one wheel, and a tenth of the beams end at people. It counts if the filter says at the end that it is
not lost, and is within 0.25 m and 10 degrees. The processor time of a search of the whole map is told, too.
With `--keep`, it goes on where the file ends. With `--times`, the map is drawn that many times as large, in its cells.
"""

import argparse
import json
import sys
from collections.abc import Generator
from math import pi
from pathlib import Path
from time import process_time

import numpy as np

from rigs.laser_logs import drifted
from txt1.mapping.mapper import Mapper
from txt1.mapping.particle_filter import COUNT, RAYS, Array, Likely, Locator
from txt1.mapping.poses import composed, difference
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


def rate(grid: Grid, seconds: float) -> float:
    """Return how many passes a second of processor time one core makes."""
    locator = Locator(grid, 1)
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


def building() -> Grid:
    """A hall of 20 m x 15 m with rooms and boxes as chance will have them."""
    cells, rng = room().cells.copy(), np.random.default_rng(5)
    cells[2:-2, 2:-2] = FREE
    cells[100:104, 2:230] = cells[180:184, 120:398] = cells[100:180, 228:232] = OCCUPIED
    cells[100:104, 60:90] = cells[180:184, 300:330] = cells[130:155, 228:232] = FREE
    for row, column in rng.integers((10, 10), (280, 380), (40, 2)):
        height, width = rng.integers(4, 20, 2)
        cells[row : row + height, column : column + width] = OCCUPIED
    return Grid(cells, 0.05)


def flat_of(seed: int) -> Grid:
    """Return a flat of 9 m x 7 m, with two walls, their doors, and boxes as chance will have them."""
    rng = np.random.default_rng(seed)
    cells = np.full((140, 180), OCCUPIED, np.int8)
    cells[2:-2, 2:-2] = FREE
    column, row = int(rng.integers(60, 120)), int(rng.integers(50, 90))
    side = slice(2, column) if rng.random() < 0.5 else slice(column, 178)
    cells[2:138, column : column + 3] = cells[row : row + 3, side] = OCCUPIED
    for end in (0, row + 3):
        door = int(rng.integers(end + 5, end + 25))
        cells[door : door + 20, column : column + 3] = FREE
    door = int(rng.integers(side.start + 5, side.stop - 28))
    cells[row : row + 3, door : door + 20] = FREE
    for row, column in rng.integers((10, 10), (120, 160), (8, 2)):
        height, width = rng.integers(5, 16, 2)
        cells[row : row + height, column : column + width] = OCCUPIED
    return Grid(cells, 0.05)


def larger(grid: Grid, times: float) -> Grid:
    """Return a room similar to another one, but larger: its map has larger cells."""
    return Grid(grid.cells, times * grid.resolution)


def believed(true: Grid, given: Grid, seed: int) -> tuple[bool, bool]:
    """Return whether the filter, on a given map, once says in 10 s of driving that it knows the pose; and whether it
    says so at the end, rightly.
    """
    rng, locator = np.random.default_rng(seed), Timed(given, seed)
    way = driven(true, some_pose(true, rng), rng, 100)
    says, told, pose = False, None, way[0]
    for k, (pose, odometry) in enumerate(zip(way, drifted(way, seed), strict=True)):
        told = locator.update(0.1 * k, scanned(true, pose, rng, 5.6), odometry)
        says = says or not told.lost
    assert told is not None
    return says, not told.lost and is_near(pose, told.pose)


def wrong_maps(count: int) -> int:
    """Count how many wrong maps are believed, and in how many right ones the filter knows its place after 10 s.

    By turns, the wrong map is that of another flat, and of the same one, a quarter larger.
    """
    wrong, unknown = [], []
    for seed in range(count):
        true = flat_of(seed)
        other = larger(true, 1.25) if seed % 2 else flat_of(seed + 1000)
        if believed(true, other, seed)[0]:
            wrong.append(seed)
        if not believed(true, true, seed)[1]:
            unknown.append(seed)
    print(f"wrong maps that are believed, by seed: {wrong}; right maps without a pose: {unknown}")
    holds = len(wrong) <= 0.01 * count and len(unknown) <= 0.05 * count
    print(
        f"{'holds' if holds else 'DOES NOT HOLD'}: {len(wrong)} of {count} wrong maps are believed (aim 1 %), and in "
        f"{count - len(unknown)} of {count} right ones the pose is known after 10 s (aim 95 %)"
    )
    return 0


def some_pose(grid: Grid, rng: np.random.Generator) -> Array:
    """Draw a pose of the laser, 0.6 m from walls."""
    rows, columns = np.nonzero(grid.clear > 12)
    chosen = rng.integers(len(rows))
    x, y = grid.to_room(float(columns[chosen]) + 0.5, float(rows[chosen]) + 0.5)
    return np.array([float(x), float(y), rng.uniform(-pi, pi)])


def scanned(grid: Grid, pose: Array, rng: np.random.Generator, far: float) -> Array:
    """Return the points of a scan of 240 degrees; people stand before a tenth of the beams."""
    angles = np.radians(np.arange(-120.0, 120.0, 2.0))
    ranges = cast(grid, pose[0], pose[1], pose[2] + angles, far)
    good = np.isfinite(ranges)
    seen = ranges[good] + 0.01 * rng.standard_normal(good.sum())
    seen[rng.random(len(seen)) < 0.1] *= 0.5
    return np.column_stack((seen * np.cos(angles[good]), seen * np.sin(angles[good])))


def is_near(true: Array, told: Array) -> bool:
    """Return whether a pose is within 0.25 m and 10 degrees."""
    off = difference(true, told)
    return bool(np.hypot(off[0], off[1]) < 0.25 and abs(off[2]) < np.radians(10.0))


def driven(grid: Grid, pose: Array, rng: np.random.Generator, steps: int) -> Array:
    """Return the poses of a drive, 0.05 m apart, which turns away where the way ahead is short."""
    poses = [pose]
    for _ in range(steps):
        x, y, theta = poses[-1]
        left, ahead, right = cast(grid, x, y, theta + np.array([0.6, 0.0, -0.6]))
        turn = 0.06 * np.sign(left - right) if min(left, ahead, right) < 0.9 else 0.02 * rng.standard_normal()
        way = 0.05 if ahead > 0.5 else 0.0
        poses.append(composed(poses[-1], (way, 0.0, turn)))
    return np.array(poses)


class Timed(Locator):
    """Notes the processor times of its searches, s."""

    times: list[float] = []  # noqa: RUF012

    def _likely(self, trail: Mapper, pose: Array | None) -> Generator[None, None, Likely | None]:
        spent, work = 0.0, super()._likely(trail, pose)
        while True:
            begin = process_time()
            try:
                next(work)
            except StopIteration as ended:
                self.times.append(spent + process_time() - begin)
                found: Likely | None = ended.value
                return found
            spent += process_time() - begin
            yield


def kidnapped(grid: Grid, seed: int, far: float = 5.6) -> bool:
    """Return whether the filter knows where it is, 10 s after it was carried away."""
    rng, locator = np.random.default_rng(seed), Timed(grid, seed)
    true, wheels = [], []
    for steps in (10, 100):
        way = driven(grid, some_pose(grid, rng), rng, steps)
        true.append(way)
        wheels.append(drifted(way, seed))
    # the second odometry goes on where the first one ended: nobody told the wheels that they were lifted
    wheels[1] = composed(wheels[0][-1], difference(wheels[1][0], wheels[1]))
    locator.place(true[0][0])
    told, pose = None, true[0][0]
    for k, (pose, odometry) in enumerate(zip(np.concatenate(true), np.concatenate(wheels), strict=True)):
        told = locator.update(0.1 * k, scanned(grid, pose, rng, far), odometry)
    assert told is not None
    return not told.lost and is_near(pose, told.pose)


def kept(file: Path | None) -> dict[int, bool]:
    """Return the outcomes of a run before, by their seeds."""
    if file is None or not file.exists():
        return {}
    return {int(seed): bool(found) for seed, found in json.loads(file.read_text("utf-8")).items()}


def main() -> int:
    """Print the rates, losses first."""
    parser = argparse.ArgumentParser(prog="benchmarks.locating", description=__doc__.split("\n\n")[0])
    parser.add_argument("map", nargs="?", help="map_server's .yaml; default: a hall of 20 m x 15 m with pillars")
    parser.add_argument("--seconds", type=float, default=3.0, help="of processor time (default 3)")
    parser.add_argument("--kidnaps", type=int, default=0, help="count how many of so many are found again, instead")
    parser.add_argument("--wrong", type=int, default=0, help="count how many of so many wrong maps are believed")
    parser.add_argument("--range", type=float, default=5.6, help="of the laser, m (default 5.6)")
    parser.add_argument("--times", type=int, default=1, help="draw the map so many times as large (default 1)")
    parser.add_argument("--keep", type=Path, help="keep each kidnapping's outcome there, and do none of them again")
    given = parser.parse_args()
    if given.wrong:
        return wrong_maps(given.wrong)
    grid = files.read(given.map).grid if given.map else building() if given.kidnaps else room()
    if given.times > 1:
        block = np.ones((given.times, given.times), np.int8)
        grid = Grid(np.ascontiguousarray(np.kron(grid.cells, block)), grid.resolution, grid.origin)
    if given.kidnaps:
        outcomes = kept(given.keep)
        for seed in range(given.kidnaps):
            if seed not in outcomes:
                outcomes[seed] = kidnapped(grid, seed, given.range)
                if given.keep is not None:
                    given.keep.write_text(json.dumps(outcomes), "utf-8")
        lost = [seed for seed in range(given.kidnaps) if not outcomes[seed]]
        found_again = given.kidnaps - len(lost)
        print(f"not found, by seed: {lost}")
        if Timed.times:
            print(
                f"a search of the whole map: {np.mean(Timed.times):.2f} s in the mean, {max(Timed.times):.2f} at most"
            )
        holds = found_again >= 0.95 * given.kidnaps
        print(f"{'holds' if holds else 'DOES NOT HOLD'}: {found_again} of {given.kidnaps} are found (aim 95 %)")
        return 0
    rows, columns = grid.cells.shape
    found = rate(grid, given.seconds)
    print(f"{COUNT} particles x {RAYS} rays on {columns} x {rows} cells, processor time of one core")
    print(f"{found:.1f} a second: {'holds' if found >= AIM else 'DOES NOT HOLD'}: at least {AIM:g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
