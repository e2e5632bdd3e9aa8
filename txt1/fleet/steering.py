"""How a car comes to a point, and finds a way out where it is blocked.

Nothing here keeps it clear of others and of walls: that is the guard's (`txt1.fleet.guard`). Whoever wants to drive and
does not move drives away by chance for a while, and then to some other point first, which is no proof against a
deadlock.
"""

from math import atan2, copysign, cos, hypot, sin
from typing import Final

import numpy as np

from txt1.fleet.body import Body
from txt1.fleet.guard import WALL
from txt1.fleet.radio import Said
from txt1.model.kinematics import wrap_angle

BLOCKED: Final = 20  # steps without motion after which a car is blocked
STILL: Final = 0.03  # m/s, and rad/s: slower is no motion
DETOUR: Final = 3.0  # m, how far along x and y the other point may be
NEAR_BORDER: Final = 0.2  # m from where the guard stops a car: nearer to it, only a car along the wall would get on


def border(side: float, body: Body) -> float:
    """How far from the middle of a room's side, m, a car's pose may be sent."""
    return max(0.5 * side - body.reach - abs(body.centre) - WALL - NEAR_BORDER, 0.0)


def inside(x: float, y: float, body: Body, room: tuple[float, float] | None) -> tuple[float, float]:
    """The nearest point of a room to which a car may be sent, m."""
    if room is None:
        return x, y
    most_x, most_y = border(room[0], body), border(room[1], body)
    return min(max(x, -most_x), most_x), min(max(y, -most_y), most_y)


def within(me: Said, x: float, y: float, body: Body, room: float = 1.0) -> bool:
    """Whether a point lies within `room` times a turning circle, so that no arc leads there."""
    alpha = atan2(y - me.y, x - me.x) - me.theta
    return hypot(x - me.x, y - me.y) < room * 2.0 * body.radius * abs(sin(alpha))


def toward(me: Said, x: float, y: float, speed: float, body: Body, room: float = 0.0) -> tuple[float, float]:
    """Velocities on the arc that leads to a point, forward or back, m/s and rad/s.

    Where a point lies within a turning circle: away from it, forward or back by the sign of `room` where that is not
    0, and turning meanwhile towards the arc that leads back to it, as in a three-point turn. A car that turns in place
    does so instead.
    """
    distance = hypot(x - me.x, y - me.y)
    alpha = wrap_angle(atan2(y - me.y, x - me.x) - me.theta)
    v = copysign(speed, cos(alpha))
    if body.pivots and within(me, x, y, body):
        return 0.0, copysign(speed / body.radius, v * sin(alpha))
    if room or within(me, x, y, body):
        v = copysign(speed, room or -v)
        return v, copysign(speed / body.radius, -v * sin(alpha))
    return v, v * 2.0 * sin(alpha) / max(distance, 1e-6)


class Helmsman:
    """Drives a car to points: who is blocked drives away by chance, and then to some other point first.

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

    def steer(self, me: Said, x: float, y: float, speed: float) -> tuple[float, float]:
        """Velocities towards a point, m/s and rad/s."""
        left, there_x, there_y = self._detour
        if left > 0:
            x, y, self._detour = there_x, there_y, (left - 1, there_x, there_y)
        x, y = inside(x, y, self._body, self._room)
        v, omega = self._toward(me, x, y, speed)
        left, out_v, out_omega = self._out
        if left > 0:
            v, omega, self._out = out_v, out_omega, (left - 1, out_v, out_omega)
        self._still = self._still + 1 if max(abs(me.v), abs(me.omega)) < STILL else 0
        if self._still > BLOCKED:
            self.detour(me, v)
        return v, omega

    def detour(self, me: Said, v: float) -> None:
        """Drive away by chance for a while, against v, m/s, and then to some other point first."""
        self._still, (ahead, side, turn) = 0, self._rng.uniform(-1.0, 1.0, 3)
        back = -v or self._body.speed(0.0, 0.2)
        self._out = int(self._rng.integers(10, 60)), back, float(turn) * abs(back) / self._body.radius
        there = inside(me.x + DETOUR * float(ahead), me.y + DETOUR * float(side), self._body, self._room)
        self._detour = int(self._rng.integers(40, 160)), *there

    def _toward(self, me: Said, x: float, y: float, speed: float) -> tuple[float, float]:
        """As `toward`; making room goes on in its direction until there is enough and some more."""
        if not within(me, x, y, self._body, 1.4 if self._making_room else 1.0):
            self._making_room = 0.0
        v, omega = toward(me, x, y, self._body.speed(0.0, speed), self._body, self._making_room)
        if v and (self._making_room or within(me, x, y, self._body)):
            self._making_room = copysign(1.0, v)
        return v, omega
