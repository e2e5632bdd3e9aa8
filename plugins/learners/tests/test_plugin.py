"""The learners as txt1 finds them: by their names, in a fleet, and by their stored tables."""

from __future__ import annotations

import tomllib
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from txt1.cli import execute
from txt1.config import Config
from txt1.errors import ConfigError, QTableError
from txt1.learning.qtable import StoredTable, save
from txt1.learning.registry import LEARNERS, from_table, make, of_module
from txt1.unknown import missing
from txt1_learners import pilot, sweeps
from txt1_learners.sharing import sharer

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
NAMES = sorted(PROJECT["entry-points"]["txt1.learners"])


def test_txt1_says_of_each_learner_where_it_is_found() -> None:
    assert set(NAMES) <= {point.name for point in entry_points(group="txt1.learners")}
    assert missing(LEARNERS.group, LEARNERS.names()) == {}


@pytest.mark.parametrize("name", NAMES)
def test_it_is_made_by_its_name(name: str) -> None:
    agent = make(name, Config(), np.random.default_rng(1))
    assert agent.name == name
    assert type(agent).__module__ == f"txt1_learners.{name}"


@pytest.mark.parametrize("learner", ["neural", "taxis", pytest.param("pilot", marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "about", [{}, {"knows": {"survey": [1.0]}, "scale": "x", "used": [1.0], "varies": None, "level": []}]
)
def test_a_table_without_what_its_learner_keeps_with_it_is_refused(
    tmp_path: Path, learner: str, about: dict[str, Any]
) -> None:
    rng = np.random.default_rng(1)
    path = tmp_path / "qtable.json"
    shape = make(learner, Config(), rng).table().values.shape
    save(path, StoredTable(np.zeros(shape), {"agent": learner, **about}))
    with pytest.raises(QTableError):
        from_table(path, Config(), rng)


def test_a_wrong_setting_is_told_by_its_key(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["learn", "--agent", "taxis", "--set", "learning.taxis.beta=-1"]) == 2
    assert "learning.taxis.beta" in capsys.readouterr().err


def test_taxis_shares_nothing() -> None:
    with pytest.raises(ConfigError, match="--share: the learner 'taxis' shares nothing; choose thesis"):
        sharer("taxis", make("taxis", Config(), np.random.default_rng(0)))


def test_it_drives_by_what_it_learned(tmp_path: Path) -> None:
    words = ["--agent", "taxis", "--trials", "1", "--episodes", "1", "--seed", "1", "--no-pictures", "--jobs", "1"]
    assert execute(["learn", *words, "--out", str(tmp_path / "out")]) == 0
    table = str(tmp_path / "out" / "qtable.json")
    assert execute(["run", "--policy", table, "--duration", "2", "--seed", "1", "--speed", "max", "--json"]) == 0


def test_a_learners_module_says_which_way_it_drives_and_whether_its_table_is_shown() -> None:
    assert of_module("sweeps", "courses", None) is sweeps.courses
    assert of_module("pilot", "courses", None) is pilot.courses
    assert not any(of_module(name, "TABLE_IS_DRAWN", True) for name in ("sweeps", "pilot"))


@pytest.mark.parametrize(
    "setting", ["learning.pilot.period=1", "learning.ppo.learning_rate=0.5", "learning.drift.x=[0,1]"]
)
@pytest.mark.parametrize("learner", ["thesis", "sweeps"])
def test_a_setting_that_the_learner_does_not_read_is_refused(
    setting: str, learner: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = f"--set {setting.partition('=')[0]}: the learner '{learner}' does not read it"
    assert execute(["learn", "--agent", learner, "--set", setting, "--out", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err
    assert execute(["run", "--headless", "--duration", "1", "--learn", learner, "--set", setting]) == 2
    assert told in capsys.readouterr().err


def test_no_running_robot_takes_a_world_that_changes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["learn", "--jobs", "1", "--world", "change-slip", "--out", str(tmp_path / "out")]) == 2
    assert "learning.changes: no running robot reads it, only studies do" in capsys.readouterr().err


def test_a_wrong_change_of_the_world_is_told_by_its_key(capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["config", "show", "--set", "learning.changes=[{episode: 0, set: {}}]"]) == 2
    assert "learning.changes.0.episode: 0: input should be greater than 0" in capsys.readouterr().err
