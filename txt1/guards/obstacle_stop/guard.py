"""A guard of the safety gate that lowers the speed to one that the laser's free distance allows."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import copysign, cos, hypot, inf, isfinite, sin
from typing import Final, NamedTuple

import numpy as np

from txt1.control.limits import Fault, Gate
from txt1.errors import ConfigError
from txt1.guards.obstacle_stop.free_distance import Floats, free_distance, stopping_speed
from txt1.guards.obstacle_stop.settings import ObstacleStop
from txt1.model.vehicle import Geometry
from txt1.runtime import Runtime
from txt1.sensors.base import Reading
from txt1.sensors.readings import Scan
from txt1.tasks.state import State

# past poses, one a cycle, for 1 s; and past scans at most
PAST_POSES: Final = 50
# m/s below which a measured curvature means nothing
CURVATURE_SPEED_MIN: Final = 0.05
# s at least between two scans that show a speed: closer ones show the noise of ranges; most lasers turn in 0.1 s
APART: Final = 0.08
SILENT: Final = "the laser is silent"

Pose = tuple[float, float, float]


class LaserGuard:
    """Keeps the speed such that the robot can stop, along the commanded arc and along the present arc; backwards, too,
    if the laser turns all round.

    What is nearer than an earlier scan showed it comes towards the robot, at up to `people` m/s; without an earlier
    scan all comes so. It goes on while the robot reacts and brakes (ISO 13855).

    The odometry since the newest scan moves its points into the vehicle's present frame. So the laser's delay costs no
    distance, except for things that it has not seen yet.
    """

    def __init__(
        self,
        scan: Callable[[], Reading[Scan] | None],
        state: State,
        gate: Gate,
        geometry: Geometry,
        parameters: ObstacleStop,
    ) -> None:
        self._scan, self._state, self._gate = scan, state, gate
        self._geometry, self._parameters = geometry, parameters
        self._past: deque[tuple[float, Pose]] = deque(maxlen=PAST_POSES)
        self._slowed = False
        self._scans: deque[_Seen] = deque(maxlen=PAST_POSES)

    def __call__(self, v: float, omega: float, now: float) -> tuple[float, float]:
        """Return the set-point with its speed lowered, on the same arc."""
        odometry = self._state.odometry
        self._past.append((now, (odometry.x, odometry.y, odometry.theta)))
        if v == 0.0:
            self._gate.limited = False
            return v, omega
        limit, why = self._allowed(v, omega / v, now)
        slowed = abs(v) > limit
        self._gate.limited = slowed and why != SILENT
        if slowed and not self._slowed:
            self._gate.count(Fault.OBSTACLE)
            self._state.tell(now, f"slowed to {limit:.2f} m/s: {why}")
        self._slowed = slowed
        if not slowed:
            return v, omega
        share = limit / abs(v)
        return v * share, omega * share

    @property
    def margin(self) -> float:
        """The distance kept round the body, m."""
        return self._parameters.margin

    def ahead(self, now: float, gear: float) -> Floats:
        """Return the points seen near the end of the body that goes ahead in a gear (1 or -1), for which the guard may
        have stopped it: (n, 2), m, in the vehicle's frame.
        """
        reading, body, margin = self._fresh(now), self._geometry, self._parameters.margin
        if reading is None or not self._past or (gear < 0.0 and not reading.value.all_round):
            return np.empty((0, 2))
        front, side = 0.5 * body.length + 2.0 * margin, 0.5 * body.width + 2.0 * margin
        points = self._here(self._noted(reading), abs(body.centre) + hypot(front, side))
        if points is None:
            return np.empty((0, 2))
        x, y = gear * (points[:, 0] - body.centre), np.abs(points[:, 1])
        return points[(x > 0.0) & (x < front) & (y < side)]

    def _fresh(self, now: float) -> Reading[Scan] | None:
        """Return the newest scan; None if it is too old."""
        reading = self._scan()
        return None if reading is None or now - reading.time > self._parameters.timeout else reading

    def _allowed(self, v: float, commanded: float, now: float) -> tuple[float, str]:
        """Return the largest speed for a commanded speed and curvature, m/s, inf if that speed is safe; and why."""
        known, reading, reverse = self._scan(), self._fresh(now), self._parameters.reverse
        if v < 0.0 and (known is None or not known.value.all_round):
            return reverse, "the laser does not see backwards"
        if reading is None:
            return 0.0, SILENT
        limit = self._before_what_it_sees(reading, v, commanded, now)
        if v > 0.0:
            return limit, "something is ahead"
        if reverse < limit and not reading.value.shows_behind:
            return reverse, "the laser has not seen all behind"
        return limit, "something is behind"

    def _before_what_it_sees(self, reading: Reading[Scan], v: float, commanded: float, now: float) -> float:
        """Return the largest speed that what a scan shows allows, m/s; inf if the commanded speed is safe."""
        p, body, odometry = self._parameters, self._geometry, self._state.odometry
        # time in s from the scan until the robot brakes; whoever comes walks on in it, and while the robot brakes
        on = now - reading.time + p.reaction
        needed = abs(v) * (p.reaction + (0.5 * abs(v) + p.people) / p.deceleration) + p.people * on
        curvatures = [commanded]
        gear = copysign(1.0, v)
        # turning the wheels takes a while
        if gear * odometry.v > CURVATURE_SPEED_MIN and isfinite(odometry.omega):
            driven, most = odometry.omega / odometry.v, 1.0 / body.radius_min
            curvatures.append(min(max(driven, -most), most))
        newest = self._noted(reading)
        free, comes = self._free(newest, needed, gear, curvatures), p.people
        if free == inf:
            return inf
        if p.people and (before := self._before(newest.time)) is not None:
            nearer = self._free(before, needed, gear, curvatures) - free
            comes = min(max(nearer / (newest.time - before.time), 0.0), p.people)
        return stopping_speed(free - comes * on, p.reaction + comes / p.deceleration, p.deceleration)

    def _before(self, time: float) -> _Seen | None:
        """Return the scan to compare with one of a time, s, for the speed of what they show; None: there is none."""
        oldest = self._scans[-1]
        return oldest if time - self._parameters.timeout <= oldest.time <= time - APART else None

    def _free(self, seen: _Seen, needed: float, gear: float, curvatures: list[float]) -> float:
        """Return the distance in m that a scan leaves free along arcs; inf if it is longer than needed."""
        margin, body = self._parameters.margin, self._geometry
        corner = hypot(0.5 * body.length + abs(body.centre) + margin, 0.5 * body.width + margin)
        points = self._here(seen, needed + corner)
        if points is None:
            return inf
        # backwards all is as in a mirror
        points, centre = points * (gear, 1.0), gear * body.centre
        return min(free_distance(points, each, body.length, body.width, margin, centre) for each in curvatures)

    def _noted(self, reading: Reading[Scan]) -> _Seen:
        """Return what a scan shows."""
        scans = self._scans
        if not scans or scans[0].reading is not reading:
            points = reading.value.points
            radii = np.hypot(points[:, 0], points[:, 1])
            scans.appendleft(_Seen(reading, reading.time, points, radii, float(radii.min(initial=inf))))
            # later scans are compared with the newest that is far enough apart, or one after it
            while len(scans) > 1 and (not self._parameters.people or scans[-2].time <= reading.time - APART):
                scans.pop()
        return scans[0]

    def _here(self, seen: _Seen, reach: float) -> Floats | None:
        """Return the points of a scan within reach (m), in the vehicle's present frame, m; None if there are none."""
        past = self._past
        x, y, theta = past[-1][1]
        then = next((pose for time, pose in reversed(past) if time <= seen.time), past[0][1])
        turned = theta - then[2]
        dx, dy = x - then[0], y - then[1]
        reach += hypot(dx, dy)
        if seen.nearest > reach:
            return None
        points = seen.points[seen.radii <= reach]
        c, s = cos(then[2]), sin(then[2])
        moved = points - np.array((c * dx + s * dy, c * dy - s * dx))
        c, s = cos(turned), sin(turned)
        return np.column_stack((c * moved[:, 0] + s * moved[:, 1], c * moved[:, 1] - s * moved[:, 0]))


class _Seen(NamedTuple):
    """A scan, prepared."""

    reading: Reading[Scan]
    time: float
    """When it was taken, s."""
    points: Floats
    """(n, 2), m in the vehicle's frame of then."""
    radii: Floats
    """Their distances from its origin, m."""
    nearest: float
    """The least of them; inf without points."""


async def prepare(runtime: Runtime, given: ObstacleStop) -> LaserGuard | None:
    """Let the laser scanner lower the speed in the safety gate, as configured, and return the guard, None without one.

    Raises ConfigError: there is no scanner.
    """
    scanners = [name for name, polled in runtime.sensors.items() if issubclass(polled.sensor.topic.type, Scan)]
    if given.enabled == "never" or (given.enabled == "auto" and not scanners):
        return None
    name = given.sensor or (scanners[0] if len(scanners) == 1 else "")
    if name not in scanners:
        there = ", ".join(scanners) or "none"
        raise ConfigError(f"obstacle_stop.sensor: {name!r} is no laser scanner; name one of: {there}")
    polled = runtime.sensors[name]
    guard = LaserGuard(lambda: polled.last, runtime.state, runtime.gate, runtime.config.geometry, given)
    runtime.guard("obstacle_stop", guard)
    return guard
