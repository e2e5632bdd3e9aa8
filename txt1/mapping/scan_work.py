"""The work on each scan beside a robot: locating the robot on a map, or making the map.

Both use scans only and know no robot. In virtual time it works in the event loop, on the real clock in a process of its
own (`txt1.mapping.worker`).
"""

from __future__ import annotations

from math import ceil, isnan, pi, radians
from pathlib import Path
from tempfile import gettempdir
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from txt1.mapping import graph_file, grid_files
from txt1.mapping.growing_grid import GrowingGrid
from txt1.mapping.mapper import Mapper
from txt1.mapping.particle_filter import Locator
from txt1.mapping.poses import Array, composed, difference, placed
from txt1.mapping.sweeps import Sweep
from txt1.mapping.topics import MapNews, MapSheet, sheet_of
from txt1.maps import files
from txt1.maps.grid import Grid
from txt1.maps.keep_out import Area
from txt1.tasks.on_map import Pose

SHOWN: Final = 60
"""Number of particles that are published."""
TOLD_EVERY: Final = 1.0
"""s of driving between two maps that are published, at least; larger maps are published less often."""
TOLD_CELLS: Final = 200_000
"""Cells of a published map per such interval."""
SAVED_EVERY: Final = 30.0
"""s of driving between two saves of the unfinished map."""
ALIKE: Final = "several places on the map look like this one: drive on, or say where the robot is (--at, /initialpose)"
FOREIGN: Final = "much of what the laser sees is not on the map: is it the map of this room? If it is, make it anew"
UNSURE: Final = 0.5
"""m of standard deviation from which a pose on the unfinished map is not used."""


class ScanTask(NamedTuple):
    """A scan to work on."""

    sweep: Sweep
    mount: Pose
    """Pose of the laser on the robot."""
    place: Pose | None = None
    """The robot's pose on the map as set by a user; theta nan: any heading."""


class Work(Protocol):
    """The work on scans."""

    def take(self, task: ScanTask) -> MapNews:
        """Work on a scan."""

    def finish(self) -> list[str]:
        """End the work, and return lines for the event log."""


class Locating:
    """Finds the robot on a map."""

    def __init__(self, grid: Grid, seed: int, keep_out: tuple[Area, ...] = ()) -> None:
        self.locator = Locator(grid, seed)
        self._sheet: MapSheet | None = sheet_of(grid)._replace(keep_out=keep_out or None)

    def take(self, task: ScanTask) -> MapNews:
        """Move the particles, and weigh them."""
        locator, sweep = self.locator, task.sweep
        if task.place is not None:
            x, y, theta = task.place
            if isnan(theta):
                # the laser is close to the robot, and may point in any direction
                locator.place((x, y, 0.0), (0.3, 2.0 * pi))
            else:
                locator.place(composed(task.place, task.mount))
        found = locator.update(sweep.time, sweep.points, sweep.predicted, sweep.free, sweep.reach)
        particles = locator.particles
        chosen = particles[np.linspace(0, len(particles) - 1, min(SHOWN, len(particles))).astype(int)]
        sheet, self._sheet = self._sheet, None
        trouble = ""
        if found.alike or found.foreign:
            trouble = ALIKE if found.alike else FOREIGN
        return _news(
            task,
            found.pose,
            found.covariance,
            fit=found.fit,
            lost=found.lost,
            sheet=sheet,
            particles=tuple(_pose(each) for each in np.round(chosen, 3)),
            trouble=trouble,
        )

    def finish(self) -> list[str]:
        """Do nothing: the map is unchanged."""
        return []


class Mapping:
    """Makes a map, or extends an existing map."""

    def __init__(self, output: Path, resolution: float, saves: bool = False) -> None:
        self._output, self._resolution, self._saves = output, resolution, saves
        graph = output.with_name(f"{output.name}.graph")
        self.drives: list[str] = []
        self.mapper = Mapper()
        if graph.exists():
            self.mapper, told = graph_file.load(graph)
            self.drives = list(told.get("drives", []))
        self._grid = GrowingGrid(resolution)
        self._closed = 0
        self._told = self._saved = -1e9
        self._saved_keys = 0
        self._every = TOLD_EVERY
        self._trouble = ""
        self._scans = 0

    def take(self, task: ScanTask) -> MapNews:
        """Match the scan."""
        mapper, sweep = self.mapper, task.sweep
        self._scans += 1
        match = mapper.add(sweep.time, sweep.points, sweep.predicted)
        self._closed += match.closed
        local = mapper.local_covariance
        unsure = float(np.sqrt(local[0, 0] + local[1, 1])) > UNSURE
        sheet = self._sheet(sweep.time)
        if self._saves and sweep.time - self._saved > SAVED_EVERY and len(mapper.keys) > self._saved_keys:
            if self._saved > 0.0:
                self._save()
            self._saved, self._saved_keys = sweep.time, len(mapper.keys)
        lost = unsure or not mapper.placed
        news = _news(task, match.pose, mapper.covariance, match.score, lost, self._closed, sheet, (), self._trouble)
        return news._replace(local=_flat(local))

    def _sheet(self, time: float) -> MapSheet | None:
        """Return the map when it is due, and has changed."""
        if time - self._told < self._every or not self.mapper.placed:
            return None
        grid = self._grid.update(self.mapper)
        if remark := grid_files.coarser(self._grid.resolution, self._resolution):
            self._trouble = remark
        if grid is None:
            return None
        self._told, self._every = time, TOLD_EVERY * ceil(grid.cells.size / TOLD_CELLS)
        return sheet_of(grid)

    def _save(self) -> bool:
        """Write the map so far; return whether it was written."""
        if not self.mapper.placed:
            return False
        try:
            files, self._trouble = graph_file.files_of(
                self.mapper, self._output, self._resolution, [*self.drives, "live"]
            )
            grid_files.put(files)
        except OSError as error:
            reason = error.strerror or str(error)
            self._trouble = f"the map {self._output} cannot be saved: {reason}; it is kept, and tried again"
            return False
        return True

    def finish(self) -> list[str]:
        """Optimise, and write the map; if that is impossible, write it elsewhere."""
        if not self._scans:
            return [f"no map {self._output}: no scan came"]
        mapper, output = self.mapper, self._output
        mapper.finish()
        if not mapper.placed:
            return [f"this drive fits nowhere on the map {output}.yaml, which stays; name a new map"]
        if not self._save():
            lines = [self._trouble.removesuffix("; it is kept, and tried again")]
            self._output = Path(gettempdir(), output.name)
            if self._save():
                lines.append(f"it is in {self._output}.yaml and .graph instead")
            else:
                lines.append("nor there: make it from the recording, with txt1 map")
            return lines
        return [f"{output}.yaml: {self._scans} scans, {len(mapper.keys)} keyframes, {self._closed} loops closed"]


def _pose(pose: Any) -> Pose:
    x, y, theta = pose
    return float(x), float(y), float(theta)


def _news(
    task: ScanTask,
    pose: Array,
    covariance: Array,
    fit: float,
    lost: bool,
    closed: int = 0,
    sheet: MapSheet | None = None,
    particles: tuple[Pose, ...] = (),
    trouble: str = "",
) -> MapNews:
    """Return the result of a scan, from the laser's pose on the map."""
    back = difference(task.mount, (0.0, 0.0, 0.0))
    robot, wheels = composed(pose, back), composed(task.sweep.odometry, back)
    return MapNews(
        float(task.sweep.time),
        _pose(robot),
        _flat(covariance),
        _pose(composed(robot, difference(wheels, (0.0, 0.0, 0.0)))),
        float(fit),
        bool(lost),
        int(closed),
        sheet,
        particles,
        trouble,
    )


def _flat(covariance: Array) -> tuple[float, float, float, float, float, float, float, float, float]:
    a, b, c, d, e, f, g, h, i = map(float, np.asarray(covariance).ravel())
    return a, b, c, d, e, f, g, h, i


def locating(room: str, seed: int) -> Locating:
    """Return the work that locates a robot on a map of this name; raises ConfigError: there is no such map."""
    there = map_of(room)
    return Locating(there.grid, seed, there.keep_out)


def map_of(room: str) -> files.Map:
    """Return a map by its .yaml, the name without it, or the name of a map of the package; raises ConfigError."""
    return files.read(f"{room}.yaml" if Path(f"{room}.yaml").exists() else room)


def warm() -> None:
    """Compile all functions of a mapper and a filter, on an imaginary room."""
    angles = np.linspace(-pi, pi, 120)
    mapper = Mapper()
    for k in range(32):
        # the robot turns in the middle of a room, so each scan becomes a keyframe
        turned = radians(20.0 * k)
        with np.errstate(divide="ignore"):
            ranges = np.minimum(2.0 / np.abs(np.cos(angles + turned)), 1.5 / np.abs(np.sin(angles + turned)))
        points = np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))
        mapper.add(0.1 * k, points, (0.0, 0.0, turned))
    mapper.try_loop()
    mapper.finish()
    grid = GrowingGrid().update(mapper)
    assert grid is not None
    from txt1.maps.rays import prepare

    prepare()
    locator = Locator(grid, 0, count=10)
    # it searches the whole map first
    for k in range(6):
        locator.update(0.5 * k, placed((0.0, 0.0, pi * radians(k)), points), (0.0, 0.0, 0.0))
    locator.place((0.0, 0.0, 0.0))
    for k in range(3):
        locator.update(3.0 + 0.1 * k, placed((0.0, 0.0, pi * radians(k)), points), (0.0, 0.0, 0.0))
