"""A learner that fits the place of the light and its sensors' law to its last readings, and plans a short way.

It has odometry, and is told the distance at which the goal begins. It assumes a point light whose brightness falls with
a power of the distance. Where its sensors sit and what its actions do, it learns. In each decision, 0.1 s:

    z, d, h  <- logarithm of each sensor's mean reading since the last decision; way and turn since then, by odometry
    fit         z = g - n/2 log(|q - p|^2 + u)          over the last `ROWS` decisions (`_fit`)
                p, g: place and sensitivity of each sensor; n, u: power, square of the light's height above the sensors
                q: place of the light in each episode, from a path whose turns are s h
    effects     d' = k d + (1-k) c(a), b' = l b + (1-l) e(a), h = b d  over the same decisions (`_learn_effects`)
                a: the action of L decisions before; b: curvature. Those k, l and L are taken with the least misfit
    plan        the first action of the quickest course "a for m decisions, then b" to the goal (`_plan`); b goes on
                along its arc, which may graze the goal circle, miss it and go round once more

The fit is least squares by Levenberg and Marquardt. A misfit counts the less, the larger it is (Cauchy), and each
sensor by its own noise; one that does not change while others do is dead, frozen or dazzled, and does not count. The
fit begins with the light at places all around, again where the learner doubts its model (`_anew`).

The doubt is a test: log(time / first plan) is taken as normal, with mean and deviation of the last twenty fine episodes
and a usual prior. A time that a fine one exceeds with the probability `alarm` tells that the model does not fit.
"""

from math import cos, hypot, inf, log, pi, sin, sqrt
from statistics import NormalDist
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.config import Config
from txt1.learning.agent import Decision, PeriodicAgent, StoredTable
from txt1.learning.settings import LearningConfig
from txt1.model.light_sensors import LUX_MAX, LUX_MIN
from txt1.model.odometry import Odometry

Array = NDArray[np.float64]
TABLE_IS_DRAWN: Final = False
# decisions that a fit uses; s of one; decisions for which each action is tried at first
ROWS, PERIOD, TRIES = 480, 0.1, 5
# delays of actions that are tried, and decisions in which way and curvature settle
DELAYS, SETTLE = 7, 6
# columns of a decision: episode, samples, way, turn, action, logarithms of the readings, whether each counts
EPISODE, COUNT, WAY, TURN, ACTION, LOGS, SOUND, COLUMNS = 0, 1, 2, 3, 4, slice(5, 9), slice(9, 13), 13
# numbers of the law: places of the sensors (x, y), then these
GAINS, POWER, HEIGHT, SCALE, LAW = slice(8, 12), 12, 13, 14, 15
# the law before anything is known, and standard deviations; of a light's place, m
PRIOR: Final = np.array([0.0] * 8 + [log(135.0)] * 4 + [2.0, 0.0, 1.0])
SPREAD: Final = np.array([0.3] * 8 + [3.0] * 4 + [0.7, 1.0, 0.1])
FAR: Final = 4.0
# standard deviations: of the law as a share of a reading, of a reading at first, of log(time / plan) at first
MODEL, NOISY, USUAL = 0.03, 0.3, 0.15
# weight of the usual deviation, in episodes; share of the goal's distance by which a course should enter it
WEIGHT, GRAZE = 8.0, 0.06
# shares of a decision's way and curvature that stay in the next, which are tried
KEEPS: Final = np.linspace(0.0, 0.95, 20)[:, None, None]
# around the start, m, shape (places, 2)
PLACES: Final = np.array(
    [(r * cos(k * pi / 12.0), r * sin(k * pi / 12.0)) for r in (0.5, 0.8, 1.2, 1.8, 2.7) for k in range(24)]
)


class LocatorAgent(PeriodicAgent):
    """The learner, as configured, or one that goes on from a stored table; ValueError: the table does not fit."""

    name = "locator"

    def __init__(self, config: Config, _rng: object = None, table: StoredTable | None = None) -> None:
        super().__init__(PERIOD)
        learning = config.section(LearningConfig)
        self._actions, self._goal, self._alarm = len(learning.actions), learning.goal_radius, learning.locator.alarm
        self._rows: Array = np.empty((0, COLUMNS))
        # the law, then each episode's light in its odometry, m; noise of each sensor; deviation of the last light, m
        self._law, self._noise, self._deviation = PRIOR, np.full(4, NOISY), 0.0
        self._effects, self._delay = np.zeros((2, self._actions + 2)), 0
        # distances at which episodes ended, and log(time / plan) of fine ones
        self._ends: list[float] = []
        self._late: list[float] = []
        self._episode = 0
        if table is not None:
            self.recall(table.about["knows"])
        self.begin()

    def begin(self) -> None:
        """An episode begins."""
        super().begin()
        # it rested before
        self._history = [self._actions] * DELAYS
        self._value = np.zeros(self._actions)
        self._began = self._planned = inf
        self.unfit = ""

    def act(self, now: float, odometry: Odometry) -> int:
        """Learn from the readings since the last decision, and return the next action."""
        self._decides(now)
        self._look(odometry)
        done = len(self._history) - DELAYS
        if done % SETTLE == 0:
            self._learn_effects()
        if not self._ends and done < TRIES * self._actions:
            action = done // TRIES
        else:
            if done % 3 == 0 or self._planned == inf:
                self._refit(done)
            self._plan()
            action = int(self._value.argmin())
            if self._planned == inf:
                self._began, self._planned = now, max(PERIOD * float(self._value[action]), 10.0 * PERIOD)
            elif improbable(log(max(now - self._began, PERIOD) / self._planned), self._late, self._alarm):
                self.unfit = "how long the way takes"
        self._history.append(action)
        return action

    def end(self, success: bool, odometry: Odometry) -> None:
        """The episode is over: learn how far the goal was, and how late it was."""
        if self._samples:
            self._look(odometry)
        if self._planned == inf:
            # the light's place in it is unknown
            self._rows = self._rows[self._rows[:, EPISODE] != self._episode]
        elif success:
            self._ends = [*self._ends, hypot(*self._light())][-20:]
            late = log(max(self._due - self._began, PERIOD) / self._planned)
            if not improbable(late, self._late, self._alarm):
                self._late = [*self._late, late][-20:]
        self._episode += 1

    def _look(self, odometry: Odometry) -> None:
        """Add a row: the readings since the last decision, and the way that odometry tells."""
        lux = np.clip(self._seen(), LUX_MIN, LUX_MAX)
        way, turn = self._moved(odometry)
        same = np.ptp(lux, axis=0) == 0.0
        sound = (lux.max(axis=0) < LUX_MAX) & (~same | same.all())
        row = [self._episode, len(lux), way, turn, self._history[-1], *np.log(lux.mean(axis=0)), *sound]
        self._rows = np.vstack([self._rows, row])
        while len(self._rows) > ROWS and (first := self._rows[0, EPISODE]) != self._episode:
            self._rows = self._rows[self._rows[:, EPISODE] != first]
            self._law = np.append(self._law[:LAW], self._law[LAW + 2 :])

    def _paths(self, scale: float, back: float = 0.5) -> Array:
        """Return the poses from the episode's start a share `back` before the end of each row, (rows, 3)."""
        first = np.searchsorted(self._rows[:, EPISODE], self._rows[:, EPISODE])
        turn, way = scale * self._rows[:, TURN], self._rows[:, WAY]
        heading = np.cumsum(turn)
        heading -= (heading - turn)[first]
        steps = way * np.array([np.cos(heading - 0.5 * turn), np.sin(heading - 0.5 * turn)])
        places = np.cumsum(steps, axis=1)
        places -= (places - steps)[:, first]
        return np.vstack([places - back * steps, heading - back * turn]).T

    def _light(self) -> tuple[Any, Any]:
        """Return the light's place in the robot's frame now, ahead and left, m."""
        x, y, heading = self._paths(self._law[SCALE], 0.0)[-1]
        return _turned(self._law[-2] - x, self._law[-1] - y, heading)

    def _refit(self, done: int) -> None:
        """Fit the law and the places of the light with the newest rows."""
        known, again = self._planned < inf, done % (2 * TRIES) == 0
        if len(self._law) > LAW:
            fits = [self._fit(self._law, self._noise, 2)] if known else []
            if again or not known:
                fits.append(self._fit(self._nearest(self._law[:-2] if known else self._law), self._noise, 3))
            _, self._law, self._noise, self._deviation = min(fits, key=lambda each: each[0])
        if len(self._law) == LAW or (self.unfit and again):
            self._anew()

    def _anew(self) -> None:
        """Begin anew from this episode alone, the light 1.2 m off, unless the law explains it at least half as well."""
        rows, noise, law = self._rows, np.full(4, NOISY), np.append(self._law[:LAW], self._law[-2:])
        self._rows = rows[rows[:, EPISODE] == self._episode]
        fits = [self._fit(np.append(PRIOR, place), noise, 12) for place in PLACES[48:72:3]]
        found = min(fits, key=lambda each: each[0])
        if len(self._law) > LAW and self._fit(law, noise, 0)[0] < 2.0 * found[0]:
            self._rows = rows
        else:
            _, self._law, self._noise, self._deviation = found

    def _nearest(self, before: Array) -> Array:
        """Return what was known before with the place in a grid where the light fits the last episode best."""
        rows, law = self._rows[last := self._rows[:, EPISODE] == self._episode], self._law
        square = _squares(self._paths(law[SCALE])[last], PLACES[:, None], law)[0]
        misfit = rows[:, LOGS] - law[GAINS] + 0.5 * law[POWER] * np.log(square)
        weight = rows[:, SOUND] / (self._noise**2 / rows[:, COUNT, None] + MODEL**2)
        return np.append(before, PLACES[np.log1p(misfit**2 * weight).sum(axis=(1, 2)).argmin()])

    def _fit(self, x: Array, noise: Array, steps: int) -> tuple[float, Array, Array, float]:
        """Return cost, law, noise and the last light's deviation, m, by Levenberg and Marquardt from a law."""
        sound, counts, lights = self._rows[:, SOUND], self._rows[:, COUNT, None], len(x) - LAW
        mean, certain = np.append(PRIOR, np.zeros(lights)), np.append(SPREAD, np.full(lights, FAR)) ** -2.0
        variance, damping, least = noise**2 / counts + MODEL**2, 1e-3, inf
        at, misfit, normal, right = x, np.zeros_like(sound), np.eye(len(x)), np.zeros(len(x))
        for _ in range(steps + 1):
            tried, slope = self._slopes(x)
            square = tried**2 / variance
            cost = float(4.0 * (sound * np.log1p(square / 4.0)).sum() + ((x - mean) ** 2 * certain).sum())
            if cost < least:
                weight = (sound / variance / (1.0 + square / 4.0)).ravel()
                flat = slope.reshape(-1, len(x))
                normal = flat.T @ (flat * weight[:, None]) + np.diag(certain)
                right = flat.T @ (weight * tried.ravel()) + certain * (mean - x)
                least, at, misfit, damping = cost, x, tried, max(damping / 5.0, 1e-6)
            else:
                damping *= 20.0
            x = at + np.linalg.solve(normal + damping * np.diag(np.diag(normal)), right)
            x[POWER], x[HEIGHT], x[SCALE] = max(x[POWER], 0.5), max(x[HEIGHT], 0.0), min(max(x[SCALE], 0.5), 1.5)
        seen = sound.sum(axis=0) > TRIES
        spread = np.where(sound > 0.0, np.abs(misfit) * np.sqrt(counts), np.nan)[:, seen]
        noise = noise.copy()
        noise[seen] = np.maximum(1.48 * np.nanmedian(spread, axis=0), MODEL)
        return least, at, noise, sqrt(max(float(np.trace(np.linalg.inv(normal)[-2:, -2:])) / 2.0, 0.0))

    def _slopes(self, x: Array) -> tuple[Array, Array]:
        """Return the misfits, (rows, 4), and the derivatives of the law by all unknowns, (rows, 4, unknowns)."""
        law, lights, n = x[:LAW], x[LAW:].reshape(-1, 2), x[POWER]
        number = np.unique(self._rows[:, EPISODE], return_inverse=True)[1]
        poses = self._paths(law[SCALE])
        square, away = _squares(poses, lights[number], law)
        other, _ = _squares(self._paths(law[SCALE] + 1e-4), lights[number], law)
        slope, rows, place = np.zeros((len(poses), 4, len(x))), np.arange(len(poses)), LAW + 2 * number
        (ahead, left), s = np.moveaxis(n * away / square[..., None], -1, 0), np.arange(4)
        slope[:, s, 2 * s], slope[:, s, 2 * s + 1], slope[:, s, 8 + s] = ahead, left, 1.0
        slope[:, :, POWER], slope[:, :, HEIGHT] = -0.5 * np.log(square), -0.5 * n / square
        slope[:, :, SCALE] = -0.5 * n * np.log(other / square) / 1e-4
        slope[rows, :, place], slope[rows, :, place + 1] = _turned(-ahead, -left, -poses[:, 2, None])
        return self._rows[:, LOGS] - law[GAINS] + 0.5 * n * np.log(square), slope

    def _learn_effects(self) -> None:
        """Learn the effects of the actions, their lags and their delay by least squares over the rows."""
        rows, least, before = self._rows, inf, self._effects[:, 1:]
        lagging = (1.0 - KEEPS) * (rows[:, ACTION, None] == np.arange(self._actions + 1))
        for k in (1, 2, 4, 8, 16):
            lagging += KEEPS**k * _earlier(lagging, rows, k)
        for delay in range(DELAYS):
            found, cost, way, late = [], 0.0, 1.0, _earlier(lagging, rows, delay)
            # what an action did before counts about as one decision, or it would be forgotten with its rows
            for seen, known, weight in zip(rows[:, [WAY, TURN]].T, before, (1.0, 1e-3), strict=True):
                design = late * way
                turned = np.swapaxes(design, 1, 2)
                right = (turned @ seen + weight * known)[..., None]
                settled = np.linalg.solve(turned @ design + weight * np.eye(len(known)), right)
                told = design @ settled
                misfit = ((seen - told[..., 0]) ** 2).sum(axis=1)
                best = int(misfit.argmin())
                found.append([KEEPS[best, 0, 0], *settled[best, :, 0]])
                cost, way = cost + log(misfit[best] + 1e-9), told[best]
            if cost < least:
                least, self._effects, self._delay = cost, np.array(found), delay

    def _plan(self) -> None:
        """Find the number of decisions to the goal by the quickest course that begins with each action."""
        way, turn, scale = self._rows[-1, WAY], self._rows[-1, TURN], float(self._law[SCALE])
        state = np.array([*self._light(), way, turn / way if abs(way) > 1e-3 else 0.0])
        for a in self._history[len(self._history) - self._delay :]:
            state = _course(state[:, None], self._effects[:, [0, 1 + a]], scale, 1)[:, 0, 0]
        effects = self._effects[:, :-1]
        goal = (1.0 - GRAZE) * (sum(self._ends) + 3.0 * self._goal) / (len(self._ends) + 3.0)
        # where the episode goes on although it should be there, the goal is nearer
        goal = min(goal, 0.9 * hypot(state[0], state[1]))
        doubt = hypot(self._deviation, GRAZE * goal)
        switches = np.array([m for m in range(1, 120) if m < 9 or m % 3 == 0])
        # a for m decisions, then b: shape (actions a, decisions m, actions b)
        after = _course(state[:, None], effects, scale, int(switches[-1]))[..., switches - 1]
        times = switches[:, None] + _onward(after, effects, scale, goal, doubt)
        self._value = np.minimum(times.min(axis=(1, 2)), _onward(state, effects, scale, goal, doubt))

    def decision(self, odometry: Odometry) -> Decision:
        """Return the decisions to the goal by each action, as costs."""
        return Decision(None, None, tuple((-self._value).tolist()))

    def table(self) -> StoredTable:
        """Return the law as a row, and all else beside it."""
        about = {"agent": self.name, "episodes": self._episode, "knows": self.memory()}
        return StoredTable(self._law[None, :LAW].copy(), about)

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later."""
        told = {"law": self._law.tolist(), "noise": self._noise.tolist(), "rows": self._rows.tolist()}
        told |= {"effects": self._effects.tolist(), "delay": self._delay}
        return told | {"ends": self._ends, "late": self._late, "episode": self._episode}

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from the result of `memory`; ValueError: it knows another number of actions."""
        effects = np.array(memory["effects"], float)
        if effects.shape != (2, self._actions + 2):
            raise ValueError(f"knows {effects.shape[-1] - 2} actions where {self._actions} are needed")
        self._rows, self._effects = np.array(memory["rows"], float).reshape(-1, COLUMNS), effects
        self._law, self._noise = np.array(memory["law"], float), np.array(memory["noise"], float)
        self._delay = int(memory["delay"])
        self._ends, self._late = list(map(float, memory["ends"])), list(map(float, memory["late"]))
        self._episode = int(memory["episode"])


def improbable(late: float, known: list[float], alarm: float) -> bool:
    """Return whether log(time / plan) is so late with less than the probability `alarm`; `known`: of fine episodes."""
    count = len(known) + WEIGHT
    mean = sum(known) / count
    square = (WEIGHT * USUAL**2 + sum((each - mean) ** 2 for each in known)) / count
    return late > mean + sqrt(square) * NormalDist().inv_cdf(1.0 - alarm)


def _turned(x: Any, y: Any, angle: Any) -> tuple[Any, Any]:
    """Return vectors in a frame that is turned by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return c * x + s * y, c * y - s * x


def _earlier(values: Array, rows: Array, k: int) -> Array:
    """Return what values, shape (..., rows, any), were k rows before; 0 before the episode."""
    same = (np.roll(rows[:, EPISODE], k) == rows[:, EPISODE]) & (np.arange(len(rows)) >= k)
    return np.where(same[:, None], np.roll(values, k, axis=-2), 0.0)


def _squares(poses: Array, lights: Array, law: Array) -> tuple[Array, Array]:
    """Return the squares of the lights' distances from the sensors, (..., 4), and the vectors to them, (..., 4, 2)."""
    x, y = lights[..., 0] - poses[:, 0], lights[..., 1] - poses[:, 1]
    away = np.stack(_turned(x, y, poses[:, 2]), axis=-1)[..., None, :] - law[:8].reshape(4, 2)
    return np.maximum((away**2).sum(axis=-1) + law[HEIGHT], 1e-3), away


def _course(state: Array, effects: Array, scale: float, decisions: int) -> Array:
    """Return the light ahead and left, way and curvature after each decision, shape (4, ..., actions, decisions)."""
    (ahead, left, *begun), j = state[..., None], np.arange(1, decisions + 1)
    of_each = zip(begun, effects[:, 1:, None], effects[:, 0], strict=True)
    ways, bends = (last + (first - last) * keep**j for first, last, keep in of_each)
    turns = scale * bends * ways
    heading = np.cumsum(turns, axis=-1)
    dx = ahead - np.cumsum(ways * np.cos(heading - 0.5 * turns), axis=-1)
    dy = left - np.cumsum(ways * np.sin(heading - 0.5 * turns), axis=-1)
    return np.stack([*_turned(dx, dy, heading), ways, bends])


def _onward(state: Array, effects: Array, scale: float, goal: float, doubt: float) -> Array:
    """Return the mean number of decisions to the goal by each action from states (4, ...); shape (..., actions)."""
    start = np.repeat(state[..., None], effects.shape[1] - 1, axis=-1)
    course = _course(start, effects, scale, SETTLE)
    near = np.hypot(course[0], course[1])
    before = np.concatenate([np.hypot(start[0], start[1])[..., None], near[..., :-1]], axis=-1)
    # the decision that enters the goal counts in part
    part = np.clip((before - goal) / np.maximum(before - near, 1e-9), 0.0, 1.0)
    entered = (np.arange(SETTLE) + part).min(axis=-1, where=near <= goal, initial=inf)
    step, curve = effects[:, 1:] * [[1.0], [scale]]
    step, curve = np.where(np.abs(step) < 1e-4, 1e-4, step), np.where(np.abs(curve) < 1e-3, 1e-3, curve)
    radius, circle = 1.0 / np.abs(curve), 2.0 * pi / max(float(np.abs(curve).max()), 0.1)
    # as if it drove ahead and to the left
    ahead, side = np.sign(step) * course[0, ..., -1], np.sign(curve) * course[1, ..., -1] - radius
    rho = np.hypot(ahead, side)
    cosine = np.clip((rho**2 + radius**2 - goal**2) / (2.0 * rho * radius + 1e-12), -1.0, 1.0)
    angle = (np.arctan2(side, ahead) - np.arccos(cosine) + 0.5 * pi) % (2.0 * pi)
    deep = goal - np.abs(rho - radius)
    again = (0.5 - 0.5 * np.tanh(0.8 * deep / doubt)) * (circle + np.maximum(-deep, 0.0))
    return np.where(entered < inf, entered, SETTLE + (radius * angle + again) / np.abs(step))
