"""The robot's pose on a map: a particle filter, which notices that it is lost and finds itself again.

How it works
------------

*Particles.* Each particle is a possible pose of the laser. Odometry moves the particles, with noise. A scan weighs
them: rays are cast from each particle, and the expected ranges are compared with the measured ranges. If few particles
carry most of the weight, the particles are drawn again (low-variance resampling; Thrun, Burgard, Fox, *Probabilistic
Robotics* 2005, 8.3).

*Rays.* A ray leaps by the distance to the nearest wall, which the grid has for each cell (`Grid.clear`; sphere tracing,
Hart 1996). It ends soon after the measured range. This is exact to a cell, and only sums are needed. It is several
times as fast as `txt1.maps.rays`, which goes line by line, is exact, and makes arrays of all rays.

*Lost.* At the true pose the scan's rays end at walls of the map, or earlier, at people. Few rays go through walls. If
too many rays go through walls at the particles' mean, for a while, the filter is lost. In the middle of a hall the
laser may reach no wall. There the rays that met nothing tell that the map has no wall as near, and a pose that is known
is kept, as long as the particles are together.

*Found again.* At the start, and from the first scan that does not fit, the scans make a small map of their own
(`mapper`), because odometry alone distorts the last metres. Its points are matched with the walls of the whole map, in
each tile and each sector of headings (`whole_map`). Places may look alike. So each place found gets particles of its
own, which go through these scans (a filter in clusters: Milstein, Sanchez and Williamson, "Robust global
localization using clustered particle filtering", AAAI 2002). Their rays also use the free floor. The likelihood of the
scans weighs the places against each other. The particles go on from all likely places. A search of a large map takes
several scans, which are weighed meanwhile. If nothing fits for a while, the result is: lost.

*Alike.* When all particles have come together, the map is searched again, and their place is weighed against the
places found. The filter is found if the odds for its place are high enough (a sequential probability ratio test: Wald
1945). Otherwise the particles are placed anew at all likely places, and the next scans decide.

*A wrong map.* On the map of a larger room all walls seen might be people before the map's walls: no ray goes through a
wall, and the rays that are not too short fit. So the filter counts itself as found only if most rays of the small map
end at walls of the whole map. A wrong map may reach this share by chance. So the share must be larger at the same
level of significance.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from functools import cache
from math import hypot, radians, sqrt
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.mapping.carmen_logs import RANGE_USED_MAX
from txt1.mapping.mapper import Mapper
from txt1.mapping.matcher import CLOUD_SPACING, Cloud, LocalMap, compiled_kernels, joined, sparse
from txt1.mapping.poses import composed, difference, wrapped
from txt1.mapping.whole_map import WholeMap
from txt1.maps.grid import OCCUPIED_FROM, Grid
from txt1.sim.machine_code import compiled

Array = NDArray[np.float64]

COUNT: Final = 2500
"""Number of particles."""
RAYS: Final = 61
"""Number of a scan's rays that are compared."""
RANGE_SIGMA: Final = 0.06
"""m, standard deviation of a range on the map: of the laser, and of a cell."""
RANDOM: Final = 0.1
"""Share of ranges that may have any value: people, glass."""
TOGETHER: Final = 0.25
"""Factor on the sum of logarithms of a scan: the errors of neighbouring rays are not independent."""
TELLS: Final = 0.15
"""m by which a range may differ and still fit."""
LOSES: Final = 0.75
"""Share of fitting rays below which the filter is lost after a while."""
FINDS: Final = 0.92
"""Share from which it is found after a while."""
BELIEVED: Final = 0.75
"""Share of all rays of the small map of which more must end at walls of the whole map when the filter is found: people
stand before the others.
"""
RAYS_SHARE_MIN: Final = 0.25
"""Smallest share of a scan's rays that are not too short. With fewer, the beams that met nothing count, too."""
RAYS_MIN: Final = 5
"""Smallest number of these rays."""
NOTHING: Final = np.empty((0, 2))
LOST_AFTER: Final = 1.0
"""s without a fitting scan until the filter is lost, and of fitting scans until it is found."""
SEARCH_PERIOD: Final = 1.0
"""s between the beginnings of two searches of the whole map."""
TRAIL: Final = 16
"""Newest keyframes of the small map that are matched with the whole map; with three times as many, it is renewed."""
MATCH_ENOUGH: Final = 0.4
"""Score of this match from which a pose is compared by rays."""
EXPLAINED: Final = 6
"""Number of scans whose rays must end at walls: those of more scans end at the same walls, and tell nothing new."""
AROUND: Final = np.array((0.03, 0.03, radians(0.5)))
"""m and rad, standard deviations of the particles round a pose: the places found are as exact as small cells."""
BETWEEN: Final = np.array((0.02, 0.02, radians(0.5)))
"""m and rad, standard deviations of the way between two of these scans on the small map."""
EACH: Final = 50
"""Number of particles round each of the best of these poses."""
DOUBTED: Final = 0.01
"""Probability of all other places above which the robot may be elsewhere; and the level at which a wrong map is
refuted.
"""
ELSEWHERE: Final = 0.25
"""m, or rad; poses with a larger difference are different places."""
THROUGH: Final = 0.4
"""m beyond a measured range at which a ray ends: the range is too short, whatever the ray would meet."""
WEIGHT_STEP: Final = 0.02
"""m, step of the table of weights."""


class Likely(NamedTuple):
    """The result of a search of the whole map."""

    poses: Array
    """Poses of the laser, a row each, at the last scan before the search."""
    logs: Array
    """Logarithms of their probabilities, but for a common term."""


class PendingSearch:
    """A search in the making, begun at a pose by the particles."""

    def __init__(self, work: Generator[None, None, Likely | None], pose: Array | None) -> None:
        self.work = work
        self.pose = pose
        """None: the search is for places, and not a question whether this pose is the only one."""
        self.way = np.zeros(3)
        """The way by odometry since the beginning."""


class Located(NamedTuple):
    """The result of a scan: the laser's pose."""

    time: float
    """s."""
    pose: Array
    """x, y, theta (m, rad) on the map."""
    covariance: Array
    """(3, 3), m^2 and rad^2."""
    fit: float
    """Share of the scan's rays that end at the map's walls, among those that are not too short."""
    lost: bool
    """Whether the pose must not be used."""
    alike: bool = False
    """Whether it is lost because another place is equally likely."""
    foreign: bool = False
    """Whether it is lost because too much of what is seen is not on the map."""


def _rays_of(points: Array) -> tuple[Array, Array]:
    """Return ranges (m) and angles (rad) of the rays to compare."""
    chosen = points[np.linspace(0, len(points) - 1, min(RAYS, len(points))).astype(int)]
    return np.hypot(chosen[:, 0], chosen[:, 1]), np.arctan2(chosen[:, 1], chosen[:, 0])


def _compared(trail: Mapper, most: int = TRAIL) -> list[tuple[Array, Array]]:
    """Return the points of some of the newest scans of a small map, each with its pose relative to now."""
    keys = trail.keys[-TRAIL:]
    back = difference(trail.poses[-1], trail.graph.poses[-len(keys) :])
    return [(keys[k].cloud.points, back[k]) for k in np.unique(np.linspace(0, len(keys) - 1, most, dtype=int))]


def _are_one(found: Likely, pose: Array) -> bool:
    """Return whether it is improbable that the robot is elsewhere than at `pose`."""
    off = difference(pose, found.poses)
    there = (np.hypot(off[:, 0], off[:, 1]) > ELSEWHERE) | (np.abs(off[:, 2]) > ELSEWHERE)
    weights = np.exp(found.logs - found.logs.max())
    return float(weights[there].sum()) < DOUBTED * float(weights.sum())


def _table() -> Array:
    """Return the logarithms of the weights, for measured minus expected range from -4 m to 4 m in steps of WEIGHT_STEP.

    A range that is too short is from a person or a box. A range through a wall is less likely.
    """
    off = np.arange(-4.0, 4.0 + WEIGHT_STEP / 2.0, WEIGHT_STEP)
    random = np.where(off < 0.0, RANDOM, 0.3 * RANDOM)
    return np.log((1.0 - RANDOM) * np.exp(-(off**2) / (2.0 * RANGE_SIGMA**2)) + random)


def _weigh(
    clear: Any, u: Any, v: Any, theta: Any, cosines: Any, sines: Any, ranges: Any, cell: float, table: Any, out: Any
) -> None:
    """Write the sum of the logarithms of each particle's weights. Plain loops, for numba.

    Args:
        clear: quarters of cells to the nearest wall, uint8, in a frame of walls. u, v: the particles' columns and rows
        in this array.
        theta: their headings in the grid's axes, rad. cosines, sines: cosines and sines of the rays' angles in the
            laser's frame.
        ranges: measured ranges, m.
        cell: side of a cell, m.
        table: logarithms of the weights, from `_table`.
        out: the sums, written here.

    """
    rows, columns = clear.shape
    middle = (table.shape[0] - 1) // 2
    per_step = cell / WEIGHT_STEP
    count = ranges.shape[0]
    x, y, t, dx, dy, measured = np.empty((6, count))
    for p in range(u.shape[0]):
        c, s = np.cos(theta[p]), np.sin(theta[p])
        for k in range(count):
            dx[k], dy[k] = c * cosines[k] - s * sines[k], s * cosines[k] + c * sines[k]
            x[k], y[k], t[k], measured[k] = u[p], v[p], 0.0, ranges[k] / cell
        inside = u[p] >= 0.0 and v[p] >= 0.0 and u[p] < columns and v[p] < rows
        total, left = 0.0, count
        # the rays leap in turn, so that the processor need not wait for one of them; finished rays are removed
        while left > 0:
            k = 0
            while k < left:
                # the frame of walls keeps every ray within
                near = clear[int(y[k]), int(x[k])] if inside else 0
                if near > 0 and t[k] < measured[k] + THROUGH / cell:
                    leap = max(0.25 * near - 0.7, 0.6)
                    t[k] += leap
                    x[k] += dx[k] * leap
                    y[k] += dy[k] * leap
                    k += 1
                    continue
                at = middle + int((measured[k] - t[k]) * per_step + 1000.5) - 1000
                total += table[min(max(at, 0), table.shape[0] - 1)]
                left -= 1
                x[k], y[k], t[k] = x[left], y[left], t[left]
                dx[k], dy[k], measured[k] = dx[left], dy[left], measured[left]
        out[p] = total


@cache
def weigher() -> Callable[..., None]:
    """Return the function that weighs particles."""
    return compiled(_weigh, cache=True, nogil=True)


class Locator:
    """The filter, on a grid; it is lost until it has a place."""

    def __init__(self, grid: Grid, seed: int = 0, count: int = COUNT) -> None:
        """Begin; raises ImportError: numba is not there."""
        self.loops = compiled_kernels()
        self.grid = grid
        self._weigh = weigher()
        self._rng = np.random.default_rng(seed)
        self._count = count
        self._table = _table()
        self._clear = np.minimum(4.0 * grid.clear, 255.0).astype(np.uint8)
        self._whole = WholeMap(grid, LocalMap(_walls_of(grid), self.loops))
        self.particles = np.empty((0, 3))
        """Poses of the laser, a row each (m, rad)."""
        self._logs = np.zeros(0)
        self._trail: Mapper | None = None
        self._before: Array | None = None
        self._lost = True
        self._doubts, self._alike, self._foreign = True, False, False
        self._changes, self._next = 0.0, 0.0
        self._search: PendingSearch | None = None

    def place(self, pose: Any, spread: tuple[float, float] = (0.2, radians(8.0))) -> None:
        """Place the particles round a given pose, with standard deviations in m and rad."""
        self.particles, self._logs = self._round(np.asarray(pose), spread), np.zeros(self._count)
        self._lost = self._doubts = self._alike = self._foreign = False
        self._search = None

    def _round(self, poses: Array, spread: tuple[float, float]) -> Array:
        """Return poses for the particles round a pose, or for each round its own pose."""
        return np.asarray(poses + self._rng.standard_normal((self._count, 3)) * (spread[0], spread[0], spread[1]))

    def update(
        self, time: float, points: Array, odometry: Any, free: Array = NOTHING, reach: float = RANGE_USED_MAX
    ) -> Located:
        """Take a scan: points (n, 2) in the laser's frame (m), and the laser's pose by odometry (m, rad); `free`:
        places (n, 2) on the other beams, which met nothing within the laser's `reach`, m.
        """
        odometry = np.asarray(odometry, dtype=np.float64)
        step = np.zeros(3) if self._before is None else difference(self._before, odometry)
        self._before = odometry
        self._noted(time, points, odometry)
        if self._search is not None:
            self._search.way = composed(self._search.way, step)
        if not len(self.particles):
            self._changes = time
            if not self._searched(time):
                return Located(time, odometry, np.diag([1e6, 1e6, 10.0]), 0.0, True)
        else:
            self._moved(step)
        if len(points) >= RAYS_MIN:
            self._logs = self._logs + TOGETHER * self.weights(self.particles, *_rays_of(points))
        fit = self._fit(self._mean()[0], points, free, reach)
        told = self._told(time, fit)
        self._doubts = told.lost or fit < LOSES
        if told.lost and fit < FINDS and self._searched(time):
            self._changes = time
        self._resampled()
        return told

    def _noted(self, time: float, points: Array, odometry: Array) -> None:
        """Add the scan to the small map, which is made from the first doubt on."""
        if not self._doubts:
            self._trail = self._search = None
            return
        if self._trail is None or len(self._trail.keys) > 3 * TRAIL:
            self._trail = Mapper()
        self._trail.add(time, points, odometry)

    def _moved(self, step: Array) -> None:
        """Move the particles by odometry, each with its own errors."""
        way, turn = hypot(step[0], step[1]), abs(float(step[2]))
        count = len(self.particles)
        noise = self._rng.standard_normal((count, 3))
        position, angle = 0.002 + 0.1 * way, radians(0.2) + 0.1 * turn + radians(4.0) * way
        self.particles = composed(self.particles, step + noise * (position, position, angle))

    def weights(self, poses: Array, ranges: Array, angles: Array) -> Array:
        """Return the sums of logarithms for poses."""
        u, v = self.grid.to_cells(poses[:, 0], poses[:, 1])
        out = np.empty(len(poses))
        heading = np.ascontiguousarray(poses[:, 2] - self.grid.origin[2])
        cosines, sines = np.cos(angles), np.sin(angles)
        self._weigh(self._clear, u, v, heading, cosines, sines, ranges, self.grid.resolution, self._table, out)
        return out

    def _mean(self) -> tuple[Array, Array]:
        """Return the weighted mean and the covariance of the particles."""
        weights = np.exp(self._logs - self._logs.max())
        weights /= weights.sum()
        x, y = weights @ self.particles[:, :2]
        theta = np.arctan2(weights @ np.sin(self.particles[:, 2]), weights @ np.cos(self.particles[:, 2]))
        mean = np.array([x, y, float(theta)])
        off = self.particles - mean
        off[:, 2] = wrapped(off[:, 2])
        # the map is no finer than a cell
        return mean, (weights[:, None] * off).T @ off + np.diag([0.01, 0.01, radians(0.3)]) ** 2

    def _fit(self, pose: Array, points: Array, free: Array, reach: float) -> float:
        """Return the share of rays that end at a wall of the map, among those that are not too short. If these are few,
        the beams that met nothing count, too. Return 0 if even then too few tell anything.
        """
        fits, through = self._counted(pose, points)
        if len(points) < RAYS_MIN or fits + through < RAYS_SHARE_MIN * min(RAYS, len(points)):
            fits, through = self._counted(pose, points, free, reach)
            if fits + through < max(RAYS_MIN, RAYS_SHARE_MIN * min(RAYS, len(points) + len(free))):
                return 0.0
        return fits / (fits + through)

    def _counted(
        self, pose: Array, points: Array, free: Array = NOTHING, reach: float = RANGE_USED_MAX
    ) -> tuple[int, int]:
        """Return the numbers of rays that fit the map, and that go through one of its walls.

        Those to points fit if they end at a wall. The others go through `reach`, and fit if no wall is as near.
        """
        from txt1.maps.rays import cast

        ranges, angles = _rays_of(np.concatenate((points, free)))
        met = np.linspace(0, len(points) + len(free) - 1, len(ranges)).astype(int) < len(points)
        ranges = np.where(met, ranges, reach)
        expected = cast(self.grid, pose[0], pose[1], pose[2] + angles)
        with np.errstate(invalid="ignore"):
            off, margin = ranges - expected, TELLS + 0.03 * ranges
        return int(np.count_nonzero((off <= margin) & (~met | (off >= -margin)))), int(np.count_nonzero(off > margin))

    def _is_explained(self, pose: Array) -> bool | None:
        """Return whether enough of the small map's rays end at walls of the map, if the laser is at a pose now: whether
        a share of `BELIEVED` or less is refuted. None: even if all rays ended there, they would be too few.
        """
        if self._trail is None:
            return True
        fits, total = 0, 0
        for points, back in _compared(self._trail, EXPLAINED):
            fits += self._counted(composed(pose, back), points)[0]
            total += min(RAYS, len(points))
        by_chance = NormalDist().inv_cdf(1.0 - DOUBTED) * sqrt(total * BELIEVED * (1.0 - BELIEVED))
        least = BELIEVED * total + by_chance
        return fits > least if total > least else None

    def _told(self, time: float, fit: float) -> Located:
        mean, covariance = self._mean()
        sure = float(np.sqrt(covariance[0, 0] + covariance[1, 1])) < 0.5
        if (not sure or fit < LOSES) if not self._lost else (sure and fit >= FINDS):
            # this may be a change; it counts if it lasts
            if time - self._changes >= LOST_AFTER:
                alone = self._is_alone(mean) if self._lost else True
                if alone is not None:
                    explained = self._is_explained(mean) if self._lost and alone else None
                    self._alike, self._foreign = not alone, explained is False
                    self._lost, self._changes = not explained, time
        else:
            self._changes = time
        return Located(time, mean, covariance, fit, self._lost or not sure, self._alike, self._foreign)

    def _searched(self, time: float) -> bool:
        """Search the whole map for the small map; return whether particles could be placed."""
        if self._search is None or self._search.pose is not None:
            if time < self._next or self._trail is None:
                return False
            self._next = time + SEARCH_PERIOD
            self._search = PendingSearch(self._likely(self._trail, None), None)
        ended, found, way = self._continued(self._search)
        if not ended or found is None:
            return False
        self._alike = not _are_one(found, found.poses[np.argmax(found.logs)])
        self._placed(found, way)
        return True

    def _placed(self, found: Likely, way: Array) -> None:
        """Place the particles at the poses found by a search, and move them by the way since its beginning."""
        self.particles, self._logs = found.poses, found.logs
        if way.any():
            self._moved(way)
        self._resampled()

    def _is_alone(self, pose: Array) -> bool | None:
        """Return whether no other place than a pose's is likely for the small map; None: it is not known yet."""
        if self._trail is None:
            return True
        if self._search is None or self._search.pose is None:
            self._search = PendingSearch(self._likely(self._trail, pose), pose)
        asked = self._search.pose
        assert asked is not None
        ended, found, way = self._continued(self._search)
        if not ended:
            return None
        if found is None or _are_one(found, asked):
            return True
        self._placed(found, way)
        return False

    def _continued(self, search: PendingSearch) -> tuple[bool, Likely | None, Array]:
        """Do a portion of a search; return whether it has ended, its result, and the way driven meanwhile."""
        try:
            next(search.work)
        except StopIteration as ended:
            self._search = None
            return True, ended.value, search.way
        return False, None, search.way

    def _likely(self, trail: Mapper, pose: Array | None) -> Generator[None, None, Likely | None]:
        """Return poses of the small map on the whole map, None if there are none; yields after each portion.

        A pose given is weighed, too.
        """
        keys, compared = trail.keys[-TRAIL:], _compared(trail)
        back = difference(trail.poses[-1], trail.graph.poses[-len(keys) :])
        cloud = joined([key.cloud for key in keys], back)
        if len(cloud.points) < 50:
            return None
        places = yield from self._whole.places(sparse(cloud, 100), MATCH_ENOUGH)
        if not len(places):
            return None
        # one place is the pose's
        most = max(1, self._count // EACH - (pose is not None))
        best = places[np.argsort(-self._logs_of(places, compared), kind="stable")[:most]]
        return self._gone_through(best if pose is None else np.concatenate((best, [pose])), compared)

    def _gone_through(self, places: Array, compared: list[tuple[Array, Array]]) -> Likely:
        """Let the particles of each place go through the scans compared, and weigh the places by them."""
        count, each = len(places), self._count // len(places)
        poses, logs, before, deviation = np.repeat(places, each, axis=0), np.zeros((count, 1)), np.zeros(3), AROUND
        for points, back in compared:
            poses = composed(poses, difference(before, back)) + deviation * self._rng.standard_normal(poses.shape)
            fits = TOGETHER * self.weights(poses, *_rays_of(points)).reshape(count, each)
            highest = fits.max(axis=1, keepdims=True)
            weights = np.exp(fits - highest)
            logs += highest + np.log(weights.mean(axis=1, keepdims=True))
            # drawn again within each place
            shares = np.cumsum(weights, axis=1) / weights.sum(axis=1, keepdims=True)
            asked = (self._rng.random((count, 1)) + np.arange(each)) / each
            drawn = (shares[:, None, :] < asked[:, :, None]).sum(axis=2).clip(0, each - 1)
            poses = np.take_along_axis(poses.reshape(count, each, 3), drawn[:, :, None], axis=1).reshape(-1, 3)
            before, deviation = back, BETWEEN
        return Likely(composed(poses, difference(before, np.zeros(3))), np.repeat(logs, each))

    def _logs_of(self, poses: Array, compared: list[tuple[Array, Array]]) -> Array:
        """Return sums of logarithms over scans, each given by its points and the pose at which it was seen,
        relative to now.
        """
        logs = np.zeros(len(poses))
        for points, back in compared:
            logs += TOGETHER * self.weights(composed(poses, back), *_rays_of(points))
        return logs

    def _resampled(self) -> None:
        """Draw the particles again if few of them carry the weight."""
        self._logs -= self._logs.max()
        weights = np.exp(self._logs)
        weights /= weights.sum()
        count = self._count
        if 1.0 / float(weights @ weights) > 0.5 * len(weights):
            return
        places = (self._rng.random() + np.arange(count)) / count
        chosen = np.searchsorted(np.cumsum(weights), places).clip(0, len(weights) - 1)
        self.particles, self._logs = self.particles[chosen], np.zeros(count)


def _walls_of(grid: Grid) -> Cloud:
    """Return the centres of the cells of a map's walls that lie beside free floor, as points, m."""
    # a map may be black outside its walls, where no ray ends
    surface = grid.depth[1:-1, 1:-1] > -grid.resolution
    rows, columns = np.nonzero((grid.cells >= OCCUPIED_FROM) & surface)
    x, y = grid.to_room(columns.astype(np.float64) + 1.5, rows.astype(np.float64) + 1.5)
    points = np.column_stack((x, y))
    return (
        Cloud(points, np.zeros_like(points))
        if grid.resolution >= CLOUD_SPACING
        else sparse(Cloud(points, np.zeros_like(points)), max(1000, len(points) // 4))
    )
