"""A learner that measures how each action turns the robot, and plans with a table by sweeps of value iteration.

It knows its actions only by their indices; see docs/learning.md. At every decision:

    w    <- heading since the last decision / period
    learn c(a), k(a) from (w before, a, w)
    Q(b, w, a) <- cos(b') + gamma max Q(b', w', .),   w' = c(a) + k(a) w,   b' = b - period w'     (some sweeps)
    a    <- argmax Q(b, w, .)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, log, pi, sin
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1 import Odometry
from txt1.config import Config
from txt1.learning.agent import Decision, Learned, Rows, StoredTable
from txt1.learning.light_direction import LightFilter, spread_limit
from txt1.learning.settings import LearningConfig
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import SENSOR_X, SENSOR_Y, Readings
from txt1.sim.lamp import PointLight, illuminances
from txt1.units import NotNegative, Positive, PositiveInt, Share

Array = NDArray[np.float64]

# cells of the bearing, 5 degrees each; the first is centred on straight behind
BEARINGS: Final = 72
# cells of the yaw rate, from -YAW_MAX to YAW_MAX
YAW_RATES: Final = 13
# rad/s; a little more than the sharpest turn
YAW_MAX: Final = 0.6


@dataclass(frozen=True, slots=True)
class SweepsSettings:
    """The hyper-parameters, which `learning.sweeps` sets."""

    # time from one decision to the next, s
    period: Positive = 0.1
    # weight of the past in the direction's average, per sample of 16 ms: half a second
    memory: Share = 0.97
    # discount factor, per decision: 0.97 looks three seconds ahead
    gamma: Share = 0.97
    # decisions in a row for which each action is tried at first
    tries: PositiveInt = 6
    # m/s; slower than this it learns nothing about turning
    moving: NotNegative = 0.2
    # largest number of sweeps after each decision
    sweeps: PositiveInt = 10
    # sweeping ends when every change of a value is smaller
    tolerance: Positive = 1e-3


SETTINGS: Final = SweepsSettings()
# it has thousands of numbers, and its courses show what they come to
TABLE_IS_DRAWN: Final = False


def create(config: Config, rng: np.random.Generator, table: StoredTable | None = None) -> SweepsAgent:
    """Return a learner as configured, or a driver by a stored table; ValueError: the table has another shape."""
    settings = config.section(LearningConfig).part("sweeps", SETTINGS)
    return SweepsAgent(
        rng, settings, float(config.sim.light.exponent), table, len(config.section(LearningConfig).actions)
    )


class TurnModel:
    """The model of turning: w' = c(a) + k(a) w, by least squares over everything seen so far."""

    def __init__(self, actions: int = 3) -> None:
        # per action the sums of 1, w, w^2, w', w w'; the prior says that an action keeps the yaw rate
        self.sums = np.tile([0.0, 0.0, 0.01, 0.0, 0.01], (actions, 1))
        self.count = np.zeros(actions, int)

    def learn(self, a: int, w: float, w_next: float) -> None:
        """Take the result of a decision; yaw rates in rad/s."""
        self.sums[a] += (1.0, w, w * w, w_next, w * w_next)
        self.count[a] += 1

    def rows(self) -> Array:
        """C, k, and the mean and mean square of the yaw rate before, for every action; shape (actions, 4)."""
        n = np.maximum(self.sums[:, 0], 1.0)
        return np.column_stack([*self.coefficients(), self.sums[:, 1] / n, self.sums[:, 2] / n])

    def suppose(self, a: int, row: Array, times: int) -> None:
        """Act as if the action had been seen `times` times, with results that give this row."""
        c, k, mean, square = row
        before, squared = times * mean, times * max(square, mean * mean + 1e-4)
        self.sums[a] = times, before, squared, c * times + k * before, c * before + k * squared
        self.count[a] = times

    def coefficients(self) -> tuple[Array, Array]:
        """C in rad/s and k, for every action."""
        n, w, ww, y, wy = self.sums.T
        n = n + 1e-3
        k = np.clip((n * wy - w * y) / (n * ww - w * w), 0.0, 0.95)
        return (y - k * w) / n, k


class SweepsAgent:
    """The learner; see the module. `exponent` is the light's power of distance; with a `table` it no longer learns."""

    name = "sweeps"

    def __init__(
        self,
        rng: np.random.Generator,
        settings: SweepsSettings = SETTINGS,
        exponent: float = 2.0,
        table: StoredTable | None = None,
        actions: int = 3,
    ) -> None:
        self.settings = settings
        self.q: Array = np.zeros((BEARINGS, YAW_RATES, actions))
        self.model = TurnModel(actions)
        self.episode = 0
        self._rng = rng
        self._untried = [int(a) for a in rng.permutation(actions)]
        self._fitted = 0
        self.converged = True
        self._cells: tuple[Any, ...] = ()
        self._watch = LightFilter(spread=spread_limit(exponent))
        self._frozen = table is not None
        if table is not None:
            self.q = np.array(table.shaped(BEARINGS * YAW_RATES, actions)).reshape(self.q.shape)
            self._untried = []
        self._before = self.memory()
        self.begin()

    def begin(self) -> None:
        """An episode begins."""
        self._watch.clear()
        self._east = self._north = 0.0
        self._a = -1
        self._due = 0.0
        self._theta = 0.0
        self._w = 0.0
        self._learned = False
        self._before = self.memory()

    def see(self, readings: Readings, odometry: Odometry) -> None:
        """One sample of the light, lux."""
        self._watch.step(readings)
        fl, fr, rl, rr = readings
        # dead, as the watch will soon find out
        if fl <= 0.0 or fr <= 0.0 or rl <= 0.0 or rr <= 0.0:
            return
        ahead, left = towards(readings)
        c, s = cos(odometry.theta), sin(odometry.theta)
        past = self.settings.memory
        self._east = past * self._east + (1.0 - past) * (c * ahead - s * left)
        self._north = past * self._north + (1.0 - past) * (s * ahead + c * left)

    @property
    def ready(self) -> bool:
        """Whether the readings have settled."""
        return self._watch.settled

    def bearing(self, odometry: Odometry) -> float:
        """Return the direction of the light, rad."""
        return wrap_angle(atan2(self._north, self._east) - odometry.theta)

    def waits(self, now: float, odometry: Odometry) -> bool:
        """Whether the action in force goes on."""
        del odometry
        return self._a >= 0 and now < self._due - 1e-9

    def act(self, now: float, odometry: Odometry) -> int:
        """Learn from the last action, and choose the next one."""
        self._learned = self._learn(odometry)
        self._a = self._choose(odometry)
        self._due = now + self.settings.period
        return self._a

    def _learn(self, odometry: Odometry) -> bool:
        """Learn the last action's effect on the yaw rate, and sweep; return whether there was something to learn."""
        learns = False
        if self._a >= 0:
            w = wrap_angle(odometry.theta - self._theta) / self.settings.period
            learns = odometry.v > self.settings.moving and not self._frozen
            if learns:
                self.model.learn(self._a, self._w, w)
                self.refit()
                self.sweep()
            self._w = w
        self._theta = odometry.theta
        return learns

    def _choose(self, odometry: Odometry) -> int:
        while self._untried and self.model.count[self._untried[0]] >= self.settings.tries:
            self._untried.pop(0)
        if self._untried:
            return self._untried[0]
        return best_action(self.q, self.bearing(odometry), self._w)

    def end(self, success: bool, odometry: Odometry) -> None:
        """The episode is over."""
        del success
        self._learned = self._learn(odometry)
        self.episode += 1

    def decision(self, odometry: Odometry) -> Decision:
        """The nearest cell of bearing and yaw rate, the progress towards the light, and the cell's values."""
        bearing = self.bearing(odometry)
        i = round((bearing + pi) / (2.0 * pi) * BEARINGS) % BEARINGS
        j = round((min(max(self._w / YAW_MAX, -1.0), 1.0) + 1.0) / 2.0 * (YAW_RATES - 1))
        return Decision(i * YAW_RATES + j, cos(bearing) if self._learned else None, tuple(map(float, self.q[i, j])))

    def void(self) -> None:
        """Forget what was learned since `begin`."""
        self.recall(self._before)

    def refit(self) -> None:
        """Compute where the model leads from every cell, if its data has grown by a tenth since the last time."""
        known = int(self.model.count.sum())
        if self._cells and known < 1.1 * self._fitted:
            return
        self._fitted = known
        self.converged = False
        c, k = self.model.coefficients()
        # at the cells' centres
        bearings = np.arange(BEARINGS, dtype=np.float64) * (2.0 * pi / BEARINGS) - pi
        yaw_rates = np.linspace(-YAW_MAX, YAW_MAX, YAW_RATES, dtype=np.float64)
        w_next = np.clip(c + k * yaw_rates[None, :, None], -YAW_MAX, YAW_MAX)
        b_next = bearings[:, None, None] - self.settings.period * w_next
        i0, i1, fi = _bearing_cells(b_next)
        j0, fj = _yaw_cells(np.broadcast_to(w_next, b_next.shape))
        corners = [
            (i0 * YAW_RATES + j0, (1 - fi) * (1 - fj)),
            (i1 * YAW_RATES + j0, fi * (1 - fj)),
            (i0 * YAW_RATES + j0 + 1, (1 - fi) * fj),
            (i1 * YAW_RATES + j0 + 1, fi * fj),
        ]
        self._cells = (np.cos(b_next), np.stack([i for i, _ in corners]), np.stack([w for _, w in corners]))

    def sweep(self) -> None:
        """Improve the table by the model: value iteration."""
        if self.converged:
            return
        reward, cells, weights = self._cells
        for _ in range(self.settings.sweeps):
            value = self.q.max(axis=2).ravel()
            q = reward + self.settings.gamma * (weights * value[cells]).sum(axis=0)
            change = float(np.abs(q - self.q).max())
            self.q = q
            if change < self.settings.tolerance:
                self.converged = True
                return

    def table(self) -> StoredTable:
        """The Q-table, a row for every bearing and yaw rate, and all that is needed to drive by it."""
        names = [f"action {a}" for a, _ in enumerate(self.model.count)]
        about = {
            "agent": self.name,
            "episodes": self.episode,
            "actions": names,
            "turning": [[float(x) for x in each] for each in self.model.coefficients()],
        }
        return StoredTable(self.q.reshape(-1, self.q.shape[2]).copy(), about)

    def shared(self) -> Learned:
        """A row for each action: how it turns the robot; an action counts as known when it was tried often enough."""
        visits = tuple(count if count >= self.settings.tries else 0 for count in self.model.count.tolist())
        return Learned(self.name, self.episode, visits, tuple(map(tuple, self.model.rows().tolist())))

    def take(self, rows: Rows, taken: Sequence[bool], episodes: int) -> int:
        """Take over the effects of actions that it has not tried often enough itself."""
        del episodes
        new = np.flatnonzero(np.array(taken) & (self.model.count < self.settings.tries))
        for a in new.tolist():
            self.model.suppose(a, np.array(rows[a]), self.settings.tries)
        if len(new):
            self._cells = ()
            self.refit()
            self.sweep()
        return len(new)

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later."""
        model, rng = self.model, self._rng.bit_generator.state
        learned = {"q": self.q.tolist(), "sums": model.sums.tolist(), "count": model.count.tolist()}
        return {**learned, "untried": list(self._untried), "episode": self.episode, "rng": rng}

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from the result of `memory`."""
        self.q = np.array(memory["q"], float)
        self.model.sums = np.array(memory["sums"], float)
        self.model.count = np.array(memory["count"], int)
        self._untried = list(memory["untried"])
        self.episode = int(memory["episode"])
        self._rng.bit_generator.state = memory["rng"]
        self._cells = ()
        self._fitted = 0


def towards(readings: Readings) -> tuple[float, float]:
    """Direction to the light from the sensors, ahead and left; its length has no meaning and no effect of dimness."""
    fl, fr, rl, rr = readings
    one, other = log(fl / rr), log(fr / rl)
    return (one + other) / SENSOR_X, (one - other) / SENSOR_Y


def courses(table: StoredTable, lights: Array) -> Array:
    """Return the yaw rate at which a stored table arrives for each place of the light, rad/s; shape (places,).

    The robot comes along straight ahead. `lights` are places in the robot's frame, shape (places, 2), m.
    """
    q = np.asarray(table.values).reshape(BEARINGS, YAW_RATES, -1)
    c, k = np.array(table.about["turning"])
    seen = [towards(illuminances(0.0, 0.0, 0.0, PointLight(x, y))) for x, y in lights.tolist()]
    return np.asarray((c / (1.0 - k))[[best_action(q, atan2(left, ahead), 0.0) for ahead, left in seen]])


def best_action(q: Array, bearing: float, w: float) -> int:
    """The action with the largest value at a bearing (rad) and yaw rate (rad/s), between the four nearest cells."""
    i0, i1, fi = _bearing_cells(np.float64(bearing))
    j0, fj = _yaw_cells(np.float64(w))
    low = (1.0 - fi) * q[i0, j0] + fi * q[i1, j0]
    high = (1.0 - fi) * q[i0, j0 + 1] + fi * q[i1, j0 + 1]
    return int(np.argmax((1.0 - fj) * low + fj * high))


def _bearing_cells(bearing: Any) -> tuple[Any, Any, Any]:
    """The two nearest cells of bearings (rad), and the share of the second."""
    place = (bearing + pi) / (2.0 * pi / BEARINGS)
    low = np.floor(place)
    i = low.astype(int) % BEARINGS
    return i, (i + 1) % BEARINGS, place - low


def _yaw_cells(w: Any) -> tuple[Any, Any]:
    """The lower of the two nearest cells of yaw rates (rad/s), and the share of the upper cell."""
    place = (np.clip(w, -YAW_MAX, YAW_MAX) + YAW_MAX) / (2.0 * YAW_MAX / (YAW_RATES - 1))
    j = np.minimum(place.astype(int), YAW_RATES - 2)
    return j, place - j
