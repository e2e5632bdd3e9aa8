"""The thesis's learner, line for line: eight sectors, three actions, tabular Q-learning (thesis 5.2 to 5.5).

How it works. The filtered readings tell the light's direction, and that one of eight sectors: the state
(`txt1.learning.light_direction`). Twice a second it draws an action by the table's row (`boltzmann`); the temperature
falls from episode to episode, so it tries less and less. The reward tells whether the last action has turned the robot
towards the light, and moves one number of the table (`txt1.learning.qtable.update`). An action takes effect late, so
the number that moves is that of the action which the odometry shows (remedy 2), not of the one that was commanded.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp
from typing import Any, ClassVar, Final

from mypy_extensions import mypyc_attr

from txt1.config import Config
from txt1.errors import NoDirection
from txt1.learning.agent import Decision, Learned, Rows
from txt1.learning.light_direction import (
    SECTORS,
    LightFilter,
    corrected_direction,
    diagonal_direction,
    direction,
    reward,
    sector,
    spread_limit,
)
from txt1.learning.qtable import ACTIONS, STATES, StoredTable, Table, initial, update
from txt1.learning.settings import LearningConfig, ThesisConfig
from txt1.learning.trial import COMMANDS, Commands
from txt1.model.light_sensors import Readings
from txt1.model.odometry import Odometry
from txt1.sim.lamp import PointLight, illuminances
from txt1.sim.pcg64 import Draws

# remedy 1: a command is reached when speed and yaw rate are this near to it, m/s and rad/s (O)
COMMAND_REACHED: Final = 0.15
# remedy 2: a yaw rate beyond this counts as a turn, rad/s: a third of the range of +-0.54 (5.4)
SENSED: Final = 0.18
# factor of a fading learning rate, from an episode to the next
RATE_DECAY: Final = 0.9

DIRECTIONS: Final = {"summed": direction, "diagonal": diagonal_direction, "corrected": corrected_direction}

# Q-values after 30 repetitions on hardware; rows by state, columns by action (table 5.3)
TABLE_5_3: Final[tuple[tuple[float, ...], ...]] = (
    (0.9494, -0.6495, -0.5848),
    (0.7950, -0.0449, -0.2863),
    (0.7120, 0.1365, -0.3091),
    (0.4466, 0.1255, -0.0286),
    (0.8803, 1.4476, 1.1834),
    (0.3014, 0.3008, 0.8993),
    (-0.5585, -0.0546, 1.1205),
    (-0.3775, 0.0077, 0.8443),
)
# stands beside the learned table in the pictures
REPORTED: Final = ("table 5.3 of the thesis", TABLE_5_3)


def boltzmann(q: Sequence[float], temperature: float) -> list[float]:
    """Probabilities of one state's actions, exp(Q / T) / sum of exp(Q / T) (5.2)."""
    # subtracted first, which changes nothing but an overflow
    largest = max(q)
    weights = [exp((value - largest) / temperature) for value in q]
    total = 0.0
    # sum() rounds otherwise from Python 3.12 on
    for weight in weights:
        total += weight
    return [weight / total for weight in weights]


def choose(probabilities: Sequence[float], rng: Draws) -> int:
    """Draw an action with these probabilities, by the cumulative sum and a random number."""
    u = rng.random()
    cumulative = 0.0
    for action, probability in enumerate(probabilities):
        cumulative += probability
        if u < cumulative:
            return action
    # the sum was rounded to a little less than 1
    return max(range(len(probabilities)), key=probabilities.__getitem__)


def greedy_action(q: Sequence[float], rng: Draws) -> int:
    """The action with the largest Q-value; among equal values a random draw, as the lowest index would favour right."""
    largest = max(q)
    best = [action for action, value in enumerate(q) if value == largest]
    return best[0] if len(best) == 1 else best[int(rng.integers(len(best)))]


def fading(episode: int, start: float, decay: float, floor: float = 0.0) -> float:
    """Return start decay^k for episode k, from 0, but at least the floor: a temperature or a learning rate (5.4)."""
    return max(floor, start * decay**episode)


def state_learning_rate(visits: int) -> float:
    """Return the learning rate of a state after `visits` updates; with it Q-learning converges (5.2.1)."""
    return 1.0 / (1.0 + visits / 10.0)


def create(config: Config, rng: Draws, table: StoredTable | None = None) -> ThesisAgent:
    """Return a learner as configured, or a driver by a stored table; ValueError: the table has another shape."""
    learning = config.section(LearningConfig)
    driving = {} if table is None else {"policy": "greedy", "training": 0, "learn_on": False}
    settings = learning.thesis.model_copy(update=driving)
    agent = ThesisAgent(rng, learning.actions, settings, float(config.sim.light.exponent))
    if table is not None:
        agent.q = _copy(table.shaped(STATES, len(learning.actions)))
    return agent


@mypyc_attr(allow_interpreted_subclasses=True)
class ThesisAgent:
    """Q-learning on the light's direction in eight sectors; `exponent` is the light's power of distance.

    `commands` are (v, omega) of each action, m/s and rad/s, which remedy 1 compares with the sensed velocities.
    """

    name: ClassVar[str] = "thesis"

    def __init__(self, rng: Draws, commands: Commands, settings: ThesisConfig, exponent: float = 2.0) -> None:
        self.settings = settings
        self.q: Table = initial(rng, actions=len(commands))
        self.episode = 0
        self.visits = [0] * STATES
        self.decisions = 0
        self._rng = rng
        self._commands = commands
        self._direction = DIRECTIONS[settings.direction]
        self.filter = LightFilter(spread_limit(exponent))
        # only without a filter
        self._sample: Readings | None = None
        self.begin()

    def begin(self) -> None:
        """An episode begins."""
        self.filter.clear()
        self._s: int | None = None
        self._earned: float | None = None
        self._a = -1
        self._due = 0.0
        self._reaching = False
        self._before = _copy(self.q), self.visits[:]

    def see(self, readings: Readings, odometry: Odometry) -> None:
        """One sample of the light, lux."""
        self.filter.step(readings)
        if not self.settings.filtered:
            self._sample = readings

    @property
    def ready(self) -> bool:
        """Whether the filter has settled."""
        return self.filter.settled

    def state(self) -> int | None:
        """The sector of the light now; None if the sensors tell no direction."""
        sample = self.filter.readings if self.settings.filtered else self._sample
        assert sample is not None
        try:
            return sector(self._direction(sample))
        except NoDirection:
            return None

    def sensed(self, odometry: Odometry) -> int:
        """The action that the robot seems to carry out (figure 5.7); the nearest, if the thesis has no such action."""
        if self._commands != COMMANDS:
            return min(range(len(self._commands)), key=lambda a: abs(self._commands[a][1] - odometry.omega))
        return 0 if odometry.omega < -SENSED else 2 if odometry.omega > SENSED else 1

    def waits(self, now: float, odometry: Odometry) -> bool:
        """Whether the action in force goes on."""
        if self._a < 0:
            return False
        if self._reaching:
            v, omega = self._commands[self._a]
            if abs(odometry.v - v) > COMMAND_REACHED or abs(odometry.omega - omega) > COMMAND_REACHED:
                return True
            self._reaching = False
            self._s = self.state()
            self._due = now + self.settings.period
        return now < self._due - 1e-9

    def act(self, now: float, odometry: Odometry) -> int:
        """Learn from the last action, and choose the next one."""
        s_next = self.state()
        self._earned = self._learn(s_next, odometry)
        self._s = s_next
        self._a = self.choose(s_next)
        self.decisions += 1
        self._due = now + self.settings.period
        self._reaching = self.settings.remedy == "hold"
        return self._a

    def _learn(self, s_next: int | None, odometry: Odometry) -> float | None:
        """Update the table (5.1) and return the reward; None: without two directions nothing is learned."""
        if self._a < 0 or self._s is None or s_next is None or not (self.training or self.settings.learn_on):
            return None
        a = self.sensed(odometry) if self.settings.remedy == "sensed" else self._a
        earned = reward(self._s, s_next)
        update(self.q, self._s, a, earned, s_next, self._alpha(self._s), self.settings.gamma)
        self.visits[self._s] += 1
        return earned

    def _alpha(self, s: int) -> float:
        one = self.settings
        if one.rate == "per_state":
            return state_learning_rate(self.visits[s])
        return fading(self.episode, one.alpha, 1.0 if one.rate == "constant" else RATE_DECAY)

    def choose(self, s: int | None) -> int:
        """Return the action for a state by the policy; any action for an unknown state."""
        one = self.settings
        if s is None or (one.policy == "random" and self.training):
            return int(self._rng.integers(len(self.q[0])))
        if one.policy == "greedy" or not self.training:
            return greedy_action(self.q[s], self._rng)
        steps = self.episode if one.cooling == "episodes" else self.decisions
        temperature = fading(steps, one.temperature, one.temperature_decay, one.temperature_floor)
        return choose(boltzmann(self.q[s], temperature), self._rng)

    @property
    def training(self) -> bool:
        """Whether it still explores."""
        return self.settings.training is None or self.episode < self.settings.training

    def end(self, success: bool, odometry: Odometry) -> None:
        """The episode is over; leaving the boundary teaches nothing (O)."""
        s_next = self.state()
        self._earned = self._learn(s_next, odometry) if success else None
        self._s = s_next
        self.episode += 1

    def decision(self, odometry: Odometry) -> Decision:
        """Sector, reward, and the sector's row of the table."""
        values = () if self._s is None else tuple(self.q[self._s])
        return Decision(self._s, self._earned, values)

    def void(self) -> None:
        """Forget what was learned since `begin`."""
        self.q, self.visits = self._before

    def shared(self) -> Learned:
        """The Q-table, and how often each sector was updated."""
        return Learned(self.name, self.episode, tuple(self.visits), tuple([tuple(row) for row in self.q]))

    def take(self, rows: Rows, taken: Sequence[bool], episodes: int) -> int:
        """Take over a table; the temperature also falls by the others' episodes."""
        self.q = _copy(rows)
        self.episode += episodes
        return sum(taken)

    def table(self) -> StoredTable:
        """The Q-table, and the name of its agent."""
        count = len(self._commands)
        about = {
            "agent": self.name,
            "episodes": self.episode,
            "actions": list(ACTIONS) if count == len(ACTIONS) else [f"action {a}" for a in range(count)],
            "states": list(SECTORS),
            "commands": [list(each) for each in self._commands],
            "direction": self.settings.direction,
            "settings": self.settings.model_dump(mode="json"),
        }
        return StoredTable(_copy(self.q), about)

    def memory(self) -> dict[str, Any]:
        """All that it needs to carry on later."""
        rng = self._rng.bit_generator.state
        counts = {"episode": self.episode, "decisions": self.decisions}
        return {"q": _copy(self.q), "visits": self.visits[:], **counts, "rng": rng}

    def recall(self, memory: dict[str, Any]) -> None:
        """Carry on from the result of `memory`."""
        self.q = _copy(memory["q"])
        self.visits = [int(count) for count in memory["visits"]]
        self.episode, self.decisions = int(memory["episode"]), int(memory.get("decisions", 0))
        self._rng.bit_generator.state = memory["rng"]


def _copy(rows: Rows) -> Table:
    return [[float(value) for value in row] for row in rows]


def courses(table: StoredTable, lights: Rows) -> list[float]:
    """Return the yaw rate that a stored table commands for each place of the light, (x, y) in the robot's frame, m."""
    seen = DIRECTIONS.get(str(table.about.get("direction")), direction)
    commands = table.about.get("commands", COMMANDS)
    best = [max(range(len(row)), key=list(row).__getitem__) for row in table.values]
    sectors = [sector(seen(illuminances(0.0, 0.0, 0.0, PointLight(float(x), float(y))))) for x, y in lights]
    return [float(commands[best[s]][1]) for s in sectors]
