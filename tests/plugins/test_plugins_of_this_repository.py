"""What the program knows of this repository's plug-ins: which parts they bring, and the commands that install them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from txt1 import additions
from txt1.cli import execute
from txt1.config import load
from txt1.errors import MissingPlugin
from txt1.hal.registry import PHYSICS
from txt1.installing import distribution_of, installs_plugin
from txt1.unknown import COMMANDS, OPTIONS, PLUGINS, missing
from txt1.version import __version__

ROOT = Path(__file__).parents[2]
Capture = pytest.CaptureFixture[str]
PROJECTS = {
    file.parent.name: tomllib.loads(file.read_text("utf-8"))["project"]
    for file in sorted((ROOT / "plugins").glob("*/pyproject.toml"))
}


@pytest.fixture
def no_plugin_is_installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def none(**_: Any) -> list[EntryPoint]:
        return []

    monkeypatch.setattr("txt1.plugins.entry_points", none)
    monkeypatch.setattr("importlib.metadata.entry_points", none)
    additions.strangers.cache_clear()
    yield
    additions.strangers.cache_clear()


def test_the_table_of_plugins_is_what_their_projects_say() -> None:
    told = {
        folder: {group: tuple(sorted(names)) for group, names in project.get("entry-points", {}).items()}
        for folder, project in PROJECTS.items()
    }
    assert {folder: groups for folder, groups in told.items() if groups} == {
        folder: {group: names for group, names in groups.items() if group not in (COMMANDS, OPTIONS)}
        for folder, groups in PLUGINS.items()
    }


@pytest.mark.parametrize("folder", [folder for folder, groups in PLUGINS.items() if COMMANDS in groups])
def test_the_table_of_plugins_has_the_commands_and_options_of_their_additions(folder: str) -> None:
    pytest.importorskip(f"txt1_{folder}", reason=f"the plug-in {folder} is not installed")
    addition = additions.strangers().found[folder]
    assert PLUGINS[folder][COMMANDS] == tuple(sorted(addition.commands))
    options = additions.load(addition.options).arguments if addition.options else ()
    assert PLUGINS[folder].get(OPTIONS, ()) == tuple(sorted(options))


@pytest.mark.parametrize("folder", sorted(PLUGINS))
def test_a_plugin_has_the_version_of_the_txt1_that_it_needs(folder: str) -> None:
    project = PROJECTS[folder]
    assert project["name"] == distribution_of(folder) and project["version"] == __version__
    assert f"txt1=={__version__}" in project["dependencies"]


@pytest.mark.usefixtures("no_plugin_is_installed")
def test_a_physics_of_a_plugin_that_is_missing_is_one_line(capsys: Capture) -> None:
    assert sorted(missing(PHYSICS.group, PHYSICS.names())) == sorted(PLUGINS["physics"][PHYSICS.group])
    assert execute(["run", "--headless", "--duration", "1", "--set", "sim.physics=mujoco"]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert told.endswith(
        f"sim.physics: the physics 'mujoco' is in the plug-in txt1-physics, which is not installed: "
        f"{installs_plugin('physics')}"
    )


@pytest.mark.usefixtures("no_plugin_is_installed")
def test_a_section_that_nothing_installed_reads_tells_the_command() -> None:
    with pytest.raises(MissingPlugin) as caught:
        load(None, ["physics.mass=5"], {}, {})
    assert str(caught.value) == (
        "physics.mass (from --set physics.mass=5): the section 'physics' is in the plug-in txt1-physics, which is not "
        f"installed: {installs_plugin('physics')}"
    )


@pytest.mark.usefixtures("no_plugin_is_installed")
def test_a_dataset_for_lerobot_without_the_plugin_is_one_line(tmp_path: Path, capsys: Capture) -> None:
    words = ["log", "export", str(ROOT / "tests/golden/wire.mcap"), "--lerobot", str(tmp_path / "there")]
    assert execute(words) == 2
    assert capsys.readouterr().err == (
        "txt1: --lerobot: the format 'lerobot' is in the plug-in lerobot_robot_txt1, which is not installed: "
        f"{installs_plugin('lerobot')}\n"
    )


@pytest.mark.usefixtures("no_plugin_is_installed")
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["run", "--headless", "--ros1"], "--ros1"),
        (["run", "--ros1-namespace=car1"], "--ros1-namespace=car1"),
        (["ros1", "package", "there"], "ros1"),
        (["log", "export", "--rosbag1", str(ROOT / "tests/golden/wire.mcap")], "--rosbag1: the format 'rosbag1'"),
    ],
)
def test_a_command_of_a_plugin_that_is_missing_is_one_line(words: list[str], told: str, capsys: Capture) -> None:
    assert execute(words) == 2
    assert capsys.readouterr().err == (
        f"txt1: {told} is in the plug-in txt1-ros1, which is not installed: {installs_plugin('ros1')}\n"
    )


def test_the_help_names_the_plugins_that_are_missing(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.setattr("txt1.unknown.find_spec", lambda name: None if name == "txt1_ros1" else name)
    assert execute(["--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert f"Plug-ins that are not installed: ros1: {installs_plugin('ros1')}." in shown
