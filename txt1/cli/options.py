"""Options that several commands share: their words, and the configuration they make."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from txt1.config import Config, load
from txt1.config.sources import LoadedConfig
from txt1.errors import ConfigError
from txt1.hal.registry import is_simulated
from txt1.kernel.loop import Speed
from txt1.link import baud_warning

# -- values ----------------------------------------------------------------------------------------------------


def number(text: str) -> float:
    """Return the finite number that a word is; raises ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not finite")
    return value


def positive(text: str) -> float:
    """Return the positive number that a word is; raises ArgumentTypeError."""
    value = number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"'{text}' is not positive")
    return value


def count(text: str) -> int:
    """Return the whole number from 1 that a word is; raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1")
    return int(text)


def speed(text: str) -> Speed:
    """Return the speed of virtual time that a word is; raises ArgumentTypeError."""
    return "max" if text == "max" else positive(text)


def velocity(text: str) -> tuple[float, float]:
    """Return the velocity in m/s and rad/s that a word is; raises ArgumentTypeError."""
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"'{text}' is not V,OMEGA, for example 0.5,0.3")
    return number(parts[0]), number(parts[1])


def bridge_options(text: str) -> tuple[str, dict[str, object]]:
    """Return the bridge's name and its options, each a number, true, false or text; raises ArgumentTypeError."""
    name, _, rest = text.partition(":")
    options: dict[str, object] = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if not (equals and key.isidentifier()):
            raise argparse.ArgumentTypeError(f"'{text}' is not NAME:KEY=VALUE,..., for example mqtt:port=1883")
        try:
            options[key] = json.loads(value)
        except ValueError:
            options[key] = value
    return name, options


def host_and_port(text: str) -> tuple[str, int]:
    """Return the address that a word is, on 127.0.0.1 when it names no host; raises ArgumentTypeError."""
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or not 0 <= int(port) <= 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not HOST:PORT, for example 127.0.0.1:5701")
    return host.strip("[]") or "127.0.0.1", int(port)


def existing(text: str) -> Path:
    """Return the path of something that is there; raises ArgumentTypeError."""
    path = Path(text)
    if not path.exists():
        raise argparse.ArgumentTypeError(f"there is no file '{text}'; check the name")
    return path


def unused(folder: Path) -> Path:
    """Return the folder, or the first of its name with a number that is not there yet."""
    names = (folder, *(folder.with_name(f"{folder.name}-{number}") for number in range(2, 10_000)))
    return next(each for each in names if not each.exists())


# -- options ---------------------------------------------------------------------------------------------------


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add --config and --set."""
    parser.add_argument("--config", metavar="FILE", help="YAML file, e.g. config/txt1.yaml")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE",
        help="set one value, e.g. --set control.linear.kp=9; may be repeated",
    )  # fmt: skip


def add_port(parser: argparse.ArgumentParser) -> None:
    """Add --port and --baud, of the line to the board."""
    parser.add_argument(
        "--port", metavar="PORT",
        help="where the board is (--hal serial): a device, socket://HOST:PORT, or virtual for one in this process; "
        "left out, the only device there is",
    )  # fmt: skip
    parser.add_argument("--baud", type=int, metavar="N", help="bits a second of the line, 57600 by default")


def add_robot(parser: argparse.ArgumentParser, when_left_out: str = "; a simulation runs at max when left out") -> None:
    """Add what says which robot it is, its configuration included, and how fast its time goes."""
    add_config(parser)
    parser.add_argument("--hal", metavar="NAME", help="hardware layer: sim, serial, or one from another package")
    add_port(parser)
    parser.add_argument("--seed", type=int, metavar="N", help="repeats every random value of a simulation")
    parser.add_argument(
        "--speed", type=speed, metavar="N|max",
        help=f"virtual time, N times as fast as real time or as fast as possible{when_left_out}",
    )  # fmt: skip


def add_arm(parser: argparse.ArgumentParser) -> None:
    """Add --arm, for a command that nobody watches."""
    parser.add_argument("--arm", action="store_true", default=None, help="arm at the start; a simulation arms itself")


def add_log(parser: argparse.ArgumentParser) -> None:
    """Add --log."""
    parser.add_argument("--log", type=Path, metavar="FILE", help="record everything to this MCAP file")


def add_view(parser: argparse.ArgumentParser) -> None:
    """Add --view and --view-token."""
    parser.add_argument(
        "--view", nargs="?", type=host_and_port, const=("127.0.0.1", 8765), metavar="[HOST:]PORT",
        help="serve the Foxglove protocol; 127.0.0.1:8765, and other than loopback addresses with a token only",
    )  # fmt: skip
    parser.add_argument(
        "--view-token", type=Path, metavar="FILE",
        help="clients have to present the token in FILE, which is made if there is none: ws://HOST:PORT/?token=TOKEN",
    )  # fmt: skip


# -- the configuration they make -------------------------------------------------------------------------------


def loaded(arguments: argparse.Namespace, first: Sequence[str] = ()) -> LoadedConfig:
    """Return the configuration that the words ask for, with the origin of every value.

    Args:
        arguments: what `add_robot` has added.
        first: settings that any other source overrides but the defaults.

    Raises:
        ConfigError: a setting is wrong, or the port is of no use to this HAL.

    """
    options = {name: value for name in ("hal", "seed") if (value := getattr(arguments, name, None)) is not None}
    line = {f"serial.{name}": value for name in ("port", "baud") if (value := getattr(arguments, name)) is not None}
    if line and "hal" not in options:
        options["hal"] = "serial"
    found = load(arguments.config, [*first, *arguments.set], os.environ, options | line)
    config = found.config
    if config.hal == "serial":
        warn_of_baud(config)
    elif "serial.port" in line:
        raise ConfigError(f"--port {arguments.port}: only --hal serial has a port, not '{config.hal}'; leave one out")
    return found


def robot_speed(arguments: argparse.Namespace, config: Config) -> Speed:
    """Return the speed of a robot's time that nobody watches: as fast as possible where it is simulated."""
    given: Speed = arguments.speed
    return "max" if is_simulated(config) and given is None else given


def warn_of_baud(config: Config) -> None:
    """Say so when the baud rate is none that the boards have."""
    warning = baud_warning(config.serial.baud)
    if warning is not None:
        print(f"txt1: serial.baud: {warning}", file=sys.stderr)
