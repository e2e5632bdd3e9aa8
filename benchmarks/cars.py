"""Cars on paper, for cooperation over many hours: kinematics with R_min and a speed that follows with a lag.

They drive by the very laws of `txt1.fleet`, 20 steps a second, and hear one another one step late. What is left out:
the velocity loops, encoders, batteries, the floor's drag and the safety gate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations
from math import atan2, exp, hypot
from typing import Final

from txt1.fleet.law import Law
from txt1.fleet.radio import Pose, Said
from txt1.model.kinematics import move_along_arc
from txt1.sim.obstacles import gap
from txt1.sim.parameters import Box

STEP: Final = 0.05  # s
LAG: Final = 0.35  # s, of the speed behind its set-point: loop and motors of the simulated vehicle
CURVATURE_MAX: Final = 1.0 / 0.56  # 1/m
LENGTH: Final = 0.510  # m
WIDTH: Final = 0.385  # m
_LEFT: Final = exp(-STEP / LAG)

Hears = Callable[[float, str, str], bool]


class Cars:
    """Cars that cooperate: their poses, speeds and laws by name; `hears(time, one, other)` says who is heard."""

    def __init__(
        self,
        starts: Mapping[str, Pose],
        laws: Mapping[str, Law],
        hears: Hears = lambda time, one, other: True,
        light: tuple[float, float, float] | None = None,
    ) -> None:
        self.time = 0.0
        self.said = {name: Said(*pose) for name, pose in starts.items()}
        self.laws = laws
        self.lost: set[str] = set()
        """Those who have fallen silent; they go on as they were told last."""
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
                self._asked[name] = law.step(before[name], heard, self._seen(before[name]))
        self.time += STEP
        for name, (v, omega) in self._asked.items():
            x, y, theta, speed, _, _, _ = self.said[name]
            curvature = min(max(omega / v if v else 0.0, -CURVATURE_MAX), CURVATURE_MAX)
            after = v + (speed - v) * _LEFT
            pose = move_along_arc(x, y, theta, 0.5 * (speed + after) * STEP, curvature, 0.0)
            self.said[name] = Said(*pose, after, curvature * after, self.time, self.laws[name].data)

    def touching(self) -> list[tuple[str, str]]:
        """Those whose bodies overlap."""
        near = [(a, b) for a, b in combinations(self.said, 2) if self._centres(a, b) < 0.64]
        return [(a, b) for a, b in near if gap(_body(self.said[a]), _body(self.said[b])) < 0.0]

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


def _body(said: Said) -> Box:
    return Box(x=said.x, y=said.y, theta=said.theta, length=LENGTH, width=WIDTH)


def in_line(names: Sequence[str], spacing: float) -> dict[str, Pose]:
    """Starts behind one another along x, the first in front; m."""
    return {name: (-spacing * number, 0.0, 0.0) for number, name in enumerate(names)}
