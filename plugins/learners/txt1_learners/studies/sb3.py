"""The learning task as a vector environment of Stable-Baselines3, and its PPO and DQN as contenders (extra `sb3`).

    from stable_baselines3 import PPO
    from txt1_learners.studies.sb3 import LightSeekingVecEnv
    PPO("MlpPolicy", LightSeekingVecEnv(load().config, 16, seed=1)).learn(200_000)

The robots drive as trials do in lockstep (`txt1_learners.studies.lockstep`), in any world of the configuration: its
vehicle, floor, light, sensors and their faults, actions, delay, obstacles, and `learning.world`. One step is one
decision, 0.1 s as for the learners that drive. The seed of the environment is that of its constructor; `seed()` changes
nothing.

- Observation, as often as `stack` says, the latest last: the logarithms of the means of the four readings since the
  last decision over that of the brightest a sensor can tell, 0 to 1; sensed v (m/s) and omega (rad/s); the action that
  was taken, as zeros and a one. The actions under way are in it, so a delay is part of the state.
- Reward: minus the seconds, plus what the logarithm of the mean reading grew by; -`LOST` outside the boundary, and for
  touching a post, a box or a wall.
- An episode that has ended begins anew at once on a random start, as Stable-Baselines3 expects.
"""

from collections.abc import Callable, Sequence
from math import log, pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1 import Odometry
from txt1.config import Config
from txt1.errors import ConfigError, MissingExtra
from txt1.learning.batch import SENSED, TICK_MS
from txt1.learning.best_time import DECISION_MS
from txt1.learning.settings import LearningConfig
from txt1.learning.solvability import refuse_unsolvable
from txt1.learning.trial import Start, stream, task_of
from txt1.learning.world import settled
from txt1.model.light_sensors import LUX_MAX, LUX_MIN
from txt1_learners.settings import OfStableBaselines
from txt1_learners.studies.lockstep import LIGHT_MS, REST_MS, Lockstep
from txt1_learners.studies.modelled_settings import STEPS, refuse_others

try:
    import torch
    from gymnasium.spaces import Box, Discrete
    from stable_baselines3 import DQN, PPO
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError:
    raise MissingExtra("Stable-Baselines3's learners and their environment", "sb3", "learners") from None

Observation = NDArray[np.float32]
DECISION: Final = 0.001 * DECISION_MS  # s
LOST: Final = 10.0  # what leaving the boundary costs, in seconds
SAMPLES: Final = -(-DECISION_MS // LIGHT_MS)  # of the light in a decision, at most
STACK: Final = 5  # decisions in an observation
ROBOTS: Final = {"ppo": 16, "dqn": 16}  # that drive side by side in training
TRAINED, STARTED = 5, 6  # mark the streams of random values of training, and of its starts
CLASSES: Final[dict[str, type[BaseAlgorithm]]] = {"ppo": PPO, "dqn": DQN}
SETTINGS: Final[dict[str, dict[str, Any]]] = {  # what is not Stable-Baselines3's own; `learning.ppo` and `.dqn` add
    "ppo": {"n_steps": 128, "batch_size": 256, "gamma": 0.99, "learning_rate": 1e-3},
    "dqn": {
        "gamma": 0.99, "learning_rate": 1e-3, "learning_starts": 500, "target_update_interval": 500,
        "buffer_size": 100_000, "train_freq": 1, "gradient_steps": 4,
        "exploration_fraction": 0.2, "policy_kwargs": {"net_arch": [64, 64]},
    },
}  # fmt: skip


class LightSeekingVecEnv(VecEnv):  # type: ignore[misc]  # without the extra its types are not known
    """Robots of one world that look for the light, each for one of its own; see the module.

    Raises ConfigError: a setting is not modelled, or the world cannot be solved.
    """

    def __init__(self, config: Config, robots: int = 16, seed: int = 0, stack: int = STACK) -> None:
        self.config = config = settled(config)
        refuse_others(config, STEPS, "environments of Stable-Baselines3")
        refuse_unsolvable(config)
        self.task = task_of(config)
        self._commands = np.array(config.section(LearningConfig).actions)
        self._frame = 6 + len(self._commands)
        ones = [1.0] * len(self._commands)
        self._low = np.tile([0.0] * 4 + [-2.0, -10.0] + [0.0] * len(ones), stack).astype(np.float32)
        self._high = np.tile([1.0] * 4 + [2.0, 10.0] + ones, stack).astype(np.float32)
        self.render_mode = None
        super().__init__(robots, Box(self._low, self._high), Discrete(len(ones)))
        self._starts = stream(seed, 1, STARTED).numpy()
        self._robots = Lockstep(config, np.zeros((robots, 3)), stream(seed, 1, TRAINED).numpy())
        self.seen = np.zeros((robots, stack * self._frame), np.float32)
        self._bright = np.zeros(robots)
        self._steps = np.zeros(robots, int)
        self._late = round(self.task.delay / DECISION)
        self._under_way: list[NDArray[np.float64]] = []  # commands, the next to reach the robots first
        self._actions = np.zeros(robots, np.int64)

    # -- as Stable-Baselines3 has it -----------------------------------------------------------------------------

    def reset(self) -> Observation:
        """The first observations, at rest on random starts."""
        self._begin(np.arange(self.num_envs))
        return self.seen.copy()

    def step_async(self, actions: NDArray[np.int64]) -> None:
        """Take actions, shape (robots,); `step_wait` carries them out. ValueError: they are not in the space."""
        given = np.asarray(actions)
        whole = given.shape == (self.num_envs,) and given.dtype.kind in "iu"
        if not whole or not ((given >= 0) & (given < len(self._commands))).all():
            raise ValueError(f"actions {actions!r}: give {self.num_envs} of 0 to {len(self._commands) - 1}")
        self._actions = given.astype(np.int64)

    def step_wait(self) -> tuple[Observation, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Observations, rewards, what has ended and why, one decision later."""
        before = self._bright.copy()
        success, lost, late = self.drive(self._actions)
        rewards = self._bright - before - DECISION - LOST * lost
        over = success | lost | late
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for k in np.flatnonzero(over):
            told[k] = {
                "terminal_observation": self.seen[k].copy(),
                "TimeLimit.truncated": bool(late[k]),
                "success": bool(success[k]),
            }
        if over.any():
            self._begin(np.flatnonzero(over))
        return self.seen.copy(), rewards.astype(np.float32), over, told

    def close(self) -> None:
        """Nothing is open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute, which all robots have alike."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set it for all."""
        del indices
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call it, once, for all."""
        result = getattr(self, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Nobody wraps a robot by itself."""
        del wrapper_class
        return [False for _ in self._get_indices(indices)]

    # -- the robots ----------------------------------------------------------------------------------------------

    def place(self, where: Sequence[Start]) -> Observation:
        """Put all robots on starts of your own; the first observations."""
        self._begin(np.arange(self.num_envs), where)
        return self.seen.copy()

    def drive(self, actions: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
        """Drive on by a decision; who has the goal, who left the boundary or touched something, whose time is over."""
        self._under_way.append(self._commands[actions])
        commands, worlds = self._under_way.pop(0), self._robots.worlds
        if worlds:
            asked = zip(worlds, self._robots.since.tolist(), commands.tolist(), strict=True)
            commands = np.array([world.command(since, (v, omega)) for world, since, (v, omega) in asked])
        self._advance(np.arange(self.num_envs), commands, DECISION_MS, actions)
        self._steps += 1
        task, touched = self.task, self._robots.touched
        x, y = self._robots.told()[:2]
        goals = [world.goal(since) for world, since in zip(worlds, self._robots.since.tolist(), strict=False)]
        light = np.array(goals or [task.light]).T
        success = (np.hypot(x - light[0], y - light[1]) <= task.goal_radius) & ~touched
        lost = ((np.maximum(abs(x), abs(y)) > task.boundary) & ~success) | touched
        late = (self._steps * DECISION > task.time_limit) & ~success & ~lost
        return success, lost, late

    def _begin(self, which: NDArray[np.intp], where: Sequence[Start] | None = None) -> None:
        """Put some robots on new starts, where they rest until they have seen."""
        if where is None:
            where = [Start(*map(float, pair)) for pair in self._starts.uniform(-pi, pi, (len(which), 2))]
        self._robots.place(which, np.array([start.pose(self.task) for start in where]))
        if len(which) == self.num_envs:
            self._under_way = [np.zeros((self.num_envs, 2)) for _ in range(self._late)]
        for commands in self._under_way:
            commands[which] = 0.0
        self.seen[which] = 0.0
        self._steps[which] = 0
        self._advance(which, np.zeros((len(which), 2)), REST_MS, None)

    def _advance(
        self, which: NDArray[np.intp], commands: NDArray[np.float64], duration: int, actions: NDArray[np.int64] | None
    ) -> None:
        """Let some drive on, ms, and see."""
        lux, seen_from = self._robots.advance(which, commands, duration // TICK_MS)
        means = np.clip(np.nan_to_num(lux[-SAMPLES:]).mean(axis=0), LUX_MIN, LUX_MAX)
        frame = np.zeros((len(which), self._frame))
        frame[:, :4] = np.log(means) / log(LUX_MAX)
        frame[:, 4:6] = self._robots.robots[SENSED : SENSED + 2, which].T
        if self._robots.worlds:
            since = self._robots.since
            told = [
                self._robots.worlds[k].odometry(float(since[k]), Odometry(*seen_from[-1, i].tolist()))
                for i, k in enumerate(which.tolist())
            ]
            frame[:, 4:6] = [each[3:] for each in told]
        if actions is not None:
            frame[np.arange(len(which)), 6 + actions] = 1.0
        self.seen[which] = np.concatenate([self.seen[which, self._frame :], frame], axis=1)
        np.clip(self.seen, self._low, self._high, out=self.seen)
        self._bright[which] = np.log(means).mean(axis=1)


# -- contenders ------------------------------------------------------------------------------------------------------

Outcome = tuple[float, bool]  # time to the end of an episode, s, and whether that was the goal


def train(
    name: str, config: Config, seed: int, checkpoints: Sequence[float], check: Callable[[float, BaseAlgorithm], None]
) -> BaseAlgorithm:
    """Have `ppo` or `dqn` learn until the last checkpoint; `check` is told each with the seconds driven in all.

    Seconds are those of all its robots together. One thread, so that a seed repeats itself.

    Raises ConfigError: `learning.ppo` or `.dqn` has a setting that Stable-Baselines3 does not know.
    """
    torch.set_num_threads(1)
    env = LightSeekingVecEnv(config, ROBOTS[name], seed)
    own = config.section(LearningConfig).part(name, OfStableBaselines())
    try:
        model = CLASSES[name]("MlpPolicy", env, seed=seed % 2**31, device="cpu", **{**SETTINGS[name], **own})
    except TypeError as error:
        raise ConfigError(f"learning.{name}: {own}: {error}") from None
    left = sorted(checkpoints)

    def step(of: dict[str, Any], _: dict[str, Any]) -> bool:
        driven = of["self"].num_timesteps * DECISION
        if len(left) > 1 and driven >= left[0]:
            left.pop(0)
            check(driven, model)
        return True

    model.learn(round(left[-1] / DECISION), callback=step)
    check(model.num_timesteps * DECISION, model)
    return model


def drive(model: BaseAlgorithm, config: Config, where: Sequence[Start], seed: int) -> list[Outcome]:
    """Let a model drive from starts, one robot each, learning nothing, by its best action."""
    env = LightSeekingVecEnv(config, len(where), seed)
    seen = env.place(where)
    found: dict[int, Outcome] = {}
    step = 0
    while len(found) < len(where):
        actions, _ = model.predict(seen, deterministic=True)
        success, lost, late = env.drive(actions)
        seen = env.seen
        step += 1
        for k in np.flatnonzero(success | lost | late).tolist():
            found.setdefault(k, (step * DECISION, bool(success[k])))
    return [found[k] for k in range(len(where))]
