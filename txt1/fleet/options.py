"""The options by which a robot joins a fleet on a network."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from txt1.additions import Options
from txt1.commands import names, need, path, takes
from txt1.errors import ConfigError

if TYPE_CHECKING:
    from txt1.config import Config

NETWORK: Final = {
    "--fleet": takes("INTERFACE", "join the fleet on this network interface; loopback by default", nargs="?", const=""),
    "--fleet-key": takes("FILE", "file with the fleet's password; by default your own, on loopback only", path),
    "--fleet-name": takes("NAME", "name of the fleet; robots hear only fleets of the same name"),
}


class Joining(NamedTuple):
    """The way in which a robot joins a fleet."""

    bridge: Mapping[str, object]
    """Options of the bridge to its network."""
    law: str | None
    """The law of cooperation by which it drives, or None."""
    team: Sequence[str] | None
    """Names of the robots that cooperate."""


def asked(arguments: Namespace, config: Config) -> Joining | None:
    """Return how the robot joins a fleet, None if it joins none; raises ConfigError, MissingExtra."""
    if arguments.fleet is None:
        if arguments.fleet_key or arguments.fleet_name or arguments.cooperate:
            raise ConfigError("--fleet-key, --fleet-name, --cooperate: the robot is in no fleet; add --fleet")
        return None
    if not config.name:
        raise ConfigError("--fleet: a robot of a fleet has a name; add --name")
    if arguments.cooperate is not None and config.name not in (arguments.team or []):
        raise ConfigError(f"--cooperate: '{config.name}' is not of the team; add --team with all names, its own, too")
    if arguments.speed is not None:
        raise ConfigError("--fleet: others live in real time; leave --speed out")
    need("--fleet", "fleet", "zenoh")
    from txt1.fleet.key import FLEET_NAME, fleet_key

    key = None if arguments.fleet_key is None else str(arguments.fleet_key)
    name = arguments.fleet_name or FLEET_NAME
    # before a robot is brought up
    fleet_key(arguments.fleet, arguments.fleet_key, name)
    bridge = {"name": config.name, "interface": arguments.fleet, "key": key, "fleet": name}
    return Joining(bridge, arguments.cooperate, arguments.team)


LAWS: Final = {
    "--cooperate": takes("LAW", "drive by a law of cooperation with the robots of --team (see docs/fleet.md)"),
    "--team": takes("NAME,NAME,...", "robots that cooperate, the leader of a convoy first", names),
}
OPTIONS: Final = Options("fleet", NETWORK | LAWS, asked)
