"""Options that several commands share: their words, and the configuration they make."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from txt1.errors import ConfigError

if TYPE_CHECKING:  # so that the help is there at once
    from txt1.config import Config
    from txt1.config.sources import LoadedConfig
    from txt1.kernel.loop import Speed


def number(text: str) -> float:
    """Return the finite number that a word is; raises ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return value


def positive(text: str) -> float:
    """Return the number above 0 that a word is; raises ArgumentTypeError."""
    try:
        value = number(text)
    except argparse.ArgumentTypeError:
        value = 0.0
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"'{text}' is not a positive number")
    return value


def count(text: str) -> int:
    """Return the whole number from 1 that a word is; raises ArgumentTypeError."""
    if not (text.isascii() and text.isdecimal() and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1")
    return int(text)


def speed(text: str) -> Speed:
    """Return the speed of a robot's time that a word is; raises ArgumentTypeError."""
    if text == "max":
        return "max"
    try:
        return positive(text)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"'{text}' is not max or a positive number") from None


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


def named_url(text: str) -> tuple[str, str]:
    """Return the robot's name and its page's address that a word is; raises ArgumentTypeError."""
    name, _, url = text.partition("=")
    if not (name and url.startswith(("http://", "https://"))):
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME=URL, for example txt02=https://txt02.local:8080")
    return name, url


def names(text: str) -> list[str]:
    """Return the names that a word with commas is."""
    return [name for name in text.split(",") if name]


def path(text: str) -> Path:
    """Return the path that a word is; raises ArgumentTypeError for an empty one, as of a variable that is not set."""
    if not text:
        raise argparse.ArgumentTypeError("'' is no name of a file or folder; give one")
    return Path(text)


def existing(text: str) -> Path:
    """Return the path of something that is there; raises ArgumentTypeError."""
    found = path(text)
    if not found.exists():
        raise argparse.ArgumentTypeError(f"there is no file '{text}'; check the name")
    return found


def recording(text: str) -> Path:
    """Return the path of a recording that is there; raises ArgumentTypeError, and MissingExtra without its reader."""
    from txt1.record.session import MODULES, need

    need("reading a recording", "record", *MODULES)
    return existing(text)


@contextmanager
def busy(text: str) -> Iterator[None]:
    """On a terminal, show for as long as the block takes that something is being done."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(f"{text} ..."):
        yield


def unused(folder: Path) -> Path:
    """Return the folder, or the first of its name with a number that is not there yet."""
    names = (folder, *(folder.with_name(f"{folder.name}-{number}") for number in range(2, 10_000)))
    return next(each for each in names if not each.exists())


def takes(metavar: str, about: str | None = None, kind: Callable[[str], Any] = str, **more: Any) -> dict[str, Any]:
    """Return what argparse is to be told of an argument with a value, which `kind` makes of a word."""
    return {"metavar": metavar, "help": about, "type": kind, **more}


def flag(about: str, **more: Any) -> dict[str, Any]:
    """Return what argparse is to be told of an option without a value."""
    return {"action": "store_true", "help": about, **more}


Arguments = Mapping[str, Mapping[str, Any]]  # of a command by their names, from `takes` and `flag`

LINE: Final = {
    "--port": takes(
        "PORT", "where the board is: a device, socket://HOST:PORT, or a virtual one in this process (virtual; with "
        "--hal vesc: vesc, with --hal waveshare: waveshare); left out, the only device that is plugged in",
    ),
    "--baud": takes("N", "bits a second of the line, 57600 by default (--hal serial)", int),
}  # fmt: skip
CONFIGURATION: Final = {
    "--config": takes("FILE", "YAML file, e.g. config/txt1.yaml"),
    "--set": takes(
        "KEY=VALUE", "set one value, e.g. --set control.linear.kp=9; may be repeated", action="append", default=[]
    ),
}
SEED: Final = {"--seed": takes("N", "repeats every random value of a simulation", int)}
VEHICLE: Final = {"--vehicle": takes("NAME", "txt1, another in config/vehicles/, or a YAML file of your own")}
ROBOT: Final = CONFIGURATION | LINE | SEED | VEHICLE | {
    "--hal": takes("NAME", "hardware layer: sim, serial, vesc, waveshare, pi, or one from another package"),
    "--speed": takes(
        "N|max", "virtual time, N times as fast as real time or as fast as possible; simulation only, and there max "
        "when nobody watches", speed,
    ),
}  # fmt: skip
ARM: Final = {"--arm": flag("arm at the start; a simulation arms itself", default=None)}
LOG: Final = {"--log": takes("FILE", "record everything to this MCAP file", path)}
VIEW: Final = {
    "--view": takes(
        "[HOST:]PORT", "serve the Foxglove protocol; 127.0.0.1:8765, and other than loopback addresses with a token "
        "only", host_and_port, nargs="?", const=("127.0.0.1", 8765),
    ),
    "--view-token": takes(
        "FILE", "file with the token that clients must send, made if there is none: ws://HOST:PORT/?token=TOKEN", path
    ),
}  # fmt: skip
WEB: Final = {
    "--web": takes(
        "[HOST:]PORT", "serve the web page, to watch and drive from; 127.0.0.1:8080, and other than loopback addresses "
        "with a token and TLS only", host_and_port, nargs="?", const=("127.0.0.1", 8080),
    ),
    "--web-token": takes("FILE", "file with the token that pages must send, made if there is none", path),
    "--web-cert": takes("FILE", "your certificate (PEM), in place of one made at the first start", existing),
    "--web-key": takes("FILE", "... and its key, if that is another file", existing),
    "--web-speed": takes("V", "the fastest that visitors drive at first, m/s", positive, default=0.5),
    "--web-folder": takes("FOLDER", "of recordings that the page makes or plays", path, default=Path("out/recordings")),
    "--web-robot": takes(
        "NAME=URL", "another robot's page, to choose there; may be repeated", named_url, action="append", default=[]
    ),
}  # fmt: skip
ROS2: Final = {
    "--ros2": flag("be a node of ROS 2: an installed one, else that of 'txt1 ros2 install'"),
    "--ros2-namespace": takes("NS", "the node's namespace; none by default"),
}  # fmt: skip
ROS: Final = ROS2 | {
    "--ros2-stamped": flag("cmd_vel is a TwistStamped"),
    "--ros1": flag("be the original's node of ROS 1, txt1_node, at the master of ROS_MASTER_URI"),
}  # fmt: skip
NETWORK: Final = {
    "--fleet": takes(
        "INTERFACE", "join the fleet on this network interface; left out, on loopback", nargs="?", const=""
    ),
    "--fleet-key": takes("FILE", "file with the password that all robots of a fleet beyond loopback share", path),
}  # fmt: skip
RECORDING: Final = {"file": takes("FILE", None, recording)}
ONE_ROBOT: Final = {"--robot": takes("NAME", "show this robot, of a recording of several")}


def add(parser: argparse._ActionsContainer, arguments: Arguments) -> None:
    """Add arguments to a parser, or to a group of it."""
    for names, told in arguments.items():
        parser.add_argument(*names.split(), **told)


def add_actions(
    parser: argparse.ArgumentParser, actions: Mapping[str, tuple[Callable[[argparse.Namespace], int], Arguments]]
) -> None:
    """Add actions, each by its name with what does it, whose docstring is its help, and what it takes."""
    parsers = parser.add_subparsers(required=True, metavar="ACTION")
    for name, (main, arguments) in actions.items():
        about = (main.__doc__ or "").rstrip(".")
        action = parsers.add_parser(name, help=about[:1].lower() + about[1:])
        action.set_defaults(main=main)
        add(action, arguments)
    parser.set_defaults(parsers=parsers.choices)


def loaded(arguments: argparse.Namespace, first: Sequence[str] = ()) -> LoadedConfig:
    """Return the configuration that the arguments ask for, with origins; `first` overrides the defaults alone."""
    from txt1.config import load
    from txt1.hal.registry import ON_A_LINE

    given = {name: value for name, value in vars(arguments).items() if value is not None}
    options = {name: given[name] for name in ("vehicle", "hal", "seed") if name in given}
    line = {f"serial.{name}": given[name] for name in ("port", "baud") if name in given}
    if line and "hal" not in options:
        options["hal"] = "serial"
    found = load(arguments.config, [*first, *arguments.set], os.environ, options | line)
    config = found.config
    if config.hal == "serial":
        warn_of_baud(config)
    elif "serial.port" in line and config.hal not in ON_A_LINE:
        have = ", ".join(ON_A_LINE)
        raise ConfigError(f"--port {arguments.port}: only these HALs have a port: {have}; '{config.hal}' has none")
    return found


def robot_speed(arguments: argparse.Namespace, config: Config) -> Speed:
    """Return the speed of a robot's time that nobody watches: as fast as possible where it is simulated."""
    from txt1.hal.registry import is_simulated

    given: Speed = arguments.speed
    return "max" if is_simulated(config) and given is None else given


def warn_of_baud(config: Config) -> None:
    """Say so when the baud rate is none that the boards have."""
    from txt1.link.device import baud_warning

    warning = baud_warning(config.serial.baud)
    if warning is not None:
        print(f"txt1: serial.baud: {warning}", file=sys.stderr)
