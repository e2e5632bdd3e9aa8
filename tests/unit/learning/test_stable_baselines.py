"""Many robots are a VecEnv: an episode that has ended begins anew in the same step."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from txt1.errors import ConfigError
from txt1.learning.stable_baselines import vec_env


class Robots:
    """Three robots: the second reaches the goal with its first step, the third runs out of time."""

    num_envs, single_observation_space, single_action_space = 3, "seen", "actions"

    def __init__(self) -> None:
        self.begun: list[np.ndarray] = []

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        del seed
        self.begun.append(np.ones(3, bool) if options is None else options["reset_mask"])
        return np.full((3, 2), -1.0, np.float32), {}

    def step(self, actions: np.ndarray) -> tuple[Any, ...]:
        seen = np.repeat(actions[:, None], 2, axis=1).astype(np.float32)
        won = np.array([False, True, False])
        return seen, np.array([-0.5, 9.5, -0.5]), won, np.array([False, False, True]), {"success": won}


class VecEnv:
    """What the base class of Stable-Baselines3 does here."""

    def __init__(self, num_envs: int, observation_space: Any, action_space: Any) -> None:
        self.num_envs, self.observation_space, self.action_space = num_envs, observation_space, action_space

    def _get_indices(self, indices: Any) -> Any:
        return range(self.num_envs) if indices is None else indices


def test_what_has_ended_begins_anew_in_the_same_step(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("stable_baselines3", "stable_baselines3.common", "stable_baselines3.common.vec_env"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    sys.modules["stable_baselines3.common.vec_env"].VecEnv = VecEnv  # type: ignore[attr-defined]
    robots = Robots()
    made = vec_env(robots)  # type: ignore[arg-type]
    assert (made.reset() == -1.0).all()
    made.step_async([0, 1, 2])
    seen, rewards, over, told = made.step_wait()
    assert seen.tolist() == [[0.0, 0.0], [-1.0, -1.0], [-1.0, -1.0]]
    assert rewards.tolist() == [-0.5, 9.5, -0.5] and over.tolist() == [False, True, True]
    assert robots.begun[-1].tolist() == [False, True, True]
    assert told[0] == {}
    assert told[1]["terminal_observation"].tolist() == [1.0, 1.0] and not told[1]["TimeLimit.truncated"]
    assert told[2]["TimeLimit.truncated"] and not told[2]["success"]
    assert made.env_is_wrapped(object) == [False] * 3


def test_without_stable_baselines3_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ConfigError, match="pip install stable-baselines3"):
        vec_env(Robots())  # type: ignore[arg-type]


@pytest.mark.long
def test_the_example_of_ppo_prints_how_it_drives_and_its_network_drives_the_robot(tmp_path: Path) -> None:
    """After three seconds of learning: not well."""
    pytest.importorskip("stable_baselines3", reason="did not run: pip install stable-baselines3")
    pytest.importorskip("onnxruntime", reason="did not run: the extra 'teach'")
    root = Path(__file__).parents[3]
    told = subprocess.run(
        [sys.executable, root / "examples/ppo_drives.py", "light", "0.05"], cwd=tmp_path, capture_output=True, text=True
    ).stdout
    assert re.search(r"[1-9]\d* of 1000 reached the goal, in [\d.]+ s, 1\.\d+ of the floor", told)
    words = ["run", "--headless", "--json", "--speed", "max", "--duration", "5"]
    words += ["--set", "sensors.light.driver=sim_light", "--source", "ppo.onnx", "--card", "ppo.yaml"]
    driven = subprocess.run([sys.executable, "-m", "txt1", *words], cwd=tmp_path, capture_output=True, text=True)
    assert driven.returncode == 0 and abs(json.loads(driven.stdout)["odometry"]["theta"]) > 0.01, driven.stderr
