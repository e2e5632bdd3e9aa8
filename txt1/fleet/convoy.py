"""A convoy: each robot follows the robot ahead, by the odometry that the robot ahead sends.

Along the path: v = v_ahead + k (s - d - h v), with s the distance to the car ahead along its track. The spacing d + h v
grows with the speed by the time headway h. For a vehicle whose speed follows its set-point with a time constant tau,
an error passes down the line by

    G(s) = (s + k) / (tau s^2 + (1 + k h) s + k),

and abs(G) <= 1 at every frequency where h (2 + k h) >= 2 tau: then no error grows along the line (string stability; D.
Swaroop and J. K. Hedrick, "String stability of interconnected systems", IEEE TAC 41, 1996; J. Ploeg, N. van de Wouw and
H. Nijmeijer, "Lp string stability of cascaded systems: application to vehicle platooning", IEEE TCST 22, 2014).

Across the path: pure pursuit of a point on the track of the car ahead, so the followers cut no corners.

The leader drives no faster and turns no more sharply than all cars that it hears can. Its circle has room for the whole
line, as otherwise it would meet the last car, and all would stand. Each follower drives as fast as its own car can.

Limits: odometry drifts, so followers drive beside the track after long curves. The law knows no obstacles: a leader
whose course ends at a wall is stopped there by the guard (`txt1.fleet.guard`).
"""

from collections import deque
from collections.abc import Mapping
from math import atan2, cos, hypot, pi, sin
from typing import Final

from txt1.errors import ConfigError
from txt1.fleet.body import DEFAULT_BODY, Body
from txt1.fleet.radio import Said
from txt1.model.kinematics import wrap_angle

# m added to the circles of two cars: the distance d of their centres at rest
SLACK: Final = 0.26
# d of two TXT-1s, m
GAP: Final = 2.0 * DEFAULT_BODY.reach + SLACK
# h, s; with k and tau below, the condition asks for 0.35 s, and late hearing for more
HEADWAY: Final = 0.8
# k, 1/s
GAP_GAIN: Final = 0.8
# m, of the pursuit
PURSUIT_AHEAD: Final = 0.6
# m between two points of the track
TRACK_STEP: Final = 0.05
# points of the track
TRACK_MAX: Final = 1000
# share of a follower's top speed at which it catches up
CATCHING_UP: Final = 2.0 / 3.0
# share of the slowest car's top speed at which the leader drives if no speed is given
LEADING: Final = 1.0 / 3.0
# share of the slowest car's top speed that the leader never exceeds, so that the other cars can catch up
RESERVE: Final = 0.6
# the leader's smallest circle, in turning circles of the least agile car, and in circles as long as the line
WIDER: Final = 1.1
# m/s; a slower set-point counts as rest, as the motors' dead band makes slow driving uneven
REST_SPEED: Final = 0.08


class Leader:
    """Drives a course of its own at `speed` m/s: a circle of `radius` m, or a straight line with 0.

    The speed swings by `swing` m/s with a period of `period` s, beginning after `rest` s. Raises ConfigError: the
    circle is smaller than the car's own.
    """

    needs: frozenset[str] = frozenset()

    def __init__(
        self,
        body: Body = DEFAULT_BODY,
        *,
        speed: float | None = None,
        radius: float = 0.0,
        swing: float = 0.0,
        period: float = 20.0,
        rest: float = 0.0,
    ) -> None:
        if 0.0 < abs(radius) < body.radius:
            raise ConfigError(f"cooperate.radius: {radius:g} m; the leader's smallest is {body.radius:g} m")
        self._speed, self._radius, self._swing, self._period, self._rest = speed, radius, swing, period, rest
        self._body = body
        self._began: float | None = None
        self.data: tuple[float, ...] = ()

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Return the velocities of the course."""
        if self._began is None:
            self._began = me.time
        time = me.time - self._began - self._rest
        if time < 0.0:
            return 0.0, 0.0
        bodies = [self._body, *(one.body for one in heard.values())]
        slowest = min(body.v_max for body in bodies)
        least = max(body.least for body in bodies)
        most = max(RESERVE * slowest, least)
        pace = LEADING * slowest if self._speed is None else self._speed
        v = min(max(pace + self._swing * sin(2.0 * pi * time / self._period), -most), most)
        sharpest = 1.0 / self._body.radius
        if heard:
            apart = SLACK + HEADWAY * min(abs(pace) + abs(self._swing), most)
            line = sum(2.0 * body.reach + apart for body in bodies)
            sharpest = 1.0 / (WIDER * max(*(body.radius for body in bodies), line / (2.0 * pi)))
        curvature = 1.0 / self._radius if self._radius else 0.0
        return v, v * min(max(curvature, -sharpest), sharpest)


class Follower:
    """Follows the robot called `ahead`."""

    def __init__(self, ahead: str, body: Body = DEFAULT_BODY) -> None:
        self.needs = frozenset((ahead,))
        self.data: tuple[float, ...] = ()
        self.spacing: float | None = None
        """Distance to the car ahead along its track, m."""
        self.gap = GAP
        """Distance that it keeps to the car ahead at rest, m."""
        self._ahead, self._body = ahead, body
        self._track: deque[tuple[float, float]] = deque(maxlen=TRACK_MAX)

    @property
    def points(self) -> int:
        """Number of points of the track that are kept."""
        return len(self._track)

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Return the velocities that follow the track."""
        ahead, track = heard[self._ahead], self._track
        if not track:
            track.append((me.x, me.y))
        x, y = track[-1]
        if (apart := hypot(ahead.x - x, ahead.y - y)) >= TRACK_STEP:
            # several points at once if messages were lost; never many, however far away it says it is
            steps = min(int(apart / TRACK_STEP), TRACK_MAX)
            track.extend((x + (ahead.x - x) * n / steps, y + (ahead.y - y) * n / steps) for n in range(1, steps + 1))
        while len(track) > 2 and _nearer(me, track[1], track[0]):
            track.popleft()
        left = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in zip(track, list(track)[1:], strict=False))
        x, y = track[0]
        along = (x - me.x) * cos(me.theta) + (y - me.y) * sin(me.theta)
        tail = hypot(ahead.x - track[-1][0], ahead.y - track[-1][1])
        self.spacing = left + along + tail
        self.gap = self._body.reach + ahead.body.reach + SLACK + self._body.centre - ahead.body.centre
        v = ahead.v + GAP_GAIN * (self.spacing - self.gap - HEADWAY * max(me.v, 0.0))
        v = min(max(v, 0.0), CATCHING_UP * self._body.v_max)
        if v < max(REST_SPEED, self._body.least):
            return 0.0, 0.0
        goal = next((p for p in track if hypot(p[0] - me.x, p[1] - me.y) >= PURSUIT_AHEAD), (ahead.x, ahead.y))
        alpha = wrap_angle(atan2(goal[1] - me.y, goal[0] - me.x) - me.theta)
        curvature = 2.0 * sin(alpha) / max(hypot(goal[0] - me.x, goal[1] - me.y), PURSUIT_AHEAD)
        limit = 1.0 / self._body.radius
        return v, v * min(max(curvature, -limit), limit)


def _nearer(me: Said, a: tuple[float, float], b: tuple[float, float]) -> bool:
    return hypot(a[0] - me.x, a[1] - me.y) <= hypot(b[0] - me.x, b[1] - me.y)
