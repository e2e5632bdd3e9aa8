"""A world of another package drives trials in lockstep as it does the running robot; what it does wrong is one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.plugins.test_worlds_of_others import SHORT, SITE, check_one_that_moves_the_goal
from txt1.config import Config, load
from txt1.errors import Txt1Error
from txt1.learning.registry import make
from txt1.learning.trial import Episode
from txt1_learners.studies.__main__ import main
from txt1_learners.studies.lockstep import trials


def lockstep(config: Config, episodes: int = 3) -> list[Episode]:
    (one,) = trials(config, lambda rng: make("thesis", config, rng), [1], episodes, 1)
    return one.episodes


@pytest.mark.long  # it compiles
def test_one_that_moves_the_goal_and_brings_a_post(monkeypatch: pytest.MonkeyPatch) -> None:
    check_one_that_moves_the_goal(lockstep, monkeypatch)


@pytest.mark.long  # it compiles
def test_a_folder_with_wrong_worlds_goes_on_with_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / "worlds", tmp_path / "out"
    folder.mkdir()
    (folder / "far.yaml").write_text("sim: {room: {light: [9.0, 0.0]}}\n")
    (folder / "good.yaml").write_text("learning: {time_limit: 1.0, world: composed, world_options: {ambient: 5.0}}\n")
    (folder / "nowhere.yaml").write_text("learning: {world: nowhere}\n")
    (folder / "nonsense.yaml").write_text("learning: {world: composed, world_options: {ambient: -5.0}}\n")
    (folder / "wrong.yaml").write_text("learning: [\n")
    names = ["--world", "far,good,nowhere,nonsense,wrong", "--agent", "thesis"]
    words = ["worlds", str(folder), *names, "--trials", "1", "--episodes", "1", "--out", str(out), "--jobs", "1"]
    assert main([*words, "--seed", "1"]) == 1
    table = (out / "table.md").read_text()
    for name, told in {
        "far": "outside learning.boundary",
        "nowhere": "there is no world 'nowhere'",
        "nonsense": "learning.world_options.ambient",
        "wrong": "wrong.yaml",
    }.items():
        assert f"| {name} | wrong: " in table and told in table.split(f"| {name} |")[1].split("\n")[0]
    assert json.loads((out / "thesis" / "good.json").read_text())["floor_leaves_out"] == []
    capsys.readouterr()


@pytest.mark.long  # it compiles
@pytest.mark.parametrize("method", ["settings", "begin", "see", "odometry", "command", "goal"])
def test_one_that_fails_in_lockstep_is_a_line_too(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(SITE)
    from plugin_world import Odd

    monkeypatch.setattr(Odd, method, lambda *given: 1 / 0)
    with pytest.raises(Txt1Error, match=f"the world 'odd' .* failed in {method}: ZeroDivisionError: division by zero"):
        lockstep(load(overrides=SHORT).config, 1)
