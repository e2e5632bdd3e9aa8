"""Makes a map from scans and odometry: consecutive scans are matched, and a pose graph closes loops.

How it works
------------

*Matching.* Odometry since the scan before predicts the pose. The scan is matched with a local map, the clouds of the
last keyframes (`matcher`), in a window as large as odometry's possible error. If the robot has moved or turned enough,
the scan becomes a keyframe: a node of the graph, with an edge from the keyframe before.

*Loops.* The older keyframes are joined in chunks. Whenever there are some new keyframes, they are joined and matched
with the nearest chunks, in a window of three standard deviations of the way through the graph between them. A cloud of
several scans is far harder to mistake than a single scan. A good match becomes an edge that closes a loop. If the edge
contradicts the graph, the graph is optimised from the first node of its new loops on, and all of it in the end
(`graph`).

*Certainty.* An edge's covariance is what odometry may have erred by since the keyframe before, less what the scans
matched since then say about each direction. A scan that fits nowhere says nothing, so the covariance grows at once. The
one told of a pose is that along the shortest way through the graph from the map's first pose, so a loop lessens it.

*Poses.* Every other scan keeps its pose relative to its keyframe, so all poses follow the graph.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from math import hypot, radians
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.mapping.graph import Graph, Ways
from txt1.mapping.matcher import Cloud, LocalMap, SeenWalls, cloud_of, compiled_kernels, joined, sparse
from txt1.mapping.poses import composed, difference, placed, wrapped

Array = NDArray[np.float64]

FLOOR: Final = np.diag([0.01, 0.01, radians(0.15)]) ** 2
"""Smallest variance of a match, m^2 and rad^2: from rounding, and because the errors of a wall's points are
dependent.
"""


@dataclass(frozen=True)
class OdometryNoise:
    """Possible errors of odometry, as standard deviations of a step."""

    position: float = 0.02
    """m, for every step."""
    angle: float = radians(1.0)
    """rad, for every step."""
    way: float = 0.1
    """m per metre."""
    bend: float = radians(5.0)
    """rad per metre."""
    turn: float = 0.1
    """rad per rad turned."""

    def deviation(self, step: Array) -> tuple[float, float]:
        """Return the standard deviations of position (m) and angle (rad) after a step."""
        way = hypot(step[0], step[1])
        return self.position + self.way * way, self.angle + self.bend * way + self.turn * abs(float(step[2]))


ALONE: Final = OdometryNoise(position=0.05, angle=radians(3.0))
"""Without odometry, when a robot is taken to go on as it went from one scan to the next."""


@dataclass(frozen=True)
class Matching:
    """Settings of the mapper."""

    key_way: float = 0.3
    """m after which a scan becomes a keyframe."""
    key_turn: float = radians(15.0)
    """rad after which a scan becomes a keyframe."""
    local: int = 16
    """Number of keyframes in the local map."""
    lose: float = 0.2
    """Score below which a match with the local map does not count, and odometry is used."""
    noise: float = 0.05
    """m, standard deviation of a point, as far as a wall's points have independent errors."""
    chunk: int = 8
    """Number of keyframes in a chunk for closing loops."""
    kept: int = 64
    """Number of chunks that are kept joined, half a megabyte each; others are joined again when they are needed."""
    query: int = 6
    """Number of keyframes that are joined and matched with a chunk."""
    every: int = 2
    """Number of keyframes between two searches for loops."""
    apart: int = 24
    """Smallest number of keyframes in a loop."""
    range: float = 3.0
    """m from a chunk within which a loop is searched for, in addition to the graph's possible error."""
    furthest: float = 6.0
    """m, bound of the graph's possible error: a wider search takes too long."""
    anywhere: float = 4.0
    """m from a chunk within which a drive searches for its place on the map of earlier drives."""
    close: float = 0.25
    """Score from which a chunk may close a loop, for a window without width."""
    wide: float = 0.04
    """Increase of this score per m of the window: among more poses one fits more easily by chance."""
    often: int = 32
    """Number of times that a keyframe is optimised while driving, in the mean: this bounds the time."""
    rounds: int = 2
    """Number of times that places passed again are matched again in the end."""
    pair: int = 2
    """Number of keyframes that are joined for this."""
    beside: float = 1.5
    """m from a keyframe within which a later one is matched again with the chunk of the former."""
    again: float = 6.0
    """m of driving after which a place counts as passed again."""
    most: int = 250
    """Largest number of keyframes that are matched again, evenly spaced: this bounds the time."""
    known: float = 0.35
    """Smallest share of the points on cells that the chunk's rays have reached."""
    near: float = 0.85
    """Share of these points near points of the chunk from which a loop is closed."""


CONTRADICTS: Final = 7.8
"""Chi-square of an edge's three numbers from which the graph is optimised at once; the 95 % quantile."""
SETTLED: Final = 0.4, radians(4.6)
"""m and rad to each side where places passed twice are matched again in the end."""
NOTHING: Final = 1e-6 * np.eye(3)
"""Information of an edge without a measurement."""


class KeyScan(NamedTuple):
    """A keyframe."""

    number: int
    """Number of its scan; -1: of an earlier drive."""
    time: float
    """s."""
    cloud: Cloud


class Match(NamedTuple):
    """The result of a scan."""

    pose: Array
    """x, y, theta (m, rad) on the map so far."""
    score: float
    """Score of the match, 0 to 1; 0 without a match."""
    key: bool
    """Whether the scan became a keyframe."""
    closed: int
    """Number of loops that it closed."""


class Mapper:
    """A map in the making."""

    def __init__(self, matching: Matching | None = None, odometry: OdometryNoise | None = None) -> None:
        """Begin; raises ImportError: numba is not there."""
        self.loops = compiled_kernels()
        self.graph = Graph()
        self.keys: list[KeyScan] = []
        self._matching = matching or Matching()
        self._odometry = odometry or OdometryNoise()
        # of each scan: its keyframe, and its pose relative to that, three numbers
        self._owners, self._steps = array("q"), array("d")
        self._pose = np.zeros(3)
        self._before: Array | None = None
        self._local: LocalMap | None = None
        self._origin = np.zeros(3)
        self._chunks: dict[int, tuple[LocalMap, SeenWalls]] = {}
        self._looked = 0
        # loops since the graph was optimised, the first node that they reach, and whether it must be optimised
        self._unsettled, self._bent, self._due = 0, 0, False
        self._optimised = 0
        self._old, self._found = 0, False
        self._seen: Array | None = None
        self.local_covariance = FLOOR.copy()
        """Covariance of the newest pose on the map round it, (3, 3), m^2 and rad^2: along a corridor it grows."""
        # of the newest pose as seen from the last keyframe, and of that as seen from the first
        self._since, self._behind = np.zeros((3, 3)), np.zeros((3, 3))

    def resume(self, keys: list[KeyScan], poses: Array, edges: Iterable[Any]) -> None:
        """Continue with the keyframes of earlier drives; the start of the next drive is found when it fits
        somewhere.
        """
        self.keys = list(keys)
        for pose in poses:
            self.graph.add(pose)
        for edge in edges:
            self.graph.link(*edge)
        self._old = len(self.keys)

    @property
    def placed(self) -> bool:
        """Whether this drive's place on the map is known, or no place is needed."""
        return self._old == 0 or self._found

    @property
    def covariance(self) -> Array:
        """Covariance of the newest pose on the whole map, as seen from its first, (3, 3), m^2 and rad^2.

        It grows with the way, and shrinks where a loop is closed.
        """
        far = self._pose - self.graph.poses[-1]
        moves = np.array([[1.0, 0.0, -far[1]], [0.0, 1.0, far[0]], [0.0, 0.0, 1.0]])
        return np.asarray(moves @ self._behind @ moves.T + _turned(self._since, self._origin[2]) + FLOOR)

    @property
    def poses(self) -> Array:
        """Poses of all scans so far, a row each (m, rad)."""
        return composed(self.graph.poses[np.array(self._owners)], np.array(self._steps).reshape(-1, 3))

    def add(self, time: float, points: Array, odometry: Any) -> Match:
        """Take a scan: points (n, 2) in m, in the order of the beams, and odometry at its time, both in the
        laser's frame.
        """
        odometry = np.asarray(odometry, dtype=np.float64)
        cloud = cloud_of(points, self.loops)
        if self._before is None:
            self._before = odometry
            return self._begin(time, cloud, odometry)
        step = difference(self._before, odometry)
        self._before = odometry
        score = 0.0
        self._seen = None
        predicted = composed(self._pose, step)
        deviation = self._odometry.deviation(step)
        if self._local is None or len(cloud.points) < 10:
            self._pose = predicted
        else:
            score, self._pose = self._matched(cloud, predicted, deviation)
        self._spread(deviation)
        since = difference(self.graph.poses[-1], self._pose)
        if hypot(since[0], since[1]) < self._matching.key_way and abs(since[2]) < self._matching.key_turn:
            self._owners.append(len(self.keys) - 1)
            self._steps.extend(since)
            return Match(self._pose, score, False, 0)
        return self._keyed(time, cloud, since, score)

    def finish(self) -> None:
        """Search for loops, optimise, and match once more the places that were passed twice."""
        self._look()
        self.graph.optimise()
        if self.placed:
            self._settle()
        self._pose = composed(self.graph.poses[self._owners[-1]], self._steps[-3:])
        self._behind = self._along_ways()
        self._rebuild()

    def try_loop(self) -> None:
        """Compare the newest keyframes with the oldest without linking them, so that all loops are compiled."""
        new = len(self.keys) - 1
        query = sparse(self._cloud(range(max(0, new - self._matching.query + 1), new + 1), self.graph.poses[new]), 200)
        self._closed(0, query, SETTLED)

    def _begin(self, time: float, cloud: Cloud, odometry: Array) -> Match:
        self._pose = odometry
        new = self.graph.add(odometry)
        if self._old:
            # an edge to an arbitrary place: it connects the graph without a measurement
            step = difference(self.graph.poses[new - 1], odometry)
            self.graph.link(new - 1, new, step, NOTHING, False)
        self._looked = new
        self._own(time, cloud)
        self._rebuild()
        return Match(self._pose, 0.0, True, 0)

    def _own(self, time: float, cloud: Cloud) -> None:
        self.keys.append(KeyScan(len(self._owners), time, cloud))
        self._owners.append(len(self.keys) - 1)
        self._steps.extend((0.0, 0.0, 0.0))

    def _matched(self, cloud: Cloud, predicted: Array, deviation: tuple[float, float]) -> tuple[float, Array]:
        """Return score and pose of a scan on the local map, and note the information; 0 and none without a match."""
        assert self._local is not None
        matching = self._matching
        centre = difference(self._origin, predicted)
        position, angle = deviation
        score, found = self._local.search(
            sparse(cloud, 150),
            centre,
            0.1 + 3.0 * position,
            radians(2.0) + 3.0 * angle,
            (0.3 + 3.0 * position, radians(10.0) + 3.0 * angle),
            matching.lose,
        )
        if score <= matching.lose:
            return 0.0, predicted
        prior = matching.noise**2 * np.diag([position**-2.0, position**-2.0, angle**-2.0])
        pose, information, _, _ = self._local.align(cloud, found, centre, prior)
        moved_by = difference(found, pose)
        if hypot(moved_by[0], moved_by[1]) > 0.5 or abs(moved_by[2]) > radians(10.0):
            # the lines lead elsewhere, so they say nothing about this place
            return score, composed(self._origin, found)
        self._seen = information / matching.noise**2
        return score, composed(self._origin, pose)

    def _spread(self, deviation: tuple[float, float]) -> None:
        """Let the covariance grow by a step, and shrink by the scan's information on each direction."""
        position, angle = deviation
        step = np.diag([position, position, angle]) ** 2
        self.local_covariance, self._since = self.local_covariance + step, self._since + step
        if self._seen is not None:
            seen = np.linalg.inv(self.local_covariance) + _turned(self._seen, self._origin[2])
            self.local_covariance = np.asarray(np.linalg.inv(seen) + FLOOR)
            self._since = np.asarray(np.linalg.inv(np.linalg.inv(self._since) + self._seen))

    def _keyed(self, time: float, cloud: Cloud, since: Array, score: float) -> Match:
        """Make the scan a keyframe, and search for loops."""
        last = len(self.keys) - 1
        self._behind = self.covariance
        new = self.graph.add(self._pose)
        self.graph.link(last, new, since, np.linalg.inv(self._since + FLOOR), False)
        self._since = np.zeros((3, 3))
        self._own(time, cloud)
        closed = 0
        if new - self._looked >= self._matching.every:
            closed = self._look()
        self._rebuild()
        return Match(self._pose, score, True, closed)

    def _rebuild(self) -> None:
        """Make a new local map of the last keyframes, in the frame of the last."""
        self._origin = self.graph.poses[-1].copy()
        # a drive without a place on the map does not use the earlier drives
        first = 0 if self.placed else self._old
        self._local = self._map(range(max(first, len(self.keys) - self._matching.local), len(self.keys)), self._origin)

    def _map(self, numbers: Any, origin: Array) -> LocalMap | None:
        cloud = self._cloud(numbers, origin)
        return LocalMap(cloud, self.loops) if len(cloud.points) >= 10 else None

    def _cloud(self, numbers: Any, origin: Array) -> Cloud:
        """Return the clouds of these keyframes as a single cloud, in the frame of `origin`."""
        return joined([self.keys[k].cloud for k in numbers], difference(origin, self.graph.poses[list(numbers)]))

    def _look(self) -> int:
        """Search for loops with the last keyframes; return the number of closed loops."""
        matching = self._matching
        new = len(self.keys) - 1
        self._looked = new
        if not self.placed:
            return self._place()
        size = matching.chunk
        count = (new - matching.apart) // size
        if count < 1:
            return 0
        middles = size * np.arange(count) + size // 2
        ways = self._ways()
        self._behind, *others = self.graph.covariances(ways, [0, *middles])
        covariances = np.array(others)
        away = np.hypot(*(self.graph.poses[middles, :2] - self.graph.poses[new, :2]).T)
        # three standard deviations of place and heading along the way through the graph
        wrong = np.minimum(3.0 * np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1]), matching.furthest)
        turned = np.minimum(3.0 * np.sqrt(covariances[:, 2, 2]), radians(30.0))
        near = np.flatnonzero((away < matching.range + wrong) & (ways.lengths[middles] > 6.0))
        near = near[np.argsort(away[near] - wrong[near], kind="stable")][:2]
        if not len(near):
            return 0
        query = sparse(self._cloud(range(max(0, new - matching.query + 1), new + 1), self.graph.poses[new]), 200)
        if len(query.points) < 30:
            return 0
        contradicted, closed = 0.0, 0
        for chunk in near:
            middle = int(middles[chunk])
            found = self._closed(int(chunk), query, (0.3 + wrong[chunk], radians(3.0) + turned[chunk]))
            if found is not None:
                contradicted = max(contradicted, self.graph.link(middle, new, *found[:2], True))
                self._bent = min(self._bent, middle)
                closed += 1
        self._unsettled += closed
        self._due = self._due or contradicted > CONTRADICTS or self._unsettled > 20
        if self._due and self._optimised < matching.often * new:
            # what lies before the loops stays, so the time is that of the loops and not of the whole way
            self.graph.optimise(self._bent)
            self._optimised += new - self._bent
            self._unsettled, self._bent, self._due = 0, new, False
            self._pose = self.graph.poses[new].copy()
        if closed:
            self._behind = self._along_ways()
        return closed

    def _settle(self) -> None:
        """Match keyframes again with older keyframes of the same place, now that all are nearly in place, and optimise.

        While driving, a loop is closed only where the way through the graph is long. A loop that was closed a little
        wrong would stay so.
        """
        matching, poses, count = self._matching, self.graph.poses, len(self.keys)
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
        before = self.graph.edges.copy()
        for _ in range(matching.rounds):
            # joined before, when their keyframes lay a little differently
            self._chunks.clear()
            found = []
            for new in range(matching.apart, count, 1 + count // matching.most):
                older = min(int(np.searchsorted(along, along[new] - matching.again)), new - matching.apart + 1)
                away = np.hypot(*(poses[:older, :2] - poses[new, :2]).T)
                if not older or away.min() > matching.beside:
                    continue
                chunk = int(away.argmin()) // matching.chunk
                query = sparse(self._cloud(range(new - matching.pair + 1, new + 1), poses[new]), 200)
                edge = self._closed(chunk, query, SETTLED, new) if len(query.points) >= 30 else None
                if edge is not None:
                    found.append((matching.chunk * chunk + matching.chunk // 2, new, *edge[:2], True))
            if not found:
                return
            self.graph.restore(before)
            for each in found:
                self.graph.link(*each)
            self.graph.optimise()

    def _place(self) -> int:
        """Search the map of earlier drives for the last keyframes; return the number of new edges."""
        new, size = len(self.keys) - 1, self._matching.chunk
        if new - self._old < self._matching.query:
            return 0
        query = sparse(self._cloud(range(new - self._matching.query + 1, new + 1), self.graph.poses[new]), 200)
        if len(query.points) < 60:
            return 0
        best: tuple[float, int, tuple[Array, Array]] | None = None
        for chunk in range(max(1, self._old // size)):
            found = self._closed(chunk, query, None)
            if found is not None and (best is None or found[2] > best[0]):
                best = found[2], chunk, found[:2]
        if best is None:
            return 0
        middle = min(size * best[1] + size // 2, self._old - 1)
        # the whole drive so far is moved there at once; from far away Gauss-Newton would not converge
        there = composed(self.graph.poses[middle], best[2][0])
        poses = self.graph.poses
        poses[self._old :] = composed(there, difference(poses[new].copy(), poses[self._old :]))
        self.graph.edges["step"][self._seam()] = difference(poses[self._old - 1], poses[self._old])
        self.graph.refresh()
        self.graph.link(middle, new, *best[2], True)
        self._found, self._pose = True, poses[new].copy()
        self._behind = self._along_ways()
        return 1

    def _ways(self) -> Ways:
        """Return the ways from the last keyframe to all."""
        return self.graph.ways(len(self.keys) - 1, self._old if self._found else 0)

    def _along_ways(self) -> Array:
        """Return the last keyframe's covariance where the first is held."""
        return np.asarray(self.graph.covariances(self._ways(), [0])[0])

    def _seam(self) -> int:
        """Return the number of the edge between the earlier drives and this drive."""
        edges = self.graph.edges
        return int(np.flatnonzero((edges["first"] == self._old - 1) & (edges["second"] == self._old))[0])

    def _closed(
        self, chunk: int, query: Cloud, window: tuple[float, float] | None, new: int | None = None
    ) -> tuple[Array, Array, float] | None:
        """Return step, information and score with which the query closes a loop with a chunk, None if it does not fit.

        Args:
            chunk: its number.
            query: the cloud of the last keyframes, in the frame of the last.
            window: m and rad to each side of the place that the graph tells; None: the query may be anywhere.
            new: the keyframe whose frame the query is in; None: the last.

        """
        matching = self._matching
        size = matching.chunk
        middle, new = size * chunk + size // 2, len(self.keys) - 1 if new is None else new
        if window is None:
            middle = min(middle, self._old - 1)
        if chunk not in self._chunks:
            last = self._old if window is None else new - matching.apart // 2
            around = range(max(0, middle - size), min(middle + size + 1, last))
            poses = difference(self.graph.poses[middle], self.graph.poses[list(around)])
            made = self._map(around, self.graph.poses[middle])
            if made is None:
                return None
            self._chunks[chunk] = made, SeenWalls([self.keys[k].cloud for k in around], poses, self.loops)
        there, seen = self._chunks[chunk] = self._chunks.pop(chunk)
        if self.placed and len(self._chunks) > matching.kept:
            del self._chunks[next(iter(self._chunks))]
        if window is None:
            predicted, (reach, turn) = np.zeros(3), (matching.anywhere, radians(180.0))
        else:
            predicted, (reach, turn) = difference(self.graph.poses[middle], self.graph.poses[new]), window
        least = matching.close + matching.wide * reach
        score, found = there.search(query, predicted, reach, turn, (2.0 * reach, 2.0 * turn), least)
        if score <= least:
            return None
        prior = 1e-6 * np.eye(3)
        pose, information, _, _ = there.align(query, found, found, prior)
        shift = difference(found, pose)
        if hypot(shift[0], shift[1]) > 0.3 or abs(shift[2]) > radians(6.0):
            return None
        points = placed(pose, query.points)
        near = there.near(points)
        known = near | seen.known(points)
        if known.mean() < matching.known or near.sum() < matching.near * known.sum():
            return None
        information = _floored((information + prior) / matching.noise**2)
        return np.array([pose[0], pose[1], wrapped(pose[2])]), information, score


def _floored(information: Array) -> Array:
    """Return an information matrix whose covariance is larger by `FLOOR`."""
    return np.asarray(np.linalg.inv(np.linalg.inv(information) + FLOOR))


def _turned(matrix: Array, angle: float) -> Array:
    """Return a covariance or information of x, y and theta in a frame that is turned back by an angle, rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ matrix @ turn.T)
