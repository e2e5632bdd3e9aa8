"""A robot's way into a fleet on a network: the options of its bridge."""

import argparse

from txt1.commands import need
from txt1.config import Config
from txt1.errors import ConfigError


def fleet_bridge(arguments: argparse.Namespace, config: Config) -> dict[str, object] | None:
    """Return the bridge's options, None where the robot joins no fleet; raises ConfigError, MissingExtra."""
    if arguments.fleet is None:
        if arguments.fleet_key or arguments.cooperate:
            raise ConfigError("--fleet-key, --cooperate: the robot is in no fleet; add --fleet")
        return None
    if not config.name:
        raise ConfigError("--fleet: a robot of a fleet has a name; add --name")
    if arguments.cooperate is not None and config.name not in (arguments.team or []):
        raise ConfigError(f"--cooperate: '{config.name}' is not of the team; add --team with all names, its own, too")
    if arguments.speed is not None:
        raise ConfigError("--fleet: others live in real time; leave --speed out")
    need("--fleet", "fleet", "zenoh")
    key = None if arguments.fleet_key is None else str(arguments.fleet_key)
    return {"name": config.name, "interface": arguments.fleet, "key": key}
