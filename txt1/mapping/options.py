"""`txt1 run --map room`, `--in room --at X,Y,THETA`: short forms of settings, so that a recording holds them."""

from __future__ import annotations

from argparse import Action, ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from txt1.additions import Options
from txt1.commands import busy, need, number, say

if TYPE_CHECKING:
    from txt1.config import Config


class SetWithMap(Action):
    """Sets ``mapping.<const>`` like --set."""

    def __call__(
        self,
        parser: ArgumentParser,
        namespace: Namespace,
        values: str | Sequence[Any] | None,
        option: str | None = None,
    ) -> None:
        """Take the word after the option."""
        namespace.set = [*namespace.set, f"mapping.{self.const}={values}"]


def map_name(text: str) -> str:
    """Return the name of a map; raises ArgumentTypeError."""
    if not text:
        raise ArgumentTypeError("'' is no name of a map; give one, such as room")
    return text


def _pose(text: str) -> str:
    """Return a pose as a list in YAML; raises ArgumentTypeError."""
    parts = text.split(",")
    if len(parts) != 3:
        raise ArgumentTypeError(f"'{text}' is not X,Y,THETA, for example 0.5,1.2,0")
    return f"[{', '.join(str(number(part)) for part in parts)}]"


def asked(arguments: Namespace, config: Config) -> object | None:
    """Compile the loops before a robot starts. The addition itself is requested by its section.

    Raises ConfigError: a setting is wrong; MissingExtra.
    """
    from txt1.mapping.settings import MappingConfig

    settings = config.section(MappingConfig)
    if (settings.room, settings.make, settings.at) == (None, None, None):
        return None
    need("--in" if settings.make is None else "--map", "fast", "numba", "scipy")
    from txt1.mapping.map_sensors import checked
    from txt1.mapping.scan_work import map_of, warm

    checked(settings)
    if settings.room is not None:
        for remark in map_of(settings.room).remarks:
            say(remark)
    with busy("compiling for the map"):
        # the process of the map finds the results on the disk
        warm()
    return None


OPTIONS: Final = Options(
    "a map",
    {
        "--map": {
            "metavar": "NAME",
            "help": "make the map NAME.yaml while driving, or extend it if it exists",
            "type": map_name,
            "action": SetWithMap,
            "const": "make",
            "default": None,
            "dest": "make_map",
        },
        "--in": {
            "metavar": "MAP",
            "help": "find the robot on a map of txt1 map or map_server (sensor map)",
            "type": map_name,
            "action": SetWithMap,
            "const": "room",
            "default": None,
            "dest": "in_map",
        },
        "--at": {
            "metavar": "X,Y,THETA",
            "help": "the robot's place at the start, m and rad; without it the robot searches",
            "type": _pose,
            "action": SetWithMap,
            "const": "at",
            "default": None,
            "dest": "at_pose",
        },
    },
    asked,
)
