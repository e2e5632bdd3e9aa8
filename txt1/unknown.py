"""What an error says of a name that is not installed: the plug-in that brings it, or the most similar name that is.

It is imported when a name is wrong.
"""

import difflib
from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from txt1.errors import ConfigError, MissingPlugin
from txt1.installing import installs_package, installs_plugin

COMMANDS: Final = "commands"
OPTIONS: Final = "options of txt1 run"
PLUGINS: Final[Mapping[str, Mapping[str, tuple[str, ...]]]] = {
    "browser": {"txt1.additions": ("browser",), COMMANDS: ("browser",)},
    "learners": {
        "txt1.learners": ("neural", "pilot", "sweeps", "taxis"),
        "txt1.learning": ("changes", "dqn", "drift", "neural", "pilot", "ppo", "sweeps", "taxis"),
        "txt1.world_settings": ("learners",),
        "txt1.worlds": ("composed",),
    },
    "lerobot": {"txt1.exporters": ("lerobot",)},
    "physics": {
        "txt1.additions": ("physics",),
        "txt1.sim.physics": ("mujoco", "multi-body", "single-track-drift"),
    },
    "ros1": {
        "txt1.additions": ("ros1",),
        "txt1.exporters": ("rosbag1",),
        COMMANDS: ("ros1",),
        OPTIONS: ("--ros1", "--ros1-auto-arm", "--ros1-name", "--ros1-namespace"),
    },
}
"""The plug-ins of this repository, by their folders below plugins/: the names of their entry points, by group.

`COMMANDS` and `OPTIONS` are those that their additions bring.
"""

OURS: Final = ("txt1", *(f"txt1_{folder}" for folder in PLUGINS))
"""The packages whose errors are not taken for a stranger's."""


def brought(group: str) -> dict[str, str]:
    """Return the parts of a group that plug-ins of this repository bring: by name, the plug-in's folder."""
    return {name: plugin for plugin, groups in PLUGINS.items() for name in groups.get(group, ())}


def missing(group: str, installed: Collection[str]) -> dict[str, str]:
    """Return the parts of a group that are in plug-ins that are not installed: by name, the plug-in's folder."""
    return {name: plugin for name, plugin in sorted(brought(group).items()) if name not in installed}


def part(kind: str, group: str, key: str, name: str, installed: Collection[str]) -> ConfigError:
    """Return the error for a part that is not installed; `key` is the setting that names it."""
    plugins = brought(group)
    if name in plugins:
        return MissingPlugin(f"{key}: the {kind} '{name}'", plugins[name])
    if group == "txt1.hal" and Path(name, "pyproject.toml").exists():
        return ConfigError(f"{key}: the {kind} '{name}' is not installed: {installs_package(f'./{name}', '-e ')}")
    near = difflib.get_close_matches(name, {**dict.fromkeys(installed), **plugins}, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    return ConfigError(f"{key}: there is no {kind} '{name}'; installed: {', '.join(installed) or 'none'}{hint}")


def setting(path: Sequence[str], depth: int, known: Collection[str], origin: str, group: str) -> ConfigError:
    """Return the error for a key whose part at `depth` is not among the `known` keys there.

    Packages may bring more keys by the entry points of `group`; at depth 0 these are the additions' sections.
    """
    key, name, above = ".".join(path), path[depth], "".join(f"{part}." for part in path[:depth])
    first, _, rest = name.partition(".")
    if rest and first in known:
        remedy = f"in a file one key is below the other: '{above}{first}', and in it '{rest}'"
        return ConfigError(f"{key}: unknown key '{name}' (from {origin}); {remedy}")
    if (plugin := brought(group).get(name)) is not None:
        return MissingPlugin(f"{key} (from {origin}): the section '{above}{name}'", plugin)
    near = difflib.get_close_matches(name, known, n=1)
    remedy = f"did you mean '{above}{near[0]}'?" if near else f"known here: {', '.join(known)}"
    if depth == 0 and not near:
        remedy += "; an addition's section needs the addition's package"
    return ConfigError(f"{key}: unknown key (from {origin}); {remedy}")


def word(words: Iterable[str]) -> MissingPlugin | None:
    """Return the error for the first of these words that is a plug-in's command or option; None if there is none."""
    plugins = brought(COMMANDS) | brought(OPTIONS)
    found = next((each for each in words if each.partition("=")[0] in plugins), None)
    return None if found is None else MissingPlugin(found, plugins[found.partition("=")[0]])


def absent() -> str:
    """Return a line on the plug-ins that are not installed, with the command for each; "" if all are."""
    folders = [folder for folder in PLUGINS if find_spec(f"txt1_{folder}") is None]
    return "; ".join(f"{folder}: {installs_plugin(folder)}" for folder in folders)
