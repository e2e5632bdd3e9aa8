"""Several robots in one room search the light: a parallel environment of PettingZoo (extra `gym`).

    from txt1.learning.parallel_env import LightSeekingParallelEnv
    env = LightSeekingParallelEnv(robots=3)

Observations, actions, rewards and ends are each robot's as in `txt1.learning.env`. They share the room: who touches
another one has failed, as with a post. A robot whose episode is over stands where it is, in the way of the others.
"""

from typing import Any, Final

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray

from txt1.config import Config
from txt1.errors import ConfigError, MissingExtra
from txt1.hal.registry import world_of
from txt1.learning.env import DECISION_MS, REST_MS, SPACE, Observation, Seeker, placed, ready, shows
from txt1.learning.picture import Overview, picture
from txt1.learning.settings import LearningConfig

try:
    from gymnasium.spaces import Discrete
    from pettingzoo import ParallelEnv
except ModuleNotFoundError:
    raise MissingExtra("txt1.learning.parallel_env", "gym") from None

ROBOTS: Final = 3
Told = dict[str, Any]


class LightSeekingParallelEnv(ParallelEnv):  # type: ignore[misc]  # without the extra its types are not known
    """The robots; see the module."""

    metadata: Told = {"name": "txt1_light_seeking_v0", "render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012

    def __init__(self, config: Config | None = None, robots: int = ROBOTS, render_mode: str | None = None) -> None:
        if robots < 1:
            raise ConfigError(f"robots: {robots}; give at least one")
        self.render_mode = shows(render_mode)
        self._config = ready(config)
        if self._config.sim.room.map is not None:
            raise ConfigError("sim.room.map: several robots at once are in a plain room; leave it out")
        self.possible_agents = [f"robot_{k}" for k in range(robots)]
        self.agents: list[str] = []
        self.observation_spaces: dict[str, Space[Any]] = dict.fromkeys(self.possible_agents, SPACE)
        actions = len(self._config.section(LearningConfig).actions)
        self.action_spaces: dict[str, Space[Any]] = {name: Discrete(actions) for name in self.possible_agents}
        self.robots: dict[str, Seeker] = {}
        self._rng = np.random.default_rng()

    def observation_space(self, agent: str) -> Space[Any]:
        """Of each robot: that of `txt1.learning.env`."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        """Of each robot: a number of `learning.actions`."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Told | None = None) -> tuple[dict[str, Observation], Told]:
        """The first observations, at rest on random starts where each has room."""
        del options
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self.agents = list(self.possible_agents)
        room = world_of(self._config)
        self.robots, told = {}, {}
        width, reach = self._config.sim.room.width, self._config.section(LearningConfig).boundary
        # at first each stands at the wall, in nobody's way
        for k, name in enumerate(self.agents):
            aside = (reach * (2.0 * k / max(1, len(self.agents) - 1) - 1.0), 0.5 * width - 0.5, 0.0)
            sim = self._config.sim.model_copy(update={"start": aside})
            own = self._config.model_copy(update={"name": name, "sim": sim})
            self.robots[name], start = placed(own, self._rng, room)
            told[name] = {"optimal_time": start.optimal_time(self.robots[name].task)}
        self._run(REST_MS)
        for robot in self.robots.values():
            robot.rested()
        return {name: robot.observation() for name, robot in self.robots.items()}, told

    def step(self, actions: dict[str, Any]) -> tuple[Told, Told, Told, Told, Told]:
        """Return, for each robot under way, observation, reward, terminated, truncated and `info`.

        Raises ValueError: an action is none of the space, or of a robot that is not under way.
        """
        for name, action in actions.items():
            if name not in self.agents:
                raise ValueError(f"{name} is not under way; there are {', '.join(self.agents) or 'none'}")
            if not self.action_spaces[name].contains(action):
                raise ValueError(f"action {action!r} of {name} is none of {self.action_spaces[name]}")
        for name, action in actions.items():
            self.robots[name].act(int(action))
        self._run(DECISION_MS)
        seen, earned, over, late, told = Told(), Told(), Told(), Told(), Told()
        for name in self.agents:
            robot = self.robots[name]
            success, over[name], late[name] = robot.outcome()
            seen[name], earned[name] = robot.observation(), robot.earned()
            told[name] = {"success": success, "touched": robot.touched}
            if over[name] or late[name]:
                robot.stand()
        self.agents = [name for name in self.agents if not (over[name] or late[name])]
        return seen, earned, over, late, told

    def render(self) -> NDArray[np.uint8] | None:
        """A picture from above, shape (400, 400, 3); None without ``render_mode``."""
        robots = list(self.robots.values())
        if self.render_mode is None or not robots:
            return None
        scene = Overview(self._config, robots[0].light, [each.pose for each in robots], [each.way for each in robots])
        return picture(scene)

    def close(self) -> None:
        """Nothing is open."""

    def _run(self, duration_ms: int) -> None:
        """Let all go on together."""
        for _ in range(duration_ms):
            for robot in self.robots.values():
                robot.tick()
