"""How a car drives to a point, and finds a way out when it is blocked.

Avoiding other cars and walls is the guard's work (`txt1.fleet.guard`), not done here. A car that wants to drive and
does not move drives away at random for a while, and then to some other point first. This is no proof against a
deadlock.
"""

from math import atan2, copysign, cos, hypot, sin
from typing import Final

import numpy as np

from txt1.fleet.body import Body
from txt1.fleet.guard import WALL
from txt1.fleet.radio import Said
from txt1.model.kinematics import wrap_angle

# steps without motion after which a car is blocked
BLOCKED: Final = 20
# m/s, and rad/s: slower is no motion
NO_MOTION: Final = 0.03
# m; largest distance of the other point along x and along y
DETOUR: Final = 3.0
# m from where the guard stops a car; within it, only a car along the wall moves on
NEAR_BORDER: Final = 0.2


def border(side: float, body: Body) -> float:
    """Largest distance from the middle of a room's side to which a car may be sent, m."""
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
    """Return the velocities on the arc that leads to a point, forward or back, m/s and rad/s.

    No arc leads to a point within the turning circle. Then the car drives away from the point and turns towards the arc
    that leads back to it, as in a three-point turn. `room` chooses the direction by its sign; with 0 it is away from
    the point. A car that turns in place does so instead.
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
    """Drives a car to points. A blocked car drives away at random, and then to some other point first.

    `seed` decides the chance; `room` is length and width in m, None if there are no walls.
    """

    def __init__(self, seed: int, body: Body, room: tuple[float, float] | None = None) -> None:
        self._rng = np.random.default_rng(seed)
        self._body, self._room = body, room
        self._still = 0
        # direction in which it makes room, 1 or -1; 0 if it does not
        self._making_room = 0.0
        # steps left of driving away, m/s, rad/s
        self._out = 0, 0.0, 0.0
        # steps left of going to another point, m
        self._detour = 0, 0.0, 0.0

    @property
    def blocked(self) -> bool:
        """Whether it is on a way out of a blockage."""
        return self._out[0] > 0 or self._detour[0] > 0

    def steer(self, me: Said, x: float, y: float, speed: float) -> tuple[float, float]:
        """Return velocities towards a point, m/s and rad/s."""
        left, there_x, there_y = self._detour
        if left > 0:
            x, y, self._detour = there_x, there_y, (left - 1, there_x, there_y)
        x, y = inside(x, y, self._body, self._room)
        v, omega = self._toward(me, x, y, speed)
        left, out_v, out_omega = self._out
        if left > 0:
            v, omega, self._out = out_v, out_omega, (left - 1, out_v, out_omega)
        self._still = self._still + 1 if max(abs(me.v), abs(me.omega)) < NO_MOTION else 0
        if self._still > BLOCKED:
            self.detour(me, v)
        return v, omega

    def detour(self, me: Said, v: float) -> None:
        """Drive away from v, m/s, at random for a while, and then to some other point first."""
        self._still, (ahead, side, turn) = 0, self._rng.uniform(-1.0, 1.0, 3)
        back = -v or self._body.speed(0.0, 0.2)
        self._out = int(self._rng.integers(10, 60)), back, float(turn) * abs(back) / self._body.radius
        there = inside(me.x + DETOUR * float(ahead), me.y + DETOUR * float(side), self._body, self._room)
        self._detour = int(self._rng.integers(40, 160)), *there

    def _toward(self, me: Said, x: float, y: float, speed: float) -> tuple[float, float]:
        """As `toward`, but keep making room in one direction until there is enough and some more."""
        if not within(me, x, y, self._body, 1.4 if self._making_room else 1.0):
            self._making_room = 0.0
        v, omega = toward(me, x, y, self._body.speed(0.0, speed), self._body, self._making_room)
        if v and (self._making_room or within(me, x, y, self._body)):
            self._making_room = copysign(1.0, v)
        return v, omega
