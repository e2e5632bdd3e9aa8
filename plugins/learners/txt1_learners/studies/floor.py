"""The search for the floor of a world (`txt1.learning.best_time`).

For each start plans "a for m decisions, b for n, then c" are driven through the simulated vehicle, its loops and its
encoders, without noise; the floor is the earliest decision at which one of them has the goal.

The search is over these plans, so the floor is a time that can be reached; nothing can be quicker than the geometric
optimum (`txt1.model.optimal`), and `gap` tells how much a third piece still brought: what further pieces would bring is
a fraction of that.

Where the light moves, the time depends on the place and heading of the start, and is searched for each by itself. Where
a world changes commands on their way, as one that swaps left and right, a plan says what should reach the robot, and
the action that comes nearest to that is taken.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import cos, inf, pi, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config
from txt1.config.sources import with_values
from txt1.errors import ConfigError
from txt1.learning.batch import OUTPUT, PHASE, ROWS, TICK_MS, control, encode, only_ours
from txt1.learning.best_time import DECISION_MS, DRIVEN_BEARINGS, Floor, rounded_up
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import Start, task_of
from txt1.sim.batch import LEFT, RIGHT, Array, X, Y, move, powered
from txt1.sim.dynamics import Dynamics, dynamics
from txt1.sim.machine_code import compiled
from txt1_learners.studies.lockstep import Loops, Wheels, loops_of, wheels_of
from txt1_learners.studies.modelled_settings import FLOOR, refuse_others

TICKS: Final = DECISION_MS // TICK_MS

# decisions in which a world may change commands; after them it does as in the last
CHANGING: Final = 1200
# a command as it reaches the robot at a decision, from 0; m/s and rad/s
Reaching = Callable[[int, tuple[float, float]], tuple[float, float]]

Pieces = tuple[int, int, int, int, int]  # action a for m decisions, b for n, then c


@partial(compiled, nogil=True, cache=True)
def _drive(
    robots: Array,
    plans: NDArray[np.int64],
    commands: Array,
    late: int,
    decisions: int,
    light: Array,
    goal: float,
    p: Dynamics,
    loops: Loops,
    wheels: Wheels,
) -> tuple[Array, Array]:
    """Time at which each robot has the goal, s, and the way until then, m, by its plan (a, m, b, n, c).

    Infinite: it never has. `commands`: what reaches the robot at each decision by each action, shape (decisions,
    actions, 2). `late`: in ticks. `light`: its place at each tick, shape (ticks, 2).
    """
    motor_max, schedule, linear, car, known = loops
    count_length, track_width = wheels
    count = robots.shape[1]
    rolled, target, remaining = robots[:2].copy(), robots[0].copy(), robots[0].copy()
    still, given, arrived = np.zeros(count), np.zeros((count, 2)), np.full(count, np.inf)
    before, way = np.full(count, np.inf), np.zeros(count)
    left = count
    for tick in range(1, decisions * TICKS + 1):
        since = tick - 1 - late
        for i in range(count):
            a, m, b, n, c = plans[i]
            decision = since // TICKS
            if since >= 0:
                action = a if decision < m else b if decision < m + n else c
                given[i] = commands[(tick - 1) // TICKS, action]
        rolled[0], rolled[1] = robots[RIGHT], robots[LEFT]
        was = robots[:2].copy()
        control(
            robots, given, motor_max, schedule, linear, car, known
        )  # as a decision takes effect before the vehicle moves on
        dt = TICK_MS / 1000.0
        move(robots, robots[OUTPUT], robots[OUTPUT + 1], still, dt, p, target, remaining)
        encode(robots, rolled, dt, count_length, track_width)
        for i in range(count):
            if arrived[i] == np.inf:
                away, step = np.hypot(robots[X, i] - light[tick, 0], robots[Y, i] - light[tick, 1]), 1.0
                if away <= goal:
                    step -= (goal - away) / max(before[i] - away, 1e-12)
                    arrived[i] = (tick - 1 + step) * dt
                    left -= 1
                way[i] += step * np.hypot(robots[X, i] - was[X, i], robots[Y, i] - was[Y, i])
                before[i] = away
        if left == 0:
            break
    return arrived, way


class Search:
    """The plans of a world and their drives."""

    def __init__(self, config: Config, reaching: Reaching | None = None) -> None:
        only_ours(config)
        if config.section(LearningConfig).goal_period == 0.001 * DECISION_MS:
            config = with_values(config, {"learning.goal_period": None})
        refuse_others(config, FLOOR, "floors")
        self._config, self.task = config, task_of(config)
        task = self.task
        reach = max(map(abs, task.light)) + task.start_radius + 2.0 * task.radius_min  # a circle, at most
        if task.boundary < reach:
            raise ConfigError(
                f"learning.boundary: {task.boundary:g}: floors do not know it, and their ways may lead outside; set at "
                f"least {reach:g}"
            )
        actions = config.section(LearningConfig).actions
        self._actions = range(len(actions))
        self._commands = np.array([actions])
        if reaching is not None:
            reached = np.array([[reaching(k, each) for each in actions] for k in range(CHANGING)])
            apart = ((self._commands[:, :, None] - reached[:, None]) ** 2).sum(axis=-1)
            self._commands = np.take_along_axis(reached, apart.argmin(axis=-1)[..., None], axis=1)
        # decisions for the quickest circle, which is no sharper than the car can turn, and for the way at the slowest
        # speed
        decision, speeds = 0.001 * DECISION_MS, np.abs(self._commands[..., 0])
        rates = np.minimum(np.abs(self._commands[..., 1]), speeds / config.geometry.radius_min).max(axis=1)
        self._turn = int(2.0 * pi / (rates.min() or 1.0) / decision)
        slowest = speeds[speeds > 0.0].min(initial=inf) if speeds.any() else 1e-3
        self.horizon = self._turn + int(self.task.start_radius / (slowest * decision)) + 20
        switches = [m for m in range(self._turn) if m < 6 or m % 2 == 0]
        self._two = [
            (a, m, b, 0, b) for a in self._actions for m in switches for b in self._actions if (b != a) == (m > 0)
        ]

    def best(self, light: Array) -> tuple[float, float, float]:
        """The least time to the goal, s, and its way, m; the share of the time by which a third piece shortened it.

        `light`: its place at each tick in the frame of the start, shape (ticks, 2), m.
        """
        best, reached, way = self._quickest(light, self._two)
        near = range(max(0, best[1] - 3), best[1] + 4)
        rest = max(0, int(reached * 10.0) - best[1]) if np.isfinite(reached) else self._turn
        three = [
            (best[0], m, b, n, c)
            for m in near
            for b in self._actions
            for n in range(1, rest, 2)
            for c in self._actions
            if c != b
        ]
        gap = np.nan
        if three:
            _, finer, other = self._quickest(light, three)
            if np.isfinite(reached):
                gap = max(0.0, reached - finer) / reached
            reached, way = min((reached, way), (finer, other))
        return reached, way, gap

    def _quickest(self, light: Array, plans: Sequence[Pieces]) -> tuple[Pieces, float, float]:
        """The quickest of some plans, the time at which it has the goal, s, and the way, m."""
        robots = np.zeros((ROWS, len(plans)))
        robots[PHASE : PHASE + 2] = 0.5
        config, decisions = self._config, (len(light) - 1) // TICKS
        arrived, ways = _drive(
            robots,
            np.array(plans),
            self._commands[np.minimum(np.arange(decisions), len(self._commands) - 1)],
            round(self.task.delay * 1000.0 / TICK_MS),
            decisions,
            light,
            self.task.goal_radius,
            dynamics(powered(config.sim.vehicle, config.sim.battery), config.geometry),
            loops_of(config),
            wheels_of(config),
        )
        k = int(arrived.argmin())
        return plans[k], float(arrived[k]), float(ways[k])


def floor_of(config: Config) -> Floor:
    """Search for the floor of a world; seconds with numba."""
    search = Search(config)
    times, ways, gaps = [], [], []
    for bearing in np.arange(DRIVEN_BEARINGS) * (2.0 * pi / DRIVEN_BEARINGS) - pi:
        place = search.task.start_radius * np.array([cos(bearing), sin(bearing)])
        reached, way, gap = search.best(np.tile(place, (search.horizon * TICKS + 1, 1)))
        times.append(reached)
        ways.append(way)
        if np.isfinite(gap):
            gaps.append(gap)
    return Floor(tuple(times), float(np.mean(gaps)) if gaps else 0.0, tuple(ways))


@dataclass
class MovingFloor:
    """The floor of a world in which the light moves, or commands change on their way."""

    config: Config
    goal: Callable[[float], tuple[float, float]]
    """Where the light is so long after the first decision, s; m."""
    reaching: Reaching | None = None
    """None: commands reach the robot as they are."""
    exists: bool = True
    """Whether the goal could be reached from all starts yet."""
    gap: float = 0.0
    """The largest yet by which a third piece of a plan shortened the time, as a share of it."""

    @cached_property
    def _search(self) -> Search:
        return Search(self.config, self.reaching)

    @cached_property
    def _path(self) -> Array:
        # a light that flees at half the speed takes twice as long
        ticks = 2 * self._search.horizon * TICKS
        return np.array([self.goal(0.001 * TICK_MS * k) for k in range(ticks + 1)])

    def time(self, start: Start) -> float:
        """The least time from a start, s, rounded up to a decision; infinite: no plan reaches it in time."""
        x, y, theta = start.pose(self._search.task)
        east, north = (self._path - (x, y)).T
        ahead, left = cos(theta) * east + sin(theta) * north, cos(theta) * north - sin(theta) * east
        reached, _, gap = self._search.best(np.column_stack((ahead, left)))
        self.gap = max(self.gap, 0.0 if np.isnan(gap) else gap)
        self.exists = self.exists and bool(np.isfinite(reached))
        return rounded_up(reached)
