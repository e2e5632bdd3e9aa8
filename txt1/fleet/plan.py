"""The file of a fleet: the robots' names, starts and tasks, and the settings of each.

::

    all:                                  # the configuration of all of them, with the keys of config/txt1.yaml
      sim: {room: {length: 12, width: 8}}
    cooperate: {law: convoy, speed: 0.5}  # by a law of txt1.fleet.laws
    robots:
      txt01: {start: [0, 0, 0], drive: [0.5, 0.3]}
      txt02: {start: [2, 0, 0], set: {sim.vehicle.slip: 0.02}}
"""

import json
import os
from collections.abc import Iterator, Mapping
from math import ceil, sqrt
from pathlib import Path
from typing import Annotated, Any, Final

import yaml
from pydantic import Field, ValidationError

from txt1.config import Config
from txt1.config.schema import Section
from txt1.config.sources import completed, vehicle_file, vehicles, with_values
from txt1.errors import ConfigError
from txt1.file_limits import read_text
from txt1.safe_yaml import read_yaml

# m between two robots without a start of their own
START_SPACING: Final = 1.5

RobotName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


class MemberPlan(Section):
    """One robot of a fleet."""

    start: tuple[float, float, float] | None = None
    """Pose in the room, x and y in m, theta in rad; null: a place beside the others."""
    drive: tuple[float, float] | None = None
    """A velocity to command throughout, m/s and rad/s."""
    source: Annotated[str, Field(min_length=1)] | None = None
    """A source of commands to drive it (entry points txt1.sources)."""
    set: Mapping[str, Any] = Field(default_factory=dict)
    """Its own settings, by dotted key."""


class FleetPlan(Section):
    """A fleet."""

    all: Mapping[str, Any] = Field(default_factory=dict)
    """The configuration of all robots, nested as in a configuration file."""
    robots: Annotated[dict[RobotName, MemberPlan], Field(min_length=1)]
    """The robots by name."""
    cooperate: Mapping[str, Any] = Field(default_factory=dict)
    """The law by which they cooperate, and its settings; empty: each does its own task."""

    @property
    def overrides(self) -> list[str]:
        """The settings for all robots, as for ``--set``."""
        return [f"{key}={json.dumps(value)}" for key, value in self.all.items()]

    def configs(self, base: Config) -> dict[str, Config]:
        """Return each robot's configuration; raises ConfigError, which names the robot."""
        room = base.sim.room
        side = START_SPACING * (ceil(sqrt(len(self.robots))) + 1)
        if any(member.start is None for member in self.robots.values()):
            wider = {"sim.room.length": max(room.length, side), "sim.room.width": max(room.width, side)}
            base = with_values(base, wider)
        configs = {}
        for (name, member), place in zip(self.robots.items(), places(len(self.robots)), strict=True):
            own = {"sim.start": list(place if member.start is None else member.start), **member.set, "name": name}
            try:
                configs[name] = with_values(base, _of_another(base, member.set) | own)
            except ConfigError as error:
                raise ConfigError(f"robots.{name}: {error}") from None
        return configs


def _of_another(base: Config, own: Mapping[str, Any]) -> dict[str, Any]:
    """Return a different vehicle's values: its file's, and defaults for values that only the file of `base` sets."""
    name = own.get("vehicle", base.vehicle)
    if name == base.vehicle or not isinstance(name, str):
        return {}
    defaults = _flat(completed(Config()).model_dump())
    theirs, mine = (_flat(_vehicle_values(each)) for each in (base.vehicle, name))
    return {key: defaults.get(key) for key in theirs} | mine


def _vehicle_values(name: str) -> Mapping[str, Any]:
    file = vehicle_file(name)
    if file is None:
        return {}
    if not file.is_file():
        raise ConfigError(f"vehicle: there is none '{name}'; there are: {', '.join([Config().vehicle, *vehicles()])}")
    values = read_yaml(read_text(file))
    return values if isinstance(values, dict) else {}


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of a nested mapping by dotted key."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, dict) and value:
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def places(count: int) -> Iterator[tuple[float, float, float]]:
    """Yield `count` poses in rows around the origin, all looking along x; m and rad."""
    columns = ceil(sqrt(count))
    rows = ceil(count / columns)
    for number in range(count):
        row, column = divmod(number, columns)
        yield START_SPACING * (column - 0.5 * (columns - 1)), START_SPACING * (row - 0.5 * (rows - 1)), 0.0


def names(count: int) -> list[str]:
    """The laboratory's names: txt01, txt02 and so on."""
    return [f"txt{number:02d}" for number in range(1, count + 1)]


def plan_of(fleet: FleetPlan | str | os.PathLike[str] | int) -> FleetPlan:
    """Return a plan: itself, read from a file, or of a number of robots; raises ConfigError."""
    if isinstance(fleet, FleetPlan):
        return fleet
    if isinstance(fleet, int):
        if fleet < 1:
            raise ConfigError(f"robots: {fleet}; a fleet has at least one")
        return FleetPlan(robots={name: MemberPlan() for name in names(fleet)})
    path = Path(fleet)
    try:
        tree = read_yaml(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the fleet: {error.strerror}; check the name") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: no valid YAML: {' '.join(str(error).split())}") from None
    if isinstance(tree, dict) and isinstance(tree.get("robots"), dict):
        tree["robots"] = {name: member or {} for name, member in tree["robots"].items()}
    try:
        return FleetPlan.model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"] if part != "[key]") or "the file"
        raise ConfigError(f"{path}: {where}: {first['msg']}; see docs/fleet.md") from None
