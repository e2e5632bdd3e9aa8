"""Searching the light together: all cover the floor until one robot sees the light; then all drive there.

A robot sees the light when its sensors read more than `SEEN_LUX`. It then tells its estimate of the light's place:
along the measured bearing, at the distance that an inverse-square law gives for a lamp of known strength. The others
believe the brightest report that they have heard (source seeking by shared measurements, after P. Ogren, E. Fiorelli
and N. E. Leonard, "Cooperative control of mobile sensor networks", IEEE TAC 49, 2004, with one report, no gradient).

There is not enough room at the light for all robots. So a robot stands farther away by half a body for each robot that
is nearer to the light. Robots that come from the same side would block each other on the way. So a robot also stops
when it reaches another robot that stands by these rules.

Limits: there is one light, and all robots report truly.
"""

from collections.abc import Iterable, Mapping
from math import cos, hypot, sin, sqrt
from typing import Final

from txt1.fleet.body import DEFAULT_BODY, Body
from txt1.fleet.coverage import Coverage
from txt1.fleet.guard import ROBOT_MARGIN
from txt1.fleet.radio import Said
from txt1.fleet.steering import Helmsman, inside

# lux: with the lamp of 135 lux at 1 m that is 2.1 m away
SEEN_LUX: Final = 30.0
LAMP_LUX: Final = 135.0  # lux at 1 m
# m from the light, the goal of the thesis's episodes
FOUND: Final = 0.5
# of the top speed; 0.3 m/s for the TXT-1
SPEED_SHARE: Final = 0.2
# m beyond the guard's margin at which a robot has reached another
UP_TO: Final = 0.15


class Search:
    """One robot's part; `speed` in m/s, None: a share of its top speed; a light of at least `sees` lux is seen."""

    def __init__(
        self,
        name: str,
        team: list[str],
        room: tuple[float, float],
        speed: float | None = None,
        sees: float = SEEN_LUX,
        body: Body = DEFAULT_BODY,
    ) -> None:
        self._speed, self._sees = body.speed(SPEED_SHARE, speed), sees
        self._cover = Coverage(name, team, room, self._speed, body)
        self.needs = self._cover.needs
        self._body, self._room = body, room
        self._helmsman = Helmsman(sorted(team).index(name), body, room)
        # the brightest report: lux, and the light's place, m
        self._told: tuple[float, float, float] | None = None

    @property
    def data(self) -> tuple[float, ...]:
        """The brightest report: lux, and the light's place, m."""
        return self._told or ()

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Cover the floor, or drive to the reported light."""
        if light is not None and light[0] >= self._sees and (self._told is None or light[0] > self._told[0]):
            away, bearing = sqrt(LAMP_LUX / light[0]), me.theta + light[1]
            self._told = light[0], me.x + away * cos(bearing), me.y + away * sin(bearing)
        for other in heard.values():
            if len(other.data) == 3 and (self._told is None or other.data[0] > self._told[0]):
                self._told = other.data[0], other.data[1], other.data[2]
        if self._told is None:
            return self._cover.step(me, heard, light)
        x, y = inside(*self._told[1:], self._body, self._room)
        if any(one is me for one in _there((me, *heard.values()), x, y)):
            return 0.0, 0.0
        return self._helmsman.steer(me, x, y, self._speed)


def _there(robots: Iterable[Said], x: float, y: float) -> list[Said]:
    """Return the robots that have a place around the light at x and y, m; the nearest come first."""
    there: list[Said] = []
    widest = 0.0
    for nearer, one in enumerate(sorted(robots, key=lambda one: hypot(x - one.x, y - one.y))):
        room = 0.8 * FOUND + 0.5 * (widest + one.body.reach + ROBOT_MARGIN) * nearer
        if hypot(x - one.x, y - one.y) < room or any(_apart(one, other) < ROBOT_MARGIN + UP_TO for other in there):
            there.append(one)
        widest = max(widest, one.body.reach)
    return there


def _apart(one: Said, other: Said) -> float:
    """Return the room between the circles of two bodies, m."""
    (x, y), (other_x, other_y) = (
        (each.x + each.body.centre * cos(each.theta), each.y + each.body.centre * sin(each.theta))
        for each in (one, other)
    )
    return hypot(x - other_x, y - other_y) - one.body.reach - other.body.reach
