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
from txt1.learning.drive_tasks import ToLight
from txt1.learning.env import REST_MS, Drives, Observation, OneBody, ready, shows, spaces, start_of
from txt1.learning.picture import Overview, picture
from txt1.learning.settings import LearningConfig
from txt1.learning.trial import task_of

try:
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
        self.task = ToLight(self._config)
        made = {name: spaces(self.task) for name in self.possible_agents}
        self.observation_spaces: dict[str, Space[Any]] = {name: seen for name, (seen, _) in made.items()}
        self.action_spaces: dict[str, Space[Any]] = {name: acts for name, (_, acts) in made.items()}
        self.robots: dict[str, Drives] = {}
        self._rng = np.random.default_rng()

    def observation_space(self, agent: str) -> Space[Any]:
        """Of each robot: that of `txt1.learning.env`."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        """Of each robot: a number of `learning.actions`."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Told | None = None) -> tuple[dict[str, Observation], Told]:
        """The first observations, at rest on random starts where each has room."""
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
            self.robots[name] = Drives(ToLight(own), OneBody(own, self.task, room))
            self.robots[name].place(np.ones(1, bool), self._rng)
            start = start_of(np.array(body_of(self.robots[name]).pose), own)
            told[name] = {"optimal_time": start.optimal_time(task_of(own))}
        self._run(REST_MS)
        return {name: robot.begin(np.ones(1, bool))[0] for name, robot in self.robots.items()}, told

    def step(self, actions: dict[str, Any]) -> tuple[Told, Told, Told, Told, Told]:
        """Return, for each robot under way, observation, reward, terminated, truncated and `info`.

        Raises ValueError: an action is none of the task's, or of a robot that is not under way.
        """
        if strange := actions.keys() - {*self.agents}:
            raise ValueError(f"{', '.join(strange)} is not under way; there are {', '.join(self.agents) or 'none'}")
        commands = {name: self.task.driven(np.asarray(action)[None])[0].tolist() for name, action in actions.items()}
        for name, (v, omega) in commands.items():
            body_of(self.robots[name]).act(v, omega)
        self._run(round(1000.0 * self.task.period))
        seen, earned, over, late, told = Told(), Told(), Told(), Told(), Told()
        for name in self.agents:
            robot = self.robots[name]
            found, (rewards, success, lost), times = robot.judged(np.zeros(1, bool))
            over[name], late[name] = bool(success[0] | lost[0]), bool(times[0])
            seen[name], earned[name] = found[0], float(rewards[0])
            told[name] = {"success": bool(success[0]), "touched": body_of(robot).touched}
            if over[name] or late[name]:
                body_of(robot).stand()
        self.agents = [name for name in self.agents if not (over[name] or late[name])]
        return seen, earned, over, late, told

    def render(self) -> NDArray[np.uint8] | None:
        """A picture from above, shape (400, 400, 3); None without ``render_mode``."""
        robots = list(map(body_of, self.robots.values()))
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
                body_of(robot).tick()


def body_of(robot: Drives) -> OneBody:
    """Return the robot's body."""
    assert isinstance(robot.bodies, OneBody)
    return robot.bodies
