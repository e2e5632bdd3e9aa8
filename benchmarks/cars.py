"""Cars on paper, for cooperation over many hours: kinematics with R_min and a speed that follows with a lag.

They drive by the very laws and guard of `txt1.fleet`, 20 steps a second, and hear one another one step late; each is
a TXT-1, or of the vehicles' files. What is left out: the velocity loops, encoders, batteries, the floor's drag and the
safety gate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from math import atan2, cos, exp, hypot, sin
from typing import Final, NamedTuple

from txt1.config import load
from txt1.fleet.body import Body
from txt1.fleet.cooperation import body_of
from txt1.fleet.guard import Room, TeamGuard
from txt1.fleet.law import Law
from txt1.fleet.radio import Pose, Said
from txt1.model.kinematics import move_along_arc
from txt1.sim.obstacles import gap
from txt1.sim.parameters import Box

STEP: Final = 0.05  # s
LAG: Final = 0.35  # s, of the speed behind its set-point: loop and motors of the simulated vehicle
_LEFT: Final = exp(-STEP / LAG)


class CarShape(NamedTuple):
    """A kind of car: what the others know of it, and its body's length and width, m."""

    body: Body
    length: float
    width: float


def shape_of(vehicle: str) -> CarShape:
    """Return a vehicle's shape, by the name of its file."""
    config = load(None, [f"vehicle={vehicle}"], {}, {}).config
    return CarShape(body_of(config), config.geometry.length, config.geometry.width)


TXT1: Final = shape_of("txt1")

Hears = Callable[[float, str, str], bool]


class Cars:
    """Cars that cooperate: their poses, speeds and laws by name; `hears(time, one, other)` says who is heard."""

    def __init__(
        self,
        starts: Mapping[str, Pose],
        laws: Mapping[str, Law],
        hears: Hears = lambda time, one, other: True,
        light: tuple[float, float, float] | None = None,
        room: Room | None = None,
        shapes: Mapping[str, CarShape] | None = None,
    ) -> None:
        self.time = 0.0
        self.shapes = dict(shapes or dict.fromkeys(starts, TXT1))
        self.said = {name: Said(*pose, body=self.shapes[name].body) for name, pose in starts.items()}
        self.laws = laws
        self.guards = {name: TeamGuard(shape.body, room) for name, shape in self.shapes.items()}
        self.room = room
        self.lost: set[str] = set()
        """Those who have fallen silent; they go on as they were told last."""
        self.wants: set[str] = set()
        """Those whose laws want to drive."""
        self._hears, self._light = hears, light
        self._asked: dict[str, tuple[float, float]] = dict.fromkeys(starts, (0.0, 0.0))

    def run(self, duration: float) -> Iterator[float]:
        """The time after every step."""
        for _ in range(round(duration / STEP)):
            self.step()
            yield self.time

    def step(self) -> None:
        """Let all hear, decide and move."""
        before = dict(self.said)
        for name, law in self.laws.items():
            heard = {
                other: said
                for other, said in before.items()
                if other != name and other not in self.lost and self._hears(self.time, name, other)
            }
            if law.needs - heard.keys():
                self._asked[name] = 0.0, 0.0
            elif name not in self.lost:
                me = before[name]
                wanted = law.step(me, heard, self._seen(me))
                (self.wants.add if wanted != (0.0, 0.0) else self.wants.discard)(name)
                self._asked[name] = self.guards[name].step(me, heard, *wanted)
        self.time += STEP
        for name, (v, omega) in self._asked.items():
            x, y, theta, speed = self.said[name][:4]
            body = self.said[name].body
            sharpest = 1.0 / body.radius
            curvature = min(max(omega / v if v else 0.0, -sharpest), sharpest)
            after = v + (speed - v) * _LEFT
            pose = move_along_arc(x, y, theta, 0.5 * (speed + after) * STEP, curvature, 0.0)
            turned = omega if body.pivots and v == 0.0 else curvature * after
            if body.pivots and v == 0.0:
                pose = pose[0], pose[1], pose[2] + omega * STEP
            self.said[name] = Said(*pose, after, turned, self.time, self.laws[name].data, body)

    def touching(self) -> list[tuple[str, str]]:
        """Those whose bodies overlap, and those that stick in a wall."""
        near = [(a, b) for a, b in combinations(self.said, 2) if self._centres(a, b) < 1.5]
        walls = [] if self.room is None else [(name, "a wall") for name in self.said if self._in_wall(name, self.room)]
        return [(a, b) for a, b in near if gap(self._box(a), self._box(b)) < 0.0] + walls

    def _box(self, name: str) -> Box:
        said, shape = self.said[name], self.shapes[name]
        on = shape.body.centre
        x, y = said.x + on * cos(said.theta), said.y + on * sin(said.theta)
        return Box(x=x, y=y, theta=said.theta, length=shape.length, width=shape.width)

    def _in_wall(self, name: str, room: Room) -> bool:
        box = self._box(name)
        c, s = abs(cos(box.theta)), abs(sin(box.theta))
        half_x, half_y = 0.5 * (c * box.length + s * box.width), 0.5 * (s * box.length + c * box.width)
        return abs(box.x) + half_x > 0.5 * room[0] or abs(box.y) + half_y > 0.5 * room[1]

    def nearest(self) -> float:
        """The smallest distance between two centres, m."""
        return min(self._centres(a, b) for a, b in combinations(self.said, 2))

    def _centres(self, a: str, b: str) -> float:
        return hypot(self.said[a].x - self.said[b].x, self.said[a].y - self.said[b].y)

    def _seen(self, me: Said) -> tuple[float, float] | None:
        if self._light is None:
            return None
        lux, x, y = self._light
        dx, dy = x - me.x, y - me.y
        return lux / max(dx * dx + dy * dy, 1e-4), atan2(dy, dx) - me.theta


def in_line(names: Sequence[str], spacing: float) -> dict[str, Pose]:
    """Starts behind one another along x, the first in front; m."""
    return {name: (-spacing * number, 0.0, 0.0) for number, name in enumerate(names)}
