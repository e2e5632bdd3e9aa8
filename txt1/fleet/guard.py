"""The guard of a team: it lets no law drive a car into another car or into a wall.

A law proposes a velocity (v, omega), and the guard lets a share of it through, from all to nothing. The path keeps its
curvature, so every car can drive the result, whether it steers or turns in place.

**Barrier.** The guard looks at where the cars would come to rest if all of them let go now. A car's speed decays with
the time constant `BODY_LAG`. So its body's centre p would come to rest at q = p + BODY_LAG v e, with e the direction in
which it looks. Then q moves as the command says, whatever the speed was:

    dq/dt = v e + (c + BODY_LAG v_now) omega e',      e' = e turned left, c the centre's distance ahead of the pose.

While two cars decay, the vector from one to the other goes straight from p_i - p_j to q_i - q_j. The smallest length of
it, d, is reached at a share s of that way, in direction n. The barrier is h = d - D, with D the circles of both bodies
and a margin. As dh/dt = s n (dq_i/dt - dq_j/dt) with s <= 1, each car keeps

    -n dq_i/dt <= CLOSING_RATE h,

by itself and without asking the other. (With s on the left, cars that are hardly moving apart would be allowed
anything.) So h shrinks by twice this rate at most, and never becomes negative. To stand is always allowed, and safe as
long as the others keep the rule or stand. A wall does not move: its h is the distance that is left between it and the
body's circle, at p or at q. A car whose last message is old counts as nearer by the distance that it may have driven
since.

This is a control barrier function whose backup is to brake (E. Squires, P. Pierpaoli and M. Egerstedt, "Constructive
barrier certificates with applications to fixed-wing aircraft collision avoidance", IEEE CCTA 2018), of which each car
keeps its part by itself (L. Wang, A. D. Ames and M. Egerstedt, "Safety barrier certificates for collisions-free
multirobot systems", IEEE T-RO 33, 2017). It looks along the relative motion, as velocity obstacles do (P. Fiorini and
Z. Shiller, IJRR 17, 1998).

Limits: the guard knows the four walls and the robots that it hears, and no obstacles. `BODY_LAG` and the margin are the
same for all cars; both have to be larger for a car that brakes more slowly. Steering lags too, and the margin has to
cover it. The guard never swerves: a blocked car has to find its own way out (`txt1.fleet.steering`).
"""

from collections.abc import Iterator, Mapping
from math import cos, hypot, sin
from typing import Final

from txt1.fleet.body import Body
from txt1.fleet.radio import Said

# s; the vehicles that come with the package roll on for 0.05 to 0.46 s times their speed
BODY_LAG: Final = 0.5
# 1/s
CLOSING_RATE: Final = 1.2
# m between two circles, for steering's lag and late hearing
ROBOT_MARGIN: Final = 0.12
# m between a circle and a wall
WALL: Final = 0.08

# length and width, m
Room = tuple[float, float]


class TeamGuard:
    """One car's guard; `room` is None if there are no walls."""

    def __init__(self, body: Body, room: Room | None = None) -> None:
        self.by = ""
        """The strongest limit on the car at present: a robot's name or "a wall"; "" for none."""
        self._body, self._room = body, room

    def step(self, me: Said, heard: Mapping[str, Said], v: float, omega: float) -> tuple[float, float]:
        """Return the part of a velocity that is safe to drive, m/s and rad/s."""
        share, self.by = 1.0, ""
        ex, ey = cos(me.theta), sin(me.theta)
        ahead = self._body.centre + BODY_LAG * me.v
        go = v * ex - ahead * omega * ey, v * ey + ahead * omega * ex
        for name, closing, room in (*self._to_others(me, heard, go), *self._to_walls(me, go)):
            allowed = CLOSING_RATE * max(room, 0.0)
            if closing > allowed and allowed / closing < share:
                share, self.by = allowed / closing, name
        if abs(share * v) < self._body.least and v:
            share = 0.0
        return share * v, share * omega

    def _to_others(
        self, me: Said, heard: Mapping[str, Said], go: tuple[float, float]
    ) -> Iterator[tuple[str, float, float]]:
        """Yield each robot that the car approaches: its name, the closing speed (m/s), and the room left (m)."""
        px, py, qx, qy = _decay(me, self._body)
        for name, other in heard.items():
            other_px, other_py, other_qx, other_qy = _decay(other, other.body)
            x, y = px - other_px, py - other_py
            along_x, along_y = qx - other_qx - x, qy - other_qy - y
            way = along_x * along_x + along_y * along_y
            s = min(max(-(x * along_x + y * along_y) / way, 0.0), 1.0) if way > 1e-9 else 1.0
            x, y = x + s * along_x, y + s * along_y
            distance = max(hypot(x, y), 1e-6)
            late = max(me.time - other.time, 0.0) * abs(other.v)
            closing = -(x * go[0] + y * go[1]) / distance
            yield name, closing, distance - self._body.reach - other.body.reach - ROBOT_MARGIN - late

    def _to_walls(self, me: Said, go: tuple[float, float]) -> Iterator[tuple[str, float, float]]:
        """Yield the walls that the car approaches, in the same form."""
        if self._room is None:
            return
        clear = self._body.reach + WALL
        places = _decay(me, self._body)
        for axis, side in enumerate(self._room):
            for sign in (1.0, -1.0):
                nearest = max(sign * places[axis], sign * places[axis + 2])
                yield "a wall", sign * go[axis], 0.5 * side - clear - nearest


def _decay(one: Said, body: Body) -> tuple[float, float, float, float]:
    """Return a body's centre now, and the point where it would come to rest: x and y, m."""
    ex, ey = cos(one.theta), sin(one.theta)
    x, y, on = one.x + body.centre * ex, one.y + body.centre * ey, BODY_LAG * one.v
    return x, y, x + on * ex, y + on * ey
