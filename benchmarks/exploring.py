"""Random flats, which a simulated robot maps by itself: contacts, the floor it has mapped, and its way.

    python -m benchmarks.exploring --flats 20            # prints the table
    python -m benchmarks.exploring --flats 20 --page     # and puts it into docs/results/mapping.md
    python -m benchmarks.exploring --flats 1 --first 7   # one flat, by its seed

A flat is a rectangle of 7 to 10 m x 6 to 8 m, which walls cut into rooms of at least 2.2 m, with doors of 1 m, and
furniture along the walls. The TXT-1 with a Hokuyo URG-04LX (240 degrees, 4 m, noise of 1 %) begins anywhere with 0.6 m
of room, and explores in virtual time; the pose is the mapper's. A contact is the robot's motion into something; it ends
when nothing has touched for a second.

The reachable floor is what a disc as wide as the car can cover on the true map, from the start. Mapped of it is what
the saved map has as free. Cells that a wall's surface crosses are walls on a map, so a perfect map in the same cells
has not all of the floor, either. The other way is that of a point that knows its pose, turns on the spot, sees all
round as far as the laser, and always goes to the nearest border of the floor it has seen, on the true map with half the
car's width from walls, and back.
"""

import argparse
import asyncio
import json
import sys
from collections.abc import Iterator
from math import hypot, pi
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label

from benchmarks.map_goals import SETTINGS, Contacts
from rigs.page_parts import write as write_part
from txt1.kernel.loop import run
from txt1.maps.files import read, write
from txt1.maps.grid import FREE, OCCUPIED, UNKNOWN, Grid
from txt1.maps.rays import cast
from txt1.model.vehicle import Geometry
from txt1.robot import Robot

PAGE: Final = Path(__file__).parents[1] / "docs" / "results" / "mapping.md"
CELL: Final = 0.05
WALL: Final = 0.15
"""m."""
DOOR: Final = 1.0
"""m."""
SMALLEST: Final = 2.2
"""m, side of a room at least."""
START: Final = 0.6
"""m from walls at the start."""
RANGE: Final = 4.0
"""m."""
LONGEST: Final = 1200.0
"""s after which a run is ended."""
Room = tuple[float, float, float, float]


def flat(seed: int) -> tuple[Grid, tuple[float, float, float]]:
    """Draw a flat, and a pose to begin at."""
    rng = np.random.default_rng((6, seed))
    length, width = rng.uniform(7.0, 10.0), rng.uniform(6.0, 8.0)
    cells = np.full((round(width / CELL) + 8, round(length / CELL) + 8), OCCUPIED, np.int8)

    def clear(x0: float, y0: float, x1: float, y1: float, value: int = FREE) -> None:
        cells[4 + round(y0 / CELL) : 4 + round(y1 / CELL), 4 + round(x0 / CELL) : 4 + round(x1 / CELL)] = value

    doors: list[Room] = []
    rooms = list(_cut(rng, (0.0, 0.0, length, width), doors))
    for room in rooms:
        clear(*room)
    for door in doors:
        clear(*door)
    for x0, y0, x1, y1 in rooms:
        for _ in range(rng.integers(0, 4)):
            long, deep = rng.uniform(0.4, 1.6), rng.uniform(0.3, 0.8)
            side, at = int(rng.integers(4)), rng.random()
            along, across = (long, deep) if side < 2 else (deep, long)
            x, y = x0 + at * max(0.0, x1 - x0 - along), y0 + at * max(0.0, y1 - y0 - across)
            x, y = (x, (y0, y1 - across)[side]) if side < 2 else ((x0, x1 - along)[side - 2], y)
            # nobody puts a cupboard into a door
            if all(x > b + 0.7 or x + along < a - 0.7 or y > d + 0.7 or y + across < c - 0.7 for a, c, b, d in doors):
                clear(x, y, min(x + along, x1), min(y + across, y1), OCCUPIED)
    grid = Grid(cells, CELL, (0.0, 0.0, 0.0))
    far = distance_transform_edt(cells == FREE) * CELL
    row, column = np.nonzero(far > START)
    k = int(rng.integers(len(row)))
    theta = float(rng.uniform(-pi, pi))
    return grid, (CELL * (float(column[k]) + 0.5), CELL * (float(row[k]) + 0.5), theta)


def _cut(rng: np.random.Generator, room: Room, doors: list[Room]) -> Iterator[Room]:
    """Yield the rooms into which walls cut a room, and add the walls' doors."""
    x0, y0, x1, y1 = room
    long, wide = x1 - x0, y1 - y0
    if max(long, wide) < 2.0 * SMALLEST + WALL or (long * wide < 16.0 and rng.random() < 0.5):
        yield room
        return
    if long >= wide:
        at = rng.uniform(x0 + SMALLEST, x1 - SMALLEST - WALL)
        parts: tuple[Room, Room] = (x0, y0, at, y1), (at + WALL, y0, x1, y1)
    else:
        at = rng.uniform(y0 + SMALLEST, y1 - SMALLEST - WALL)
        parts = (x0, y0, x1, at), (x0, at + WALL, x1, y1)
    inner = [list(_cut(rng, part, doors)) for part in parts]
    # a door between two rooms that have enough of the wall in common
    common = []
    for a in inner[0]:
        for b in inner[1]:
            first, last = (max(a[1], b[1]), min(a[3], b[3])) if long >= wide else (max(a[0], b[0]), min(a[2], b[2]))
            common.append((last - first, first, last))
    share, first, last = max(common)
    begin = rng.uniform(first + 0.1, last - DOOR - 0.1) if share > DOOR + 0.2 else first
    doors.append((at, begin, at + WALL, begin + DOOR) if long >= wide else (begin, at, begin + DOOR, at + WALL))
    yield from (each for some in inner for each in some)


def place(grid: Grid, x: float, y: float) -> tuple[int, int]:
    """Return row and column of a place, m."""
    return int((y - grid.origin[1]) / grid.resolution), int((x - grid.origin[0]) / grid.resolution)


def passable(grid: Grid, start: tuple[float, float]) -> Any:
    """Return the cells that the middle of a disc as wide as the car can reach."""
    room = distance_transform_edt(grid.cells == FREE) * CELL > 0.5 * Geometry().width
    parts, _ = label(room, np.ones((3, 3)))
    return parts == parts[place(grid, *start)]


def reachable(grid: Grid, start: tuple[float, float]) -> Any:
    """Return the floor that such a disc can cover."""
    return distance_transform_edt(~passable(grid, start)) * CELL < 0.5 * Geometry().width


def greedy(grid: Grid, start: tuple[float, float]) -> float:
    """Return the way, m, of a point that sees all round and always goes to the nearest border of what it has seen."""
    open_, seen, here = passable(grid, start), np.zeros(grid.cells.shape, bool), place(grid, *start)
    free, way = grid.cells == FREE, 0.0
    angles = np.linspace(-pi, pi, 720, endpoint=False)
    steps = 0.5 * CELL * np.arange(int(2.0 * RANGE / CELL))
    while True:
        x, y = CELL * (here[1] + 0.5), CELL * (here[0] + 0.5)
        ranges = np.minimum(cast(grid, x, y, angles, RANGE), RANGE)
        ray, step = np.nonzero(steps < ranges[:, None])
        rows = ((y + steps[step] * np.sin(angles[ray])) / CELL).astype(int)
        columns = ((x + steps[step] * np.cos(angles[ray])) / CELL).astype(int)
        seen[rows, columns] = True
        ways = ways_from(open_, here)
        border = seen & free & binary_dilation(free & ~seen) & np.isfinite(ways) & (ways > 0.0)
        # shorter borders are none for the robot, either
        parts, count = label(border, np.ones((3, 3)))
        sizes = np.bincount(parts.ravel(), minlength=count + 1) * CELL
        border &= sizes[parts] >= 0.3
        if not border.any():
            return float(way + ways[place(grid, *start)])
        row, column = np.unravel_index(int(np.argmin(np.where(border, ways, np.inf))), ways.shape)
        way += ways[row, column]
        here = int(row), int(column)


def ways_from(open_: Any, here: tuple[int, int]) -> Any:
    """Return the way to each cell, m, over open cells and their eight neighbours; inf where there is none."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    number = np.full(open_.shape, -1)
    number[open_] = np.arange(open_.sum())
    ends, costs = [], []
    rows, columns = open_.shape
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = number[: rows - dy, max(0, -dx) : columns - max(0, dx)]
        b = number[dy:, max(0, dx) : columns - max(0, -dx)]
        both = (a >= 0) & (b >= 0)
        ends.append((a[both], b[both]))
        costs.append(np.full(both.sum(), CELL * hypot(dx, dy)))
    first, second = (np.concatenate(each) for each in zip(*ends, strict=True))
    size = int(open_.sum())
    graph = coo_matrix((np.concatenate(costs), (first, second)), (size, size))
    found = np.full(open_.shape, np.inf)
    found[open_] = dijkstra(graph, directed=False, indices=int(number[here]))
    return found


async def explored(seed: int, grid: Grid, start: tuple[float, float, float], folder: Path) -> dict[str, Any]:
    """Let the robot explore a flat; return what came of it."""
    write(grid, folder / "flat.yaml")
    name = folder / "made"
    settings = (
        *SETTINGS,
        f"sim.room.map={folder / 'flat.yaml'}",
        f"sim.start=[{start[0]:.3f}, {start[1]:.3f}, {start[2]:.3f}]",
        f"mapping.make={name}",
    )
    way, told = 0.0, ""
    with Contacts() as contacts:
        async with Robot.open("sim", seed=seed, settings=settings, additions={"exploring": str(name)}) as robot:
            assert await robot.load_gains()
            exploring, last = robot.alongside[-1], robot.pose
            while not exploring.done() and robot.now < LONGEST:
                await asyncio.sleep(0.1)
                here = robot.pose
                assert here is not None and last is not None
                way += hypot(here[0] - last[0], here[1] - last[1])
                last = here
            seconds, told = robot.now, "; ".join(why for each in robot.unfinished if (why := each()))
            assert last is not None
            home = hypot(last[0] - start[0], last[1] - start[1])
    floor = reachable(grid, start[:2])
    row, column = np.nonzero(floor)
    made = read(f"{name}.yaml").grid
    cells, there = places(made, start, CELL * (column + 0.5), CELL * (row + 0.5))
    values = np.where(there, made.cells.ravel()[cells], UNKNOWN)
    walls = np.zeros(made.cells.size, bool)
    walls[places(made, start, *surfaces(grid))[0]] = True
    return {
        "seed": seed,
        "contacts": len(contacts.own),
        "free": float(np.mean(values == FREE)),
        "known": float(np.mean(values != UNKNOWN)),
        "perfect": float(np.mean(~walls[cells])),
        "floor": float(floor.sum() * CELL**2),
        "way": way,
        "greedy": greedy(grid, start[:2]),
        "home": home,
        "seconds": seconds,
        "told": told,
    }


def places(made: Grid, start: tuple[float, float, float], x: Any, y: Any) -> tuple[Any, Any]:
    """Return the cells, flat, of places (m) on a map that begins at the start, and whether they are on it."""
    c, s = np.cos(start[2]), np.sin(start[2])
    dx, dy = x - start[0], y - start[1]
    u, v = made.to_cells(c * dx + s * dy, c * dy - s * dx)
    # the frame of solid cells is a cell wide
    column, row = np.floor(u).astype(int) - 1, np.floor(v).astype(int) - 1
    rows, columns = made.cells.shape
    there = (row >= 0) & (column >= 0) & (row < rows) & (column < columns)
    return np.where(there, row * columns + column, 0), there


def surfaces(grid: Grid) -> Any:
    """Return places (2, n), m, a millimetre apart on the walls' surfaces."""
    free, found = grid.cells == FREE, []
    along = np.linspace(0.0, CELL, 51)
    for cells, turned in ((free, False), (free.T, True)):
        row, column = np.nonzero(cells[1:] != cells[:-1])
        y, x = np.broadcast_arrays(CELL * (row[:, None] + 1.0), CELL * column[:, None] + along)
        found.append(np.stack((y, x) if turned else (x, y)).reshape(2, -1))
    return np.concatenate(found, axis=1)


def table(results: list[dict[str, Any]]) -> str:
    """Return what came of the flats as Markdown, losses first."""
    ratios = np.array([each["way"] / max(each["greedy"], 1.0) for each in results])
    touched = sum(each["contacts"] for each in results)
    left = sum(bool(each["told"]) for each in results)
    rows = [
        ("contacts", f"{touched} in {len(results)} flats", "0"),
        ("reachable floor that is free on the map", "{:.1f} % ({:.1f} %)".format(*_least(results, "free")), "98 %"),
        ("the same on a perfect map in these cells", "{:.1f} % ({:.1f} %)".format(*_least(results, "perfect")), ""),
        ("free, or a wall on the map", "{:.1f} % ({:.1f} %)".format(*_least(results, "known")), ""),
        ("way, in ways of greedy nearest borders", f"{ratios.mean():.2f} ({ratios.max():.2f})", "at most 2"),
        ("runs that ended with something left", f"{left}", ""),
        ("m from the start at the end", "{:.2f} ({:.2f})".format(*_of(results, "home")), ""),
        ("m2 of reachable floor", "{:.0f} ({:.0f})".format(*_of(results, "floor")), ""),
        ("m of way", "{:.0f} ({:.0f})".format(*_of(results, "way")), ""),
        ("s", "{:.0f} ({:.0f})".format(*_of(results, "seconds")), ""),
    ]
    lines = ["| flats | mean (worst) | aim |", "|---|---|---|", *(f"| {a} | {b} | {c} |" for a, b, c in rows)]
    return "\n".join(lines)


def _least(results: list[dict[str, Any]], key: str) -> tuple[float, float]:
    values = [100.0 * each[key] for each in results]
    return float(np.mean(values)), min(values)


def _of(results: list[dict[str, Any]], key: str) -> tuple[float, float]:
    values = [each[key] for each in results]
    return float(np.mean(values)), float(np.max(values))


def main() -> int:
    """Explore the flats, and print the table."""
    parser = argparse.ArgumentParser(prog="benchmarks.exploring", description=__doc__.split("\n\n")[0])
    parser.add_argument("--flats", type=int, default=100, help="how many (default 100)")
    parser.add_argument("--first", type=int, default=1, help="seed of the first (default 1)")
    parser.add_argument("--from", dest="saved", nargs="+", type=Path, help="take these results, of --each, instead")
    parser.add_argument("--each", action="store_true", help="print each flat's result")
    parser.add_argument("--page", action="store_true", help="put the table into docs/results/mapping.md")
    given = parser.parse_args()
    if given.saved:
        lines = [line for file in given.saved for line in file.read_text(encoding="utf-8").splitlines()]
        results = [json.loads(line) for line in lines if line.startswith("{")]
    else:
        results = []
        for seed in range(given.first, given.first + given.flats):
            grid, start = flat(seed)
            with TemporaryDirectory() as folder:
                results.append(run(explored(seed, grid, start, Path(folder)), speed="max"))
            if given.each:
                print(json.dumps(results[-1]), flush=True)
    seeds = ", ".join(str(each["seed"]) for each in results)
    text = f"{table(results)}\n\nOf `python -m benchmarks.exploring --flats 100`, these: {seeds}."
    print(text)
    if given.page:
        write_part(PAGE, "exploring", text, "benchmarks.exploring")
    return 0


if __name__ == "__main__":
    sys.exit(main())
