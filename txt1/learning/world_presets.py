"""Worlds for `txt1 learn --world`, by name: settings, from worlds.yaml beside this file and from plug-ins.

A package announces a function that returns its worlds, settings by name, in its pyproject.toml::

    [project.entry-points."txt1.world_settings"]
    mine = "mypackage.mine:worlds"

The setting ``about`` is no part of the configuration: it says in a few words what the world is.
"""

from argparse import Namespace
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final

from txt1.errors import ConfigError
from txt1.installing import installs_plugin
from txt1.safe_yaml import read_yaml
from txt1.unknown import missing

# the default world of a learner
OWN: Final = {"thesis": "thesis-simulation"}
GROUP: Final = "txt1.world_settings"


def in_file(file: Path) -> Mapping[str, Any]:
    """Return the worlds of a YAML file that comes with a package."""
    found: Mapping[str, Any] = read_yaml(file.read_text(encoding="utf-8"))
    return found


@cache
def ours() -> Mapping[str, Mapping[str, Any]]:
    """Return the worlds of this package by name."""
    return in_file(Path(__file__).with_name("worlds.yaml"))


def worlds() -> Mapping[str, Mapping[str, Any]]:
    """Return all installed worlds by name, the package's own first."""
    brought = {name: one for point in entry_points(group=GROUP) for name, one in point.load()().items()}
    return {**ours(), **{name: one for name, one in brought.items() if name not in ours()}}


def content(world: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a world's settings for `txt1.config.load`."""
    return {key: value for key, value in world.items() if key != "about"}


def in_world(arguments: Namespace, name: str | None) -> Namespace:
    """Return a command's arguments with a world as the configuration; ConfigError: there is none, or two."""
    if name is None:
        return arguments
    if arguments.config is not None:
        raise ConfigError("--world: a world is a configuration file, and --config gives another; leave out one of them")
    return Namespace(**{**vars(arguments), "config": world_named(name)})


def world_named(name: str) -> Path | Mapping[str, Any]:
    """Return a world by its name, or its file by its path; raises ConfigError: there is none."""
    if name.endswith(".yaml"):
        if Path(name).is_file():
            return Path(name)
    elif (one := worlds().get(name)) is not None:
        return content(one)
    known = ", ".join(sorted(worlds()))
    absent = missing(GROUP, entry_points(group=GROUP).names).values()
    more = "".join(f"; more after {installs_plugin(plugin)}" for plugin in absent)
    raise ConfigError(f"--world {name}: there is no such world; give a .yaml file, or one of {known}{more}")
