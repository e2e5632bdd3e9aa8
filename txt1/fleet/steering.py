"""How a car that cannot turn on the spot comes to a point, and keeps clear of others and of walls.

Avoidance is reciprocal: of the room between two robots beyond a distance D that is never used up, each may take half.
With n the direction from one to the other and d their distance, each keeps

    v cos(theta - n) <= gamma / 2 (d - D),

so that d - D shrinks at most by the rate gamma and never becomes negative: a control barrier function, each side with
half of the responsibility (U. Borrmann, L. Wang, A. D. Ames and M. Egerstedt, "Control barrier certificates for safe
swarm behavior", IFAC ADHS 2015; reciprocity after J. van den Berg, S. J. Guy, M. Lin and D. Manocha, "Reciprocal n-body
collision avoidance", ISRR 2009; cars after J. Alonso-Mora et al., "Reciprocal collision avoidance for multiple car-like
robots", ICRA 2012). The body is taken for the circle around it, which a turn does not move: only the speed is limited,
the steering is free. A wall gives nothing, so it is granted all: gamma in place of gamma / 2.

Limits: the speed lags by 0.3 s and poses are as old as hearing is late; D has a margin for both. Whoever is blocked
drives away by chance for a while, which is no proof against a deadlock.
"""

from collections.abc import Iterable
from math import atan2, ceil, copysign, cos, hypot, sin
from typing import Final, NamedTuple, Self

import numpy as np

from txt1.control.parameters import Safety
from txt1.fleet.radio import Said
from txt1.model.kinematics import wrap_angle
from txt1.model.vehicle import Geometry

MARGIN: Final = 0.12  # m, for lag and late hearing
GAMMA: Final = 0.9  # 1/s: slower than the speed's own lag by far
BLOCKED: Final = 20  # steps without motion after which a car is blocked
DETOUR: Final = 3.0  # m, how far along x and y the other point may be
WALL: Final = 0.08  # m, the margin to a wall


class Body(NamedTuple):
    """A car among others, which are taken to be as large as itself."""

    radius: float
    """Of its smallest circle, m."""
    v_max: float
    """Fastest, m/s."""
    reach: float
    """Of its corners from its pose, m."""

    @classmethod
    def of(cls, car: Geometry, v_max: float) -> Self:
        """Return the body of a car of these dimensions, its reach in whole centimetres."""
        reach = hypot(0.5 * car.length + abs(car.centre), 0.5 * car.width)
        return cls(car.radius_min, v_max, ceil(100.0 * reach) / 100.0)

    @property
    def apart(self) -> float:
        """D, m."""
        return 2.0 * self.reach + MARGIN

    @property
    def clear(self) -> float:
        """Distance between its centre and a wall, m."""
        return self.reach + WALL


DEFAULT_BODY: Final = Body.of(Geometry(), Safety().v_max)
"""The TXT-1's."""


def within(me: Said, x: float, y: float, body: Body, room: float = 1.0) -> bool:
    """Whether a point lies within `room` times a turning circle, so that no arc leads there."""
    alpha = atan2(y - me.y, x - me.x) - me.theta
    return hypot(x - me.x, y - me.y) < room * 2.0 * body.radius * abs(sin(alpha))


def toward(me: Said, x: float, y: float, speed: float, body: Body, room: float = 0.0) -> tuple[float, float]:
    """Velocities on the arc that leads to a point, forward or back, m/s and rad/s.

    Where a point lies within a turning circle: away from it, forward or back by the sign of `room` where that is not
    0, and turning meanwhile towards the arc that leads back to it, as in a three-point turn.
    """
    distance = hypot(x - me.x, y - me.y)
    alpha = wrap_angle(atan2(y - me.y, x - me.x) - me.theta)
    v = copysign(speed, cos(alpha))
    if room or within(me, x, y, body):
        v = copysign(speed, room or -v)
        return v, copysign(speed / body.radius, -v * sin(alpha))
    return v, v * 2.0 * sin(alpha) / max(distance, 1e-6)


def allowed(me: Said, v: float, others: Iterable[Said], body: Body, room: tuple[float, float] | None = None) -> float:
    """The speed that is left of v, m/s, beside the others and the walls of a room of this length and width, m."""
    x, y = cos(me.theta), sin(me.theta)
    low, high = -body.v_max, body.v_max
    for other in others:
        dx, dy = other.x - me.x, other.y - me.y
        distance = max(hypot(dx, dy), 1e-6)
        low, high = _bounded(low, high, (dx * x + dy * y) / distance, 0.5 * GAMMA * (distance - body.apart))
    if room is not None:
        for side, place, along in ((0.5 * room[0], me.x, x), (0.5 * room[1], me.y, y)):
            low, high = _bounded(low, high, along, GAMMA * (side - body.clear - place))
            low, high = _bounded(low, high, -along, GAMMA * (side - body.clear + place))
    if low > high:
        return 0.0
    return min(max(v, low), high) if low <= 0.0 <= high else 0.0


class Helmsman:
    """Drives a car to points, past others: who is blocked drives away by chance, and then to some other point first.

    `seed` decides the chance, `room` is length and width in m, None where there are no walls.
    """

    def __init__(self, seed: int, body: Body, room: tuple[float, float] | None = None) -> None:
        self._rng = np.random.default_rng(seed)
        self._body, self._room = body, room
        self._still = 0
        self._making_room = 0.0  # its direction, 1 or -1; 0 while it is not
        self._out = 0, 0.0, 0.0  # steps left of driving away, m/s, rad/s
        self._detour = 0, 0.0, 0.0  # steps left of going to another point, m

    @property
    def blocked(self) -> bool:
        """Whether it is on a way out."""
        return self._out[0] > 0 or self._detour[0] > 0

    def steer(self, me: Said, x: float, y: float, speed: float, others: Iterable[Said]) -> tuple[float, float]:
        """Velocities towards a point, m/s and rad/s."""
        others = list(others)
        left, there_x, there_y = self._detour
        if left > 0:
            x, y, self._detour = there_x, there_y, (left - 1, there_x, there_y)
        v, omega = self._toward(me, x, y, speed)
        left, out_v, out_omega = self._out
        if left > 0:
            v, omega, self._out = out_v, out_omega, (left - 1, out_v, out_omega)
        limited = allowed(me, v, others, self._body, self._room)
        self._still = self._still + 1 if abs(limited) < 0.03 else 0
        if self._still > BLOCKED:
            self.detour(me, v)
        return limited, omega * limited / v if v else 0.0

    def detour(self, me: Said, v: float) -> None:
        """Drive away by chance for a while, against v, m/s, and then to some other point first."""
        self._still, (ahead, side, turn) = 0, self._rng.uniform(-1.0, 1.0, 3)
        self._out = int(self._rng.integers(10, 60)), -v, float(turn) * abs(v) / self._body.radius
        steps = int(self._rng.integers(40, 160))
        self._detour = (
            steps,
            self._inside(me.x + DETOUR * float(ahead), 0),
            self._inside(me.y + DETOUR * float(side), 1),
        )

    def _toward(self, me: Said, x: float, y: float, speed: float) -> tuple[float, float]:
        """As `toward`; making room goes on in its direction until there is enough and some more."""
        if not within(me, x, y, self._body, 1.4 if self._making_room else 1.0):
            self._making_room = 0.0
        v, omega = toward(me, x, y, min(speed, self._body.v_max), self._body, self._making_room)
        if self._making_room or within(me, x, y, self._body):
            self._making_room = copysign(1.0, v)
        return v, omega

    def _inside(self, at: float, axis: int) -> float:
        if self._room is None:
            return at
        border = 0.5 * self._room[axis] - self._body.clear - 0.02
        return min(max(at, -border), border)


def _bounded(low: float, high: float, share: float, limit: float) -> tuple[float, float]:
    """The interval of v with ``share * v <= limit``; it always has v = 0 in it."""
    limit = max(limit, 0.0)
    if share > 1e-9:
        return low, min(high, limit / share)
    if share < -1e-9:
        return max(low, limit / share), high
    return low, high
