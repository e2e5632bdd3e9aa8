"""Options that several commands share, and the configuration that they make."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from txt1 import additions
from txt1.commands import count, flag, seed, speed, takes
from txt1.errors import ConfigError

# imported when used, so that the help appears at once
if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.config.sources import LoadedConfig
    from txt1.kernel.loop import Speed


def _brought(group: str) -> list[str]:
    """Return the names in a table of parts, of the parts from additions."""
    return [name for addition in additions.known().values() for name in addition.parts.get(group, {})]


_CARS: Final = _brought("txt1.hal")
HALS: Final = ", ".join(("sim", "serial", *_CARS))
"""The names of the package's own hardware layers."""
_OF_BOARDS: Final = ", ".join(name for name in _brought("txt1.ports") if name not in _CARS)
_OF_CARS: Final = "".join(f"; with --hal {name}: {name}" for name in _brought("txt1.ports") if name in _CARS)
LINE: Final = {
    "--port": takes(
        "PORT",
        "where the board is: a device, socket://HOST:PORT, or a virtual one in this process "
        f"({_OF_BOARDS}{_OF_CARS}); left out: the plugged-in device, if there is only one",
    ),
    "--baud": takes("N", "bits a second of the line, 57600 by default (--hal serial)", count),
}
CONFIGURATION: Final = {
    "--config": takes("FILE", "YAML file, e.g. config/txt1.yaml"),
    "--set": takes(
        "KEY=VALUE", "set one value, e.g. --set control.linear.kp=9; may be repeated", action="append", default=[]
    ),
}
SEED: Final = {"--seed": takes("N", "repeats every random value of a simulation", seed)}
VEHICLE: Final = {"--vehicle": takes("NAME", "txt1, another vehicle in config/vehicles/, or your own YAML file")}
ROBOT: Final = (
    CONFIGURATION
    | LINE
    | SEED
    | VEHICLE
    | {
        "--hal": takes("NAME", f"hardware layer: {HALS}, or one from another package"),
        "--speed": takes(
            "N|max",
            "virtual time, N times as fast as real time or as fast as possible; simulation only; by "
            "default, experiments and learners take max",
            speed,
        ),
    }
)
ARM: Final = {"--arm": flag("arm at the start; a simulation arms itself", default=None)}


def loaded(arguments: argparse.Namespace, first: Sequence[str] = ()) -> LoadedConfig:
    """Return the configuration for the arguments, with origins; `first` overrides only the defaults."""
    from txt1.config import load
    from txt1.hal.registry import HALS, is_on_a_line

    given = {name: value for name, value in vars(arguments).items() if value is not None}
    options = {name: given[name] for name in ("vehicle", "hal", "seed") if name in given}
    line = {f"serial.{name}": given[name] for name in ("port", "baud") if name in given}
    if line and "hal" not in options:
        options["hal"] = "serial"
    found = load(arguments.config, [*first, *arguments.set], os.environ, options | line)
    config = found.config
    if config.hal == "serial":
        warn_of_baud(config)
    elif "serial.port" in line and not is_on_a_line(config.hal):
        have = ", ".join(filter(is_on_a_line, HALS.names()))
        raise ConfigError(f"--port {arguments.port}: only these HALs have a port: {have}; '{config.hal}' has none")
    return found


def robot_speed(arguments: argparse.Namespace, config: Config) -> Speed:
    """Return the speed of a robot without screens: by default as fast as possible if it is simulated."""
    from txt1.hal.registry import is_simulated

    given: Speed = arguments.speed
    return "max" if is_simulated(config) and given is None else given


def warn_of_baud(config: Config) -> None:
    """Print a warning if no board has this baud rate."""
    from txt1.link.device import baud_warning

    warning = baud_warning(config.serial.baud)
    if warning is not None:
        print(f"txt1: serial.baud: {warning}", file=sys.stderr)
