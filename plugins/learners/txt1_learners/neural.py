"""A learner from raw readings: an ensemble of small networks predicts them, and a search compares plans.

It is not told about its sensors, its actions or its speed, nor that there is a light. It knows only that bright is
good. The thesis's outlook (chapter 6) asks for a neural learner; this learner follows

    K. Chua, R. Calandra, R. McAllister, S. Levine: Deep Reinforcement Learning in a Handful of Trials using
    Probabilistic Dynamics Models. NeurIPS 2018 (an ensemble, each on samples of its own, and planning with all of it)
    D. Hafner et al.: Learning Latent Dynamics for Planning from Pixels. ICML 2019 (trained on many steps ahead)

        x     <- logarithms of the mean readings since the last decision: their mean, and each sensor's difference from
        it
    h     <- encode(the last `history` of x, odometry's distance and turn, and actions)           for each network
        learn   h' = h + C tanh(A [h, a]),  x = D h:  to predict x `ahead` decisions on                 (Adam)
        a     <- first action of the plan "a for m decisions, then b" with the brightest predicted course, mean of
        networks

The encoded history includes the last actions, and so it includes delays. The networks train all the time. Half of each
batch comes from the latest decisions, so that the learner follows a world that changes. At first, and when an episode
takes long, it tries actions at random.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1 import Odometry
from txt1.config import Config
from txt1.learning.agent import Decision, PeriodicAgent, StoredTable
from txt1.learning.settings import LearningConfig
from txt1.model.kinematics import wrap_angle
from txt1.model.light_sensors import LUX_MAX, LUX_MIN, SENSORS
from txt1.units import Positive, PositiveInt, Share
from txt1_learners.stored_arrays import kept

Array = NDArray[np.float64]
# each with the networks along its first axis
Weights = dict[str, Array]

# numbers of x: the mean of the logarithms, and four differences
SEEN: Final = 5
# numbers kept for each decision: x, distance, turn, and the action before
ROW: Final = SEEN + 3
# factor on logarithms, which brings the networks' numbers to about 1
GAIN: Final = 3.0
# decisions after which a plan may change to another action
SWITCHES: Final = (1, 2, 3, 5, 8, 12, 17)


@dataclass(frozen=True, slots=True)
class NeuralSettings:
    """The hyper-parameters, which `learning.neural` sets."""

    # time from one decision to the next, s
    period: Positive = 0.1
    # networks
    members: PositiveInt = 3
    # units of each layer
    hidden: PositiveInt = 32
    # numbers of the predicted state
    latent: PositiveInt = 10
    # decisions from which it is encoded
    history: PositiveInt = 5
    # decisions predicted, in training and for a plan
    ahead: PositiveInt = 20
    # samples for a step of training; each network has its own
    batch: PositiveInt = 32
    # steps of training after each decision; a few ms together
    steps: PositiveInt = 2
    # learning rate of Adam
    rate: Positive = 3e-3
    # decisions in a row for which each action is tried at first
    tries: PositiveInt = 5
    # decisions at first that are random; also the usual length of an episode before the first success
    blind: PositiveInt = 40
    # an episode is long if it takes this many times the usual number of decisions
    patience: Positive = 2.0
    # probability to try an action for up to 30 decisions, per decision of a long episode
    tumble: Share = 0.1
    # decisions kept for training
    memory: PositiveInt = 6000
    # those from which half of the samples come
    latest: PositiveInt = 600


SETTINGS: Final = NeuralSettings()


def create(config: Config, rng: np.random.Generator, table: StoredTable | None = None) -> "NeuralAgent":
    """Return a learner as configured, or a driver by stored networks; ValueError: they have another shape."""
    settings = config.section(LearningConfig).part("neural", SETTINGS)
    agent = NeuralAgent(rng, len(config.section(LearningConfig).actions), settings)
    if table is not None:
        agent.drive_by(table)
    return agent


class NeuralAgent(PeriodicAgent):
    """The learner; see the module."""

    name = "neural"

    def __init__(self, rng: np.random.Generator, actions: int = 3, settings: NeuralSettings = SETTINGS) -> None:
        super().__init__(settings.period)
        self.settings = settings
        self.actions = actions
        self.episode = 0
        self.training = True
        one = settings
        self.weights = initial(rng, one.members, one.history * (SEEN + 2 + actions), one.hidden, one.latent, actions)
        self.adam = [{name: np.zeros_like(w) for name, w in self.weights.items()} for _ in range(2)]
        # steps of training so far
        self.steps = 0
        # the kept decisions
        self.rows: Array = np.zeros((0, ROW))
        # for each row, the number of the last row of its episode
        self.last: NDArray[np.int64] = np.zeros(0, np.int64)
        # decisions that a success takes, on average; 0: no success yet
        self.usual = 0.0
        # logarithms of the first readings
        self.level: Array | None = None
        # largest distance and turn of a decision so far, in odometry's units
        self.scale = np.zeros(2)
        self._plans = plans(actions, one.ahead)
        self._rng = rng
        self._before = self._copy()
        self.begin()

    # -- the learner as the trial sees it ------------------------------------------------------------------------

    def begin(self) -> None:
        """An episode begins."""
        self._before = self._copy()
        self._rest()
        # the episode's first row
        self._first = len(self.rows)
        self._at: Odometry | None = None
        self._a = -1
        # decisions for which the randomly drawn action still stays in force
        self._random = 0
        self._untried = [int(a) for a in self._rng.permutation(self.actions)] if not len(self.rows) else []
        self._values: tuple[float, ...] = ()
        self._error: float | None = None

    def act(self, now: float, odometry: Odometry) -> int:
        """Learn from the result of the last action, and choose the next action."""
        self._decides(now)
        self._take(odometry)
        if self.training:
            self._train(self.settings.steps)
        self._a = self._choose()
        return self._a

    def end(self, success: bool, odometry: Odometry) -> None:
        """The episode is over."""
        self._take(odometry)
        self.episode += 1
        if success:
            took = float(len(self.rows) - self._first)
            self.usual += 0.3 * (min(took, 2.0 * self.usual) - self.usual) if self.usual else took
        if len(self.rows) > self.settings.memory:
            gone = len(self.rows) - self.settings.memory
            self.rows, self.last = self.rows[gone:], self.last[gone:] - gone

    # -- what it does --------------------------------------------------------------------------------------------

    def _take(self, odometry: Odometry) -> None:
        """Keep the data since the last decision."""
        lux = np.nan_to_num(self._seen()) if self._samples else np.full((1, 4), LUX_MIN)
        z = np.log(np.clip(lux.mean(axis=0), LUX_MIN, LUX_MAX))
        if self.level is None:
            self.level = z
        z = GAIN * (z - self.level)
        row = np.zeros(ROW)
        row[0] = z.mean()
        row[1:SEEN] = z - row[0]
        if self._at is not None:
            apart = odometry.x - self._at.x, odometry.y - self._at.y
            row[SEEN : SEEN + 2] = sqrt(apart[0] ** 2 + apart[1] ** 2), wrap_angle(odometry.theta - self._at.theta)
        self.scale = np.maximum(self.scale, np.abs(row[SEEN : SEEN + 2]))
        row[-1] = self._a
        self._at = odometry
        self.rows = np.concatenate([self.rows, row[None]])
        self.last = np.concatenate([self.last, [0]])
        self.last[self._first :] = len(self.rows) - 1

    def _choose(self) -> int:
        if self._random > 0:
            self._random -= 1
            return self._a
        if self._untried:
            self._random = self.settings.tries - 1
            return self._untried.pop()
        one = self.settings
        late = len(self.rows) - self._first > one.patience * (self.usual or one.blind)
        if self.training and (len(self.rows) < one.blind or (late and self._rng.random() < one.tumble)):
            self._random = int(self._rng.integers(3, 30))
            return int(self._rng.integers(self.actions))
        return self._best()

    def _best(self) -> int:
        """The first action of the plan with the brightest predicted course."""
        here = np.array([len(self.rows) - 1])
        seen = self._history(np.tile(here, (self.settings.members, 1)))
        given = np.broadcast_to(self._plans, (self.settings.members, *self._plans.shape))
        course, _ = foretell(self.weights, np.repeat(seen, len(self._plans), axis=1), given)
        bright = course[..., 0].mean(axis=(0, 2)) / GAIN
        self._values = tuple(float(bright[self._plans[:, 0] == a].max()) for a in range(self.actions))
        return int(self._plans[bright.argmax(), 0])

    def _history(self, which: NDArray[np.int64]) -> Array:
        """The encoder's input for rows, shape (networks, samples, numbers): each row and its episode's rows before."""
        back = np.arange(self.settings.history)
        rows = which[..., None] - back
        first = self._firsts(which)[..., None]
        kept = self.rows[np.maximum(rows, first)]
        moved = kept[..., SEEN : SEEN + 2] / np.maximum(self.scale, 1e-9)
        taken = (kept[..., -1:] == np.arange(self.actions)) * 1.0
        return np.concatenate([kept[..., :SEEN], moved, taken], axis=-1).reshape(*which.shape, -1)

    def _firsts(self, which: NDArray[np.int64]) -> NDArray[np.int64]:
        """The first row of each row's episode."""
        return np.searchsorted(self.last, self.last[which])

    def _train(self, steps: int) -> None:
        """Make Adam steps on samples of all kept rows, half of them from the latest."""
        one, count = self.settings, len(self.rows)
        if count < 2 * one.history:
            return
        for _ in range(steps):
            half = one.batch // 2
            recent = self._rng.integers(max(0, count - one.latest), count - 1, (one.members, half))
            any_of = self._rng.integers(0, count - 1, (one.members, one.batch - half))
            which = np.concatenate([recent, any_of], axis=1)
            on = which[..., None] + np.arange(1, one.ahead + 1)
            there = on <= self.last[which][..., None]
            on = np.minimum(on, count - 1)
            given = np.where(there, self.rows[on, -1], 0.0).astype(np.int64)
            self._error, slopes = slopes_of(
                self.weights, self._history(which), given, self.rows[on, :SEEN], there * 1.0
            )
            self.steps += 1
            adam(self.weights, slopes, self.adam, self.steps, one.rate)

    def decision(self, odometry: Odometry) -> Decision:
        """No state of a table; minus the mean square error of the last predictions; the best course of each action."""
        del odometry
        return Decision(None, None if self._error is None else -self._error, self._values)

    # -- what it keeps -------------------------------------------------------------------------------------------

    def _copy(self) -> tuple[Any, ...]:
        copies = [{name: w.copy() for name, w in each.items()} for each in (self.weights, *self.adam)]
        rest = self.steps, self.rows, self.last, self.usual, self.level, self.scale, self.episode
        return copies, rest, self._rng.bit_generator.state

    def void(self) -> None:
        """Forget what was learned since `begin`."""
        (self.weights, *self.adam), rest, self._rng.bit_generator.state = self._before
        self.steps, self.rows, self.last, self.usual, self.level, self.scale, self.episode = rest

    def table(self) -> StoredTable:
        """The networks: a row for each, with all its weights in sequence."""
        values = np.concatenate([w.reshape(self.settings.members, -1) for w in self.weights.values()], axis=1)
        about = {
            "agent": self.name,
            "episodes": self.episode,
            "scale": self.scale.tolist(),
            "level": None if self.level is None else self.level.tolist(),
        }
        return StoredTable(values, about)

    def drive_by(self, table: StoredTable) -> None:
        """Take the weights of a stored table, and learn no more; ValueError: they have another shape."""
        values = np.array(table.shaped(*self.table().shape))
        at = 0
        for name, w in self.weights.items():
            size = w[0].size
            self.weights[name] = values[:, at : at + size].reshape(w.shape).copy()
            at += size
        self.scale = kept(table, "scale", self.scale.shape)
        self.level = None if table.about["level"] is None else kept(table, "level", (len(SENSORS),))
        self.training = False

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later."""
        nets = [{name: w.tolist() for name, w in each.items()} for each in (self.weights, *self.adam)]
        return {
            "nets": nets,
            "steps": self.steps,
            "rows": self.rows.tolist(),
            "last": self.last.tolist(),
            "usual": self.usual,
            "level": None if self.level is None else self.level.tolist(),
            "scale": self.scale.tolist(),
            "episode": self.episode,
            "rng": self._rng.bit_generator.state,
        }

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from the result of `memory`."""
        nets = [{name: np.array(w) for name, w in each.items()} for each in memory["nets"]]
        self.weights, *self.adam = nets
        self.steps, self.usual, self.episode = int(memory["steps"]), float(memory["usual"]), int(memory["episode"])
        self.rows = np.array(memory["rows"], float).reshape(-1, ROW)
        self.last = np.array(memory["last"], np.int64)
        self.level = None if memory["level"] is None else np.array(memory["level"])
        self.scale = np.array(memory["scale"])
        self._rng.bit_generator.state = memory["rng"]
        self.begin()


def plans(actions: int, ahead: int) -> NDArray[np.int64]:
    """All plans "a for m decisions, then b", shape (plans, ahead)."""
    found = [[a] * ahead for a in range(actions)]
    for m in SWITCHES:
        if m < ahead:
            found += [[a] * m + [b] * (ahead - m) for a in range(actions) for b in range(actions) if b != a]
    return np.array(found)


# -- the networks, all at once ---------------------------------------------------------------------------------------


def initial(rng: np.random.Generator, members: int, seen: int, hidden: int, latent: int, actions: int) -> Weights:
    """Random weights, with which the first prediction is zero change."""

    def some(rows: int, columns: int, share: float = 1.0) -> Array:
        return share / sqrt(rows) * rng.standard_normal((members, rows, columns))

    return {
        "in": some(seen, hidden),
        "in_bias": np.zeros((members, 1, hidden)),
        "to": some(hidden, latent),
        "straight": some(seen, latent, 0.3),
        "h": some(latent, hidden),
        "a": some(actions, hidden),
        "bias": np.zeros((members, 1, hidden)),
        "back": some(hidden, latent, 0.1),
        "out": some(latent, SEEN, 0.3),
        "out_bias": np.zeros((members, 1, SEEN)),
    }


def foretell(w: Weights, seen: Array, given: NDArray[np.int64]) -> tuple[Array, tuple[Array, ...]]:
    """Return the predictions, shape (networks, samples, ahead, SEEN), and intermediate values for `slopes_of`.

    `seen` is the encoder's input, shape (networks, samples, numbers); `given` the actions (networks, samples, ahead).
    """
    u = np.tanh(seen @ w["in"] + w["in_bias"])
    h = u @ w["to"] + seen @ w["straight"]
    members, samples, ahead = given.shape
    by_action = w["a"][np.arange(members)[:, None, None], given] + w["bias"][:, :, None]
    states, units = np.empty((members, samples, ahead + 1, h.shape[-1])), np.empty_like(by_action)
    states[:, :, 0] = h
    for k in range(ahead):
        v = np.tanh(h @ w["h"] + by_action[:, :, k])
        h = h + v @ w["back"]
        units[:, :, k], states[:, :, k + 1] = v, h
    course = states[:, :, 1:].reshape(members, samples * ahead, -1) @ w["out"] + w["out_bias"]
    return course.reshape(members, samples, ahead, SEEN), (u, states, units)


def slopes_of(w: Weights, seen: Array, given: NDArray[np.int64], came: Array, there: Array) -> tuple[float, Weights]:
    """Return the mean square error of the predictions, and its slopes by all weights; `there`: 1 where data came."""
    course, (u, states, units) = foretell(w, seen, given)
    members, samples, ahead = given.shape
    weight = there / np.maximum(there.sum(axis=(1, 2), keepdims=True), 1.0)
    miss = (course - came) * weight[..., None]
    error = float((miss * (course - came)).sum() / members)

    def flat(x: Array) -> Array:
        return x.reshape(members, samples * ahead, -1)

    def turned(x: Array) -> Array:
        return x.swapaxes(1, 2)

    by_state = (flat(miss) @ turned(w["out"])).reshape(members, samples, ahead, -1)
    by_unit = np.empty_like(units)
    steps = np.empty_like(by_state)
    h_back, back = turned(w["h"]), turned(w["back"])
    g = np.zeros_like(states[:, :, 0])
    for k in range(ahead - 1, -1, -1):
        g = g + by_state[:, :, k]
        steps[:, :, k] = g
        v = units[:, :, k]
        by_unit[:, :, k] = (g @ back) * (1.0 - v * v)
        g = g + by_unit[:, :, k] @ h_back
    one_of = (given[..., None] == np.arange(w["a"].shape[1])) * 1.0
    by_u = (g @ turned(w["to"])) * (1.0 - u * u)
    return error, {
        "in": turned(seen) @ by_u,
        "in_bias": by_u.sum(axis=1, keepdims=True),
        "to": turned(u) @ g,
        "straight": turned(seen) @ g,
        "h": turned(flat(states[:, :, :-1])) @ flat(by_unit),
        "a": turned(flat(one_of)) @ flat(by_unit),
        "bias": flat(by_unit).sum(axis=1, keepdims=True),
        "back": turned(flat(units)) @ flat(steps),
        "out": turned(flat(states[:, :, 1:])) @ flat(miss),
        "out_bias": flat(miss).sum(axis=1, keepdims=True),
    }


def adam(w: Weights, slopes: Weights, moments: list[Weights], step: int, rate: float) -> None:
    """Make one step of Adam (Kingma, Ba: Adam. ICLR 2015), in place; slopes longer than 1 are shortened to 1."""
    first, second = moments
    length = sqrt(sum(float((g * g).sum()) for g in slopes.values()))
    shorter = min(1.0, 1.0 / max(length, 1e-9))
    for name, g in slopes.items():
        g = shorter * g
        first[name] += 0.1 * (g - first[name])
        second[name] += 0.001 * (g * g - second[name])
        w[name] -= rate * (first[name] / (1.0 - 0.9**step)) / (np.sqrt(second[name] / (1.0 - 0.999**step)) + 1e-8)
