"""Coverage: robots visit the whole floor again and again and touch neither one another nor a wall.

Each keeps, for every square of the floor, when somebody of the team was last near it, and drives to the square whose
age is worth the way best: age / (way + a turn), less where another robot is nearer (after the idleness of patrolling,
Y. Chevaleyre, "Theoretical analysis of the multi-agent patrolling problem", IAT 2004). Avoidance is of
`txt1.fleet.steering`.

Limits: a square counts as visited when a robot's centre is within 0.5 m; the room has four walls and nothing in it.
Avoidance goes by the poses that robots tell, so odometry's drift eats up its margin in the end.
"""

from collections.abc import Mapping
from math import cos, hypot, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.fleet.radio import Said
from txt1.fleet.steering import DEFAULT_BODY, Body, Helmsman

SQUARE: Final = 0.25  # m, side of a square
SEEN: Final = 0.5  # m from a robot's centre, within which a square is visited
TURN: Final = 1.0  # m that a target costs at least
BEHIND: Final = 2.0  # m that it costs more to drive back
WITHIN: Final = 4.0  # m that it costs more to make room first
REACHED: Final = 0.3  # m
TARGET_STEPS: Final = 300  # steps for one target
LOOK: Final = 5  # steps between two looks at who is where; nobody comes further than 0.1 m meanwhile


class Coverage:
    """One robot's part; `speed` in m/s. It cannot do without any of the team: who is not heard cannot be avoided."""

    def __init__(
        self, name: str, team: list[str], room: tuple[float, float], speed: float = 0.4, body: Body = DEFAULT_BODY
    ) -> None:
        self.needs = frozenset(team) - {name}
        self.data: tuple[float, ...] = ()
        self._room, self._speed, self._body = room, speed, body
        xs, ys = (np.arange(-0.5 * side + 0.5 * SQUARE, 0.5 * side, SQUARE) for side in room)
        self._x, self._y = np.meshgrid(xs, ys, indexing="ij")
        self.visited: NDArray[np.float64] = np.full(self._x.shape, -np.inf)
        """When each square was visited last, s of the listener; -inf: never."""
        self._goal: tuple[float, float] | None = None
        self._steps = 0
        self._looked = 0  # steps until the next look
        self._helmsman = Helmsman(sorted(team).index(name), body, room)

    def share(self, now: float, within: float) -> float:
        """Share of the floor that was visited within so many s."""
        return float((self.visited >= now - within).mean())

    def step(self, me: Said, heard: Mapping[str, Said], light: tuple[float, float] | None) -> tuple[float, float]:
        """Towards what was not visited for longest, at the speed that is allowed."""
        self._looked -= 1
        if self._looked < 0:
            self._looked = LOOK - 1
            for one in (me, *heard.values()):
                self._visit(one, me.time)
        goal = self._goal
        if goal is None or hypot(goal[0] - me.x, goal[1] - me.y) < REACHED or self._steps > TARGET_STEPS:
            goal, self._steps = self._choose(me, heard), 0
        self._goal, self._steps = goal, self._steps + 1
        return self._helmsman.steer(me, *goal, self._speed, heard.values())

    def _visit(self, one: Said, now: float) -> None:
        low_x, low_y = (
            int((at + 0.5 * side - SEEN) / SQUARE) for at, side in zip((one.x, one.y), self._room, strict=True)
        )
        n = int(2.0 * SEEN / SQUARE) + 2
        area = np.s_[max(low_x, 0) : low_x + n, max(low_y, 0) : low_y + n]
        near = (self._x[area] - one.x) ** 2 + (self._y[area] - one.y) ** 2 <= SEEN * SEEN
        self.visited[area][near] = now

    def _choose(self, me: Said, heard: Mapping[str, Said]) -> tuple[float, float]:
        age = np.minimum(me.time - self.visited, 1e4)
        dx, dy = self._x - me.x, self._y - me.y
        way = np.hypot(dx, dy)
        ahead, side = dx * cos(me.theta) + dy * sin(me.theta), dy * cos(me.theta) - dx * sin(me.theta)
        within = way * way < 2.0 * self._body.radius * abs(side)  # a turning circle: not to be reached on one arc
        worth = age / (way + TURN + BEHIND * (ahead < 0.0) + WITHIN * within)
        for other in heard.values():
            worth[np.hypot(self._x - other.x, self._y - other.y) < way] *= 0.3
        best = np.unravel_index(int(worth.argmax()), worth.shape)
        borders = (0.5 * side - self._body.clear - 0.02 for side in self._room)
        x, y = (min(max(float(at[best]), -b), b) for at, b in zip((self._x, self._y), borders, strict=True))
        return x, y
