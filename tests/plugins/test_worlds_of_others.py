"""A world of another package drives the running robot; what it does wrong is one line."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from txt1.cli import execute
from txt1.config import Config, load
from txt1.errors import ConfigError
from txt1.learning.command.trials import on_robot
from txt1.learning.experiment import Plan
from txt1.learning.trial import Episode

SITE = Path(__file__).parent / "site"
SHORT = ["learning.goal_period=0.1", "learning.time_limit=4", "learning.world=odd"]


def running(config: Config, episodes: int = 3) -> list[Episode]:
    return on_robot(Plan("thesis", 1, episodes, 1, config), 1).episodes


def test_one_that_moves_the_goal_and_brings_a_post(monkeypatch: pytest.MonkeyPatch) -> None:
    check_one_that_moves_the_goal(running, monkeypatch)


def check_one_that_moves_the_goal(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check a way to do trials, on a running robot or in lockstep."""
    monkeypatch.syspath_prepend(SITE)
    from plugin_world import Odd

    begun: list[int] = []
    monkeypatch.setattr(Odd, "begin", lambda self, episode: begun.append(episode))
    config = load(overrides=SHORT).config
    episodes = run(config)
    assert begun == [1, 2, 3]
    assert len(episodes) == 3
    monkeypatch.setattr(Odd, "goal", lambda self, now: (1.25, 0.0) if now > 1.0 else (5.0, 0.0))
    near = load(overrides=[*SHORT, "learning.goal_radius=1.24"]).config
    assert min(each.time for each in run(near, 8)) > 0.3, "at first the goal was far away"
    monkeypatch.undo()
    monkeypatch.syspath_prepend(SITE)
    monkeypatch.setattr(Odd, "goal", lambda self, now: (3.0, 0.0))
    monkeypatch.setattr(Odd, "settings", lambda config: {"sim.obstacles": post(3.0, 0.0, 0.3)})
    config = load(overrides=[*SHORT, "learning.time_limit=25", "sim.room.light=[3,0]"]).config
    touched = [each for each in run(config, 12) if each.touched]
    assert touched and not any(each.success for each in touched), "which ends an episode, and not the trial"


def post(x: float, y: float, radius: float) -> list[dict[str, Any]]:
    return [{"kind": "post", "x": x, "y": y, "radius": radius}]


@pytest.mark.parametrize(
    ("method", "body", "told"),
    [
        ("settings", "raise ValueError('no luck')", "failed in settings: ValueError: no luck"),
        ("begin", "raise ValueError('no luck')", "failed in begin: ValueError: no luck"),
        ("see", "raise ValueError('no luck')", "failed in see: ValueError: no luck"),
        ("see", "raise SystemExit(7)", "failed in see: SystemExit: 7"),
        ("see", "return 3.0", "see returned 3.0; return 4 numbers"),
        (
            "odometry",
            "return [float('nan')] * 5",
            "odometry returned [nan, nan, nan, nan, nan]; return 5 finite numbers",
        ),
        ("command", "return ('fast', 0.0)", "command returned ('fast', 0.0); return 2 finite numbers"),
        ("goal", "return None", "goal returned None; return 2 finite numbers"),
        ("__init__", "raise ValueError('no luck')", "cannot be made: ValueError: no luck"),
    ],
)
def test_one_that_fails_is_one_line(
    method: str,
    body: str,
    told: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    static = "    @staticmethod\n" if method == "settings" else ""
    text = f"from plugin_world import Odd\n\n\nclass create(Odd):\n{static}    def {method}(*given):\n        {body}\n"
    (tmp_path / "plugin_wrong_world.py").write_text(text)
    point = EntryPoint("wrong", "plugin_wrong_world:create", "txt1.worlds")
    monkeypatch.setattr("txt1.plugins.entry_points", lambda group, name=None: [point] if "worlds" in group else [])
    for folder in (SITE, tmp_path):
        monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "plugin_wrong_world", raising=False)
    words = ["--agent", "thesis", "--trials", "1", "--episodes", "2", "--seed", "1", "--out", str(tmp_path / "out")]
    assert execute(["learn", *words, "--set", "learning.world=wrong"]) == 1
    _, line = capsys.readouterr().err.splitlines()
    assert "the world 'wrong' (plugin_wrong_world:create)" in line and line.endswith(told)


def test_options_without_a_world_are_refused_and_so_is_a_second_light() -> None:
    for settings, told in (
        (["learning.world_options={ambient: 1}"], "no world is asked for; set learning.world=composed"),
        (["learning.world=composed", "sensors.light.driver=sim_light"], "the world 'composed' says what light sensors"),
    ):
        with pytest.raises(ConfigError, match=told):
            running(load(overrides=settings).config, 1)
