"""The search for the floor of a world (`txt1.learning.best_time`).

For each start plans "a for m decisions, b for n, then c" are driven through the simulated vehicle, its loops and its
encoders, without noise; the floor is the earliest decision at which one of them has the goal.

The search is over these plans, so the floor is a time that can be reached; nothing can be quicker than the geometric
optimum (`txt1.model.optimal`), and `gap` tells how much a third piece still brought: what further pieces would bring is
a fraction of that.
"""

from collections.abc import Sequence
from functools import partial
from math import cos, pi, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.learners.lockstep import Loops, Wheels, loops_of, wheels_of
from txt1.config import Config
from txt1.learning.batch import OUTPUT, PHASE, ROWS, TICK_MS, control, encode, only_ours
from txt1.learning.best_time import BEARINGS, DECISION_MS, Floor
from txt1.learning.modelled import FLOOR, refuse_others
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import Task, task_of
from txt1.sim.batch import LEFT, RIGHT, Array, X, Y, compiled, move, powered
from txt1.sim.dynamics import Dynamics, dynamics

TICKS: Final = DECISION_MS // TICK_MS

Pieces = tuple[int, int, int, int, int]  # action a for m decisions, b for n, then c


@partial(compiled, nogil=True)
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

    Infinite: it never has. `late`: in ticks.
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
                given[i] = commands[action]
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
                away, step = np.hypot(robots[X, i] - light[0], robots[Y, i] - light[1]), 1.0
                if away <= goal:
                    step -= (goal - away) / max(before[i] - away, 1e-12)
                    arrived[i] = (tick - 1 + step) * dt
                    left -= 1
                way[i] += step * np.hypot(robots[X, i] - was[X, i], robots[Y, i] - was[Y, i])
                before[i] = away
        if left == 0:
            break
    return arrived, way


def floor_of(config: Config) -> Floor:
    """Search for the floor of a world; seconds with numba."""
    only_ours(config)
    refuse_others(config, FLOOR, "floors")
    task = task_of(config)
    commands = config.section(LearningConfig).actions
    actions = len(commands)
    # decisions for the quickest circle, which is no sharper than the car can turn, and for the way at the slowest speed
    decision = 0.001 * DECISION_MS
    rates = [min(abs(omega), abs(v) / config.geometry.radius_min) for v, omega in commands if v and omega]
    turn = int(2.0 * pi / max(rates, default=1.0) / decision)
    horizon = turn + int(task.start_radius / (min((abs(v) for v, _ in commands if v), default=1e-3) * decision)) + 20
    switches = [m for m in range(turn) if m < 6 or m % 2 == 0]
    two = [(a, m, b, 0, b) for a in range(actions) for m in switches for b in range(actions) if (b != a) == (m > 0)]
    times, ways, gaps = [], [], []
    for bearing in np.arange(BEARINGS) * (2.0 * pi / BEARINGS) - pi:
        best, reached, way = _best(config, task, float(bearing), two, horizon)
        near = range(max(0, best[1] - 3), best[1] + 4)
        rest = max(0, int(reached * 10.0) - best[1]) if np.isfinite(reached) else turn
        three = [
            (best[0], m, b, n, c)
            for m in near
            for b in range(actions)
            for n in range(1, rest, 2)
            for c in range(actions)
            if c != b
        ]
        if three:
            _, finer, other = _best(config, task, float(bearing), three, horizon)
            if np.isfinite(reached):
                gaps.append(max(0.0, reached - finer) / reached)
            reached, way = min((reached, way), (finer, other))
        times.append(reached)
        ways.append(way)
    return Floor(tuple(times), float(np.mean(gaps)) if gaps else 0.0, tuple(ways))


def _best(
    config: Config, task: Task, bearing: float, plans: Sequence[Pieces], horizon: int
) -> tuple[Pieces, float, float]:
    """The quickest of some plans, the time at which it has the goal, s, and the way, m."""
    robots = np.zeros((ROWS, len(plans)))
    robots[PHASE : PHASE + 2] = 0.5
    light = np.array([task.start_radius * cos(bearing), task.start_radius * sin(bearing)])
    arrived, ways = _drive(
        robots,
        np.array(plans),
        np.array(config.section(LearningConfig).actions),
        round(task.delay * 1000.0 / TICK_MS),
        horizon,
        light,
        task.goal_radius,
        dynamics(powered(config.sim.vehicle, config.sim.battery), config.geometry),
        loops_of(config),
        wheels_of(config),
    )
    k = int(arrived.argmin())
    return plans[k], float(arrived[k]), float(ways[k])
