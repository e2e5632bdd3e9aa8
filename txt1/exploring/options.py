"""`txt1 run --explore -o room`: the robot maps a room by itself."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from txt1.additions import Options
from txt1.commands import flag, need
from txt1.errors import ConfigError
from txt1.mapping.options import SetWithMap, map_name

if TYPE_CHECKING:
    from txt1.config import Config


class SetExplored(SetWithMap):
    """Sets ``mapping.make`` like --set, and keeps the name."""

    def __call__(
        self,
        parser: ArgumentParser,
        namespace: Namespace,
        values: str | Sequence[Any] | None,
        option: str | None = None,
    ) -> None:
        """Take the name after the option."""
        super().__call__(parser, namespace, values, option)
        setattr(namespace, self.dest, values)


def asked(arguments: Namespace, config: Config) -> str | None:
    """Return the name of the map to make, None unless --explore is given.

    Raises ConfigError: the name is missing or taken, or another source drives; MissingExtra.
    """
    name: str | None = arguments.explored_map
    if not arguments.explore:
        if name is not None:
            raise ConfigError(f"-o {name}: it names the map of --explore; add --explore, or give --map {name}")
        return None
    need("--explore", "fast", "numba", "scipy")
    from txt1.mapping.settings import MappingConfig

    if name is None:
        raise ConfigError("--explore makes a map: name it with -o, such as -o room")
    if (made := config.section(MappingConfig).make) != name:
        raise ConfigError(f"--explore -o {name}: it makes one map, and mapping.make (--map) names {made}; leave it out")
    if arguments.drive is not None or arguments.source is not None:
        raise ConfigError("--explore drives by itself; leave --drive and --source out")
    for suffix in (".yaml", ".graph"):
        if (file := Path(f"{name}{suffix}")).exists():
            raise ConfigError(f"-o {name}: there is {file} already; give another name, or extend it with --map {name}")
    return name


OPTIONS: Final = Options(
    "exploring",
    {
        "--explore": flag("map the room without hands: drive to the borders of the unknown floor, and come back"),
        "-o": {
            "metavar": "NAME",
            "help": "with --explore: name of the map to make",
            "type": map_name,
            "action": SetExplored,
            "const": "make",
            "default": None,
            "dest": "explored_map",
        },
    },
    asked,
)
