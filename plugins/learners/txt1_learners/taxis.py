"""A learner that finds the light as small animals find food: by taxis, with synapses that it learns.

        x     <- sensors' logarithms, quickly averaged, less their mean and less each sensor's usual value, in
        deviations
        r     <- change of the mean logarithm since the last decision: positive when it gets brighter
        delta <- r + gamma v.x' - v.x,   v <- v + alpha delta e_v                             (the promise of a place)
    w     <- w + beta delta e_w,   e_w <- lambda e_w + (1[a] - pi) x  when a is chosen     (synapses to the muscles)
    when it tumbles: a <- drawn from pi = softmax(w x); else the action in force goes on

The more quickly it gets brighter, the more seldom it tumbles. It combines

- run and tumble, with adaptation: runs up the gradient are longer, as the change of concentration over time tells
  (H. C. Berg, D. A. Brown: Chemotaxis in Escherichia coli analysed by three-dimensional tracking. Nature 239, 1972);
- steering, by the difference between the sensors (Y. Iino, K. Yoshida: Parallel use of two behavioral mechanisms for
  chemotaxis in Caenorhabditis elegans. J. Neurosci. 29, 2009: pirouettes and weathervane);
- synapses that learn from the product of input, action and a common reward, through a trace that fades (A. G. Barto, R.
  S. Sutton, C. W. Anderson: Neuronlike adaptive elements that can solve difficult learning control problems. IEEE
  Trans. SMC 13, 1983; A. G. Barto, R. S. Sutton: Landmark learning. Biol. Cybern. 42, 1981, where a net of this kind
  finds a tree by its smell).

It does not know where its sensors sit or what its actions do. It plans nothing, keeps no map, and needs no odometry.
"""

from dataclasses import dataclass
from math import exp
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1 import Odometry
from txt1.config import Config
from txt1.learning.agent import Decision, PeriodicAgent, StoredTable
from txt1.learning.settings import LearningConfig
from txt1.model.light_sensors import LUX_MAX, LUX_MIN
from txt1.units import NotNegative, Positive, Share
from txt1_learners.stored_arrays import kept

Array = NDArray[np.float64]

SENSORS: Final = 4


@dataclass(frozen=True, slots=True)
class TaxisSettings:
    """The hyper-parameters, which `learning.taxis` sets."""

    # time from one decision to the next, s
    period: Positive = 0.1
    # weight of the past in its senses, per decision: 0.3 s
    quick: Share = 0.7
    # the same for the average with which tumbles compare the brightness: 1 s
    slow: Share = 0.9
    # the same for a sensor's usual value and its variance: 200 s
    used: Share = 0.9995
    # discount of the promise of a place, per decision
    gamma: Share = 0.95
    # share of a trace that is left after a decision
    fades: Share = 0.85
    # learning rate of promises
    alpha: Positive = 0.02
    # learning rate of synapses
    beta: Positive = 1.0
    # probability of a tumble in a decision while the brightness stays
    tumble: Positive = 0.4
    # probability of a pirouette in a decision while it darkens
    pirouette: NotNegative = 0.02
    # decisions that a pirouette takes, on average
    reorient: Positive = 20.0
    # how much a run is prolonged, by deviations of the brightening
    longer: NotNegative = 0.5


SETTINGS: Final = TaxisSettings()


def create(config: Config, rng: np.random.Generator, table: StoredTable | None = None) -> "TaxisAgent":
    """Return a learner as configured, or a driver by stored synapses; ValueError: they have another shape."""
    settings = config.section(LearningConfig).part("taxis", SETTINGS)
    agent = TaxisAgent(rng, len(config.section(LearningConfig).actions), settings)
    if table is not None:
        agent.synapses = np.array(table.shaped(*agent.synapses.shape))
        agent.used, agent.varies = kept(table, "used", agent.used.shape), kept(table, "varies", agent.varies.shape)
        agent.learns = False
    return agent


class TaxisAgent(PeriodicAgent):
    """The learner; see the module."""

    name = "taxis"

    def __init__(self, rng: np.random.Generator, actions: int = 3, settings: TaxisSettings = SETTINGS) -> None:
        super().__init__(settings.period)
        self.settings = settings
        self.actions = actions
        self.episode = 0
        self.learns = True
        # from each sensor, and from a unit that always fires
        self.synapses: Array = np.zeros((SENSORS + 1, actions))
        self.promises: Array = np.zeros(SENSORS + 1)
        # usual difference of each sensor
        self.used: Array = np.zeros(SENSORS)
        # variance of this difference
        self.varies: Array = np.full(SENSORS, 0.04)
        # variance of the brightening
        self.brightens = 0.01
        self._rng = rng
        self.begin()

    def begin(self) -> None:
        """An episode begins."""
        super().begin()
        # logarithms, quickly averaged
        self._sensed: Array | None = None
        # mean logarithm at the last decision, and slowly averaged
        self._bright = self._past = 0.0
        self._x: Array | None = None
        self._a = -1
        # decisions for which a pirouette goes on
        self._turning = 0
        # traces
        self._promised = np.zeros_like(self.promises)
        self._did = np.zeros_like(self.synapses)
        self._delta: float | None = None
        self._likes: Array = np.zeros(self.actions)

    def act(self, now: float, odometry: Odometry) -> int:
        """Learn from the change of brightness, and choose the next action."""
        del odometry
        self._decides(now)
        x, r, rise = self._sense()
        self._learn(x, r)
        self._promised = self.settings.fades * self._promised + x
        self._did *= self.settings.fades
        self._x = x
        self._likes = x @ self.synapses
        if self._turning > 0:
            self._turning -= 1
        elif self._a >= 0 and rise < -1.0 and self._rng.random() < self.settings.pirouette:
            self._a = int(self._rng.integers(self.actions))
            self._turning = int(self._rng.exponential(self.settings.reorient))
        elif self._a < 0 or self._rng.random() < self.settings.tumble * exp(-self.settings.longer * max(rise, -0.3)):
            share = np.exp(self._likes - self._likes.max())
            share /= share.sum()
            self._a = int(np.searchsorted(share.cumsum(), self._rng.random() * share.sum()))
            self._a = min(self._a, self.actions - 1)
            self._did += np.outer(x, np.eye(self.actions)[self._a] - share)
        return self._a

    def end(self, success: bool, odometry: Odometry) -> None:
        """The episode is over."""
        del odometry, success
        self.episode += 1

    def _sense(self) -> tuple[Array, float, float]:
        """The input, the rise of brightness since the last decision, and the speed of brightening in deviations."""
        one = self.settings
        lux = np.nan_to_num(self._seen()) if self._samples else np.full((1, SENSORS), LUX_MIN)
        z = np.log(np.clip(lux.mean(axis=0), LUX_MIN, LUX_MAX))
        bright = float(z.mean())
        if self._sensed is None:
            self._sensed, self._bright, self._past = z, bright, bright
        self._sensed = one.quick * self._sensed + (1.0 - one.quick) * z
        differs = self._sensed - self._sensed.mean()
        self.used += (1.0 - one.used) * (differs - self.used)
        self.varies += (1.0 - one.used) * ((differs - self.used) ** 2 - self.varies)
        x = np.append((differs - self.used) / np.sqrt(self.varies + 1e-6), 1.0)
        rise = float(self._sensed.mean()) - self._past
        self._past = one.slow * self._past + (1.0 - one.slow) * bright
        self.brightens += (1.0 - one.used) * (rise * rise - self.brightens)
        sensed = float(self._sensed.mean())
        r, self._bright = sensed - self._bright, sensed
        return x, r, rise / float(np.sqrt(self.brightens + 1e-9))

    def _learn(self, x: Array, r: float) -> None:
        """Change promises and synapses by how much the result exceeds the promise."""
        if self._x is None or not self.learns:
            return
        one = self.settings
        self._delta = float(r + (one.gamma * x - self._x) @ self.promises)
        self.promises += one.alpha * self._delta * self._promised
        self.synapses += one.beta * self._delta * self._did

    def decision(self, odometry: Odometry) -> Decision:
        """No state of a table; by how much the result exceeded the promise; the preference for each action."""
        del odometry
        return Decision(None, self._delta, tuple(map(float, self._likes)))

    def table(self) -> StoredTable:
        """The synapses: a row for each sensor and a row for the unit that always fires, a column for each action."""
        about = {
            "agent": self.name,
            "episodes": self.episode,
            "used": self.used.tolist(),
            "varies": self.varies.tolist(),
            "actions": [f"action {a}" for a in range(self.actions)],
            "states": ["FL", "FR", "RL", "RR", "always"],
        }
        return StoredTable(self.synapses.copy(), about)

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later."""
        arrays = {name: getattr(self, name).tolist() for name in ("synapses", "promises", "used", "varies")}
        rng = self._rng.bit_generator.state
        return {**arrays, "brightens": self.brightens, "episode": self.episode, "rng": rng}

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from the result of `memory`."""
        for name in ("synapses", "promises", "used", "varies"):
            setattr(self, name, np.array(memory[name], float))
        self.brightens, self.episode = float(memory["brightens"]), int(memory["episode"])
        self._rng.bit_generator.state = memory["rng"]
