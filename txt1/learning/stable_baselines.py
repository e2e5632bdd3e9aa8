"""Many robots as Stable-Baselines3 wants them: a VecEnv over `txt1.learning.env.DriveVectorEnv`.

    from stable_baselines3 import PPO
    from txt1.learning.env import DriveVectorEnv
    from txt1.learning.stable_baselines import vec_env
    PPO("MlpPolicy", vec_env(DriveVectorEnv(64, "light"))).learn(300_000)

Stable-Baselines3 is not among the extras, as it brings PyTorch: pip install stable-baselines3. It wants an episode that
has ended to begin anew in the same step, with the last observation in `terminal_observation`; Gymnasium's vector
environments begin it in the next.
"""

from typing import Any

import numpy as np

from txt1.errors import ConfigError
from txt1.learning.env import DriveVectorEnv


def vec_env(robots: DriveVectorEnv) -> Any:
    """Return the robots as a VecEnv; ConfigError: Stable-Baselines3 is not installed."""
    try:
        from stable_baselines3.common.vec_env import VecEnv
    except ModuleNotFoundError:
        raise ConfigError("stable_baselines3: it is not installed: pip install stable-baselines3") from None

    class RobotsVecEnv(VecEnv):  # type: ignore[misc]  # without it its types are not known
        """The robots as a VecEnv; what Stable-Baselines3 asks of single environments, all have alike."""

        def __init__(self) -> None:
            self.render_mode = None
            self._actions: Any = None
            super().__init__(robots.num_envs, robots.single_observation_space, robots.single_action_space)

        def reset(self) -> Any:
            """Return the first observations; `seed` gives the seed before."""
            seeds = getattr(self, "_seeds", None) or [None]
            return robots.reset(seed=seeds[0])[0]

        def step_async(self, actions: Any) -> None:
            """Take the actions that `step_wait` carries out."""
            self._actions = np.asarray(actions)

        def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
            """Return observations, rewards, what has ended, and why."""
            seen, rewards, terminated, truncated, about = robots.step(self._actions)
            over = terminated | truncated
            told: list[dict[str, Any]] = [{} for _ in range(robots.num_envs)]
            for k in np.flatnonzero(over):
                told[k] = {
                    "terminal_observation": seen[k].copy(),
                    "TimeLimit.truncated": bool(truncated[k] and not terminated[k]),
                    "success": bool(about["success"][k]),
                }
            if over.any():
                seen = np.where(over[:, None], robots.reset(options={"reset_mask": over})[0], seen)
            return seen, rewards.astype(np.float32), over, told

        def close(self) -> None:
            """Nothing is open."""

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            """Return the attribute, which all robots have alike."""
            return [getattr(self, attr_name)] * len(self._get_indices(indices))

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            """Set it for all."""
            setattr(self, attr_name, value)

        def env_method(self, method_name: str, *arguments: Any, indices: Any = None, **named: Any) -> list[Any]:
            """Call it once for all."""
            return [getattr(self, method_name)(*arguments, **named)] * len(self._get_indices(indices))

        def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
            """Return that nobody wraps a robot by itself."""
            return [False] * len(self._get_indices(indices))

    return RobotsVecEnv()
