"""Coverage: robots visit the whole floor again and again, and touch neither one another nor a wall.

Each robot keeps, for every square of the floor, the time at which a robot of the team was last near it. It drives to
the square with the best age for the way: age / (way + a turn), and avoids squares to which another robot is nearer
(after the idleness of patrolling, Y. Chevaleyre, "Theoretical analysis of the multi-agent patrolling problem", IAT
2004). The guard keeps it clear of the others and of the walls (`txt1.fleet.guard`).

Limits: a square counts as visited when a robot is within 0.5 m, or as near to a corner as it can come. The room has
four walls and nothing in it.
"""

from collections.abc import Mapping
from math import cos, hypot, sin, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.fleet.body import DEFAULT_BODY, Body
from txt1.fleet.guard import WALL
from txt1.fleet.radio import Said
from txt1.fleet.steering import NEAR_BORDER, Helmsman, inside

# m, side of a square
SQUARE: Final = 0.25
# m from a robot's pose; squares within it are visited
VISITED_RADIUS: Final = 0.5
# of the top speed; 0.4 m/s for the TXT-1
SPEED_SHARE: Final = 4.0 / 15.0
# m added to the way to every target
TARGET_COST: Final = 1.0
# m added to the way to a target behind the car
BEHIND_COST: Final = 2.0
# m added to the way if the car has to make room first
MAKE_ROOM_COST: Final = 4.0
TARGET_REACHED: Final = 0.3  # m
# largest number of steps for one target
TARGET_STEPS: Final = 300
# steps between two updates of the robots' places; a robot drives at most 0.1 m meanwhile
PLACES_UPDATE_STEPS: Final = 5


class Coverage:
    """One robot's part; `speed` in m/s, None: a share of its top speed.

    It needs to hear all of the team, as it cannot avoid a silent robot.
    """

    def __init__(
        self,
        name: str,
        team: list[str],
        room: tuple[float, float],
        speed: float | None = None,
        body: Body = DEFAULT_BODY,
    ) -> None:
        self.needs = frozenset(team) - {name}
        self.data: tuple[float, ...] = ()
        self._room, self._speed, self._body = room, body.speed(SPEED_SHARE, speed), body
        corner = sqrt(2.0) * (body.reach + abs(body.centre) + WALL + NEAR_BORDER - 0.5 * SQUARE)
        self._seen = max(VISITED_RADIUS, corner + 0.05)
        xs, ys = (np.arange(-0.5 * side + 0.5 * SQUARE, 0.5 * side, SQUARE) for side in room)
        self._x, self._y = np.meshgrid(xs, ys, indexing="ij")
        self.visited: NDArray[np.float64] = np.full(self._x.shape, -np.inf)
        """Time of the last visit to each square, s of the listener; -inf: never."""
        # time at which each square was given up, or reached as nearly as the walls allow
        self._tried = self.visited.copy()
        self._goal: tuple[float, float] | None = None
        self._square: tuple[int, ...] = 0, 0
        self._steps = 0
        # steps until the next look
        self._looked = 0
        self._helmsman = Helmsman(sorted(team).index(name), body, room)

    def share(self, now: float, within: float) -> float:
        """Share of the floor that was visited within this many s."""
        return float((self.visited >= now - within).mean())

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Drive towards the best square, at the speed that is allowed."""
        self._looked -= 1
        if self._looked < 0:
            self._looked = PLACES_UPDATE_STEPS - 1
            for one in (me, *heard.values()):
                self._visit(one, me.time)
        goal = self._goal
        if goal is None or hypot(goal[0] - me.x, goal[1] - me.y) < TARGET_REACHED or self._steps > TARGET_STEPS:
            if goal is not None:
                self._tried[self._square] = me.time
            goal, self._steps = self._choose(me, heard), 0
        self._goal, self._steps = goal, self._steps + 1
        return self._helmsman.steer(me, *goal, self._speed)

    def _visit(self, one: Said, now: float) -> None:
        low_x, low_y = (
            int((at + 0.5 * side - self._seen) / SQUARE) for at, side in zip((one.x, one.y), self._room, strict=True)
        )
        n = int(2.0 * self._seen / SQUARE) + 2
        area = np.s_[max(low_x, 0) : low_x + n, max(low_y, 0) : low_y + n]
        near = (self._x[area] - one.x) ** 2 + (self._y[area] - one.y) ** 2 <= self._seen * self._seen
        self.visited[area][near] = now

    def _choose(self, me: Said, heard: Mapping[str, Said]) -> tuple[float, float]:
        age = np.minimum(me.time - np.maximum(self.visited, self._tried), 1e4)
        dx, dy = self._x - me.x, self._y - me.y
        way = np.hypot(dx, dy)
        ahead, side = dx * cos(me.theta) + dy * sin(me.theta), dy * cos(me.theta) - dx * sin(me.theta)
        # within a turning circle, so no single arc leads there
        within = way * way < 2.0 * self._body.radius * abs(side)
        worth = age / (way + TARGET_COST + BEHIND_COST * (ahead < 0.0) + MAKE_ROOM_COST * within)
        for other in heard.values():
            worth[np.hypot(self._x - other.x, self._y - other.y) < way] *= 0.3
        self._square = best = tuple(map(int, np.unravel_index(int(worth.argmax()), worth.shape)))
        return inside(float(self._x[best]), float(self._y[best]), self._body, self._room)
