"""A learner of a plug-in that is not installed is one line with the command that installs it."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint, EntryPoints, PackageNotFoundError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from txt1.cli import execute
from txt1.config import flatten
from txt1.config.sources import recorded, with_values
from txt1.errors import MissingPlugin
from txt1.installing import installs_plugin
from txt1.learning.qtable import StoredTable, save
from txt1.learning.registry import LEARNERS
from txt1.learning.settings import LearningConfig
from txt1.unknown import brought, missing

ROOT = Path(__file__).parents[2]
Capture = pytest.CaptureFixture[str]


def no_entry_points(group: str, name: str | None = None) -> EntryPoints:
    return EntryPoints()


@pytest.fixture(autouse=True)
def no_plugin_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(group: str, name: str | None = None) -> list[EntryPoint]:
        return []

    monkeypatch.setattr("txt1.plugins.entry_points", none)


@pytest.mark.parametrize("name", sorted(brought(LEARNERS.group)))
def test_its_name_tells_the_command(name: str, tmp_path: Path, capsys: Capture) -> None:
    command = installs_plugin(brought(LEARNERS.group)[name])
    told = f"the learner '{name}' is in the plug-in txt1-learners, which is not installed: {command}"
    assert execute(["learn", "--agent", name, "--out", str(tmp_path / "out")]) == 2
    assert execute(["run", "--learn", name, "--duration", "1", "--json"]) == 2
    one, other = capsys.readouterr().err.splitlines()
    assert one.endswith(told) and other.endswith(told)
    assert not (tmp_path / "out").exists()


def test_a_stored_table_tells_the_command(tmp_path: Path, capsys: Capture) -> None:
    table = tmp_path / "qtable.json"
    save(table, StoredTable(np.zeros((5, 3)), {"agent": "taxis"}))
    assert execute(["run", "--policy", str(table), "--duration", "1", "--json"]) == 1
    (told,) = capsys.readouterr().err.splitlines()
    assert told.endswith(
        f"{table}: was learned by 'taxis', in a plug-in that is not installed; {installs_plugin('learners')}"
    )


def test_the_help_names_it(capsys: Capture) -> None:
    assert "taxis" in missing(LEARNERS.group, LEARNERS.names()) and "taxis" not in LEARNERS.names()
    assert execute(["learn", "--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert f"taxis after {installs_plugin('learners')}" in shown


def test_a_misspelt_name_is_told_the_right_one(capsys: Capture) -> None:
    assert execute(["learn", "--agent", "taxi"]) == 2
    assert capsys.readouterr().err.endswith("did you mean 'taxis'?\n")


def test_the_command_names_the_folder_of_a_checkout(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def unknown(name: str) -> None:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("txt1.installing.distribution", unknown)
    monkeypatch.chdir(ROOT)
    assert installs_plugin("learners").endswith(" ./plugins/learners")
    assert installs_plugin("dancers").endswith(" txt1-dancers"), "of an index"
    monkeypatch.chdir(tmp_path)
    assert installs_plugin("learners").endswith(f" {ROOT / 'plugins/learners'}")
    monkeypatch.setattr("txt1.installing.find_spec", lambda name: None)
    assert installs_plugin("learners").startswith(f"uv pip install --python {sys.executable} ")


def test_the_error_is_one_of_the_configuration() -> None:
    with pytest.raises(MissingPlugin, match=r"^agent: the learner 'taxis' is in the plug-in txt1-learners"):
        LEARNERS.place("agent", "taxis")


@pytest.mark.parametrize("key", ["pilot.period", "ppo.learning_rate", "drift"])
def test_a_setting_that_only_a_plugin_reads_tells_the_command(key: str, capsys: Capture, monkeypatch: Any) -> None:
    monkeypatch.setattr("txt1.learning.settings.entry_points", no_entry_points)
    name = key.partition(".")[0]
    told = (
        f"learning.{key} (from --set learning.{key}=1): the section 'learning.{name}' is in the plug-in txt1-learners, "
        f"which is not installed: {installs_plugin('learners')}\n"
    )
    assert execute(["run", "--headless", "--duration", "1", "--set", f"learning.{key}=1"]) == 2
    assert execute(["learn", "--set", f"learning.{key}=1"]) == 2
    assert capsys.readouterr().err.count(told) == 2


def test_a_recording_keeps_what_only_a_plugin_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("txt1.learning.settings.entry_points", no_entry_points)
    config = recorded({"learning": {"pilot": {"period": 0.2}, "goal_radius": 0.4}})
    assert dict(flatten(config))["learning.pilot.period"] == 0.2
    assert with_values(config, {"learning.goal_radius": 0.3}).section(LearningConfig).part("pilot", None)


def test_a_world_that_is_not_there_tells_who_has_more(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("txt1.learning.world_presets.entry_points", no_entry_points)
    assert execute(["learn", "--world", "light-two-alike"]) == 2
    assert capsys.readouterr().err.endswith(f"; more after {installs_plugin('learners')}\n")
    assert execute(["learn", "--set", "learning.world=composed"]) == 2
    assert capsys.readouterr().err.endswith(
        "learning.world: the world 'composed' is in the plug-in txt1-learners, which is not installed: "
        f"{installs_plugin('learners')}\n"
    )
