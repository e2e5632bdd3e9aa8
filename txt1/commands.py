"""Shared parts of all commands, the front's own and those of additions: exit codes, options, values, output.

It imports next to nothing, so that a command's help appears at once.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from math import inf, isfinite
from pathlib import Path
from types import FrameType
from typing import Any, Final, Literal, TypeVar

from txt1.errors import MissingExtra

# all went as asked, or the reader of the output closed it
OK: Final = 0
# a fault of the hardware, a task, the terminal, or a damaged file
FAULT: Final = 1
USAGE: Final = 2
# by the safety gate
DISARMED: Final = 3
# a stop was not obeyed at once, or the robot was not seen to stand
UNSTOPPED: Final = 4
# a guard of the safety gate failed
UNGUARDED: Final = 5
EXIT_CODES: Final = {
    OK: "it ended as asked, or its output was no longer read",
    FAULT: "a fault: hardware, a task, the terminal, a damaged file, no link to the board, a check that failed",
    USAGE: "a mistake in the command line or the configuration, or a file or an extra that is not there",
    DISARMED: "the safety gate disarmed the robot, or kept it from being armed",
    UNSTOPPED: "it did not obey a stop, or was not seen to stand",
    UNGUARDED: "a guard of the safety gate failed, so the run was ended",
}
"""The meaning of each exit code; docs/reference/exit-codes.md has this table, too."""
# the exit code is 128 + n, outputs neutral
SIGNALS: Final = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
STDOUT: Final = 1


@contextmanager
def signals_to(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Within the block, only `handler` gets the signals that end a command; call it in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {each: signal.signal(each, handler) for each in SIGNALS}
    try:
        yield
    finally:
        for each, former in before.items():
            signal.signal(each, former)


def say(text: str) -> None:
    """Print a message to the user beside the output."""
    print(f"txt1: {text}", file=sys.stderr)


T = TypeVar("T")
View = Literal["screens", "lines", "nothing"]


def view_of(arguments: argparse.Namespace) -> View:
    """Return the operator's view; without a terminal, and at full speed, lines replace the screens."""
    return "nothing" if arguments.json else "lines" if arguments.headless else "screens"


def need(feature: str, extra: str, *modules: str) -> None:
    """Raise MissingExtra unless the modules of an optional feature are installed."""
    if any(find_spec(module) is None for module in modules):
        raise MissingExtra(feature, extra)


# -- values --------------------------------------------------------------------------------------------------------


def _word(make: Callable[[str], T], fits: Callable[[T], bool], what: str) -> Callable[[str], T]:
    """Return a converter of words; it raises ArgumentTypeError for a word that is not `what`."""

    def value(text: str) -> T:
        with suppress(ValueError):
            if fits(found := make(text)):
                return found
        raise argparse.ArgumentTypeError(f"'{text}' is not {what}")

    return value


number = _word(float, isfinite, "a finite number")
positive = _word(float, lambda value: 0.0 < value < inf, "a positive number")
count = _word(int, lambda value: value >= 1, "a whole number from 1")
seed = _word(int, lambda value: value >= 0, "a whole number from 0")
speed = _word(
    lambda text: text if text == "max" else float(text),
    lambda value: value == "max" or 0.0 < float(value) < inf,
    "max or a positive number",
)


def velocity(text: str) -> tuple[float, float]:
    """Convert a word to a velocity in m/s and rad/s; raises ArgumentTypeError."""
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"'{text}' is not V,OMEGA, for example 0.5,0.3")
    return number(parts[0]), number(parts[1])


def bridge_options(text: str) -> tuple[str, dict[str, object]]:
    """Convert a word to a bridge's name and options, each a number, true, false or text; raises ArgumentTypeError."""
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
    """Convert a word to an address, by default on 127.0.0.1; raises ArgumentTypeError."""
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or not 0 <= int(port) <= 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not HOST:PORT, for example 127.0.0.1:5701")
    return host.strip("[]") or "127.0.0.1", int(port)


def named_url(text: str) -> tuple[str, str]:
    """Convert a word to a robot's name and its page's address; raises ArgumentTypeError."""
    name, _, url = text.partition("=")
    if not (name and url.startswith(("http://", "https://"))):
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME=URL, for example txt02=https://txt02.local:8080")
    return name, url


def is_loopback(host: str) -> bool:
    """Whether an address is that of this computer itself."""
    from ipaddress import ip_address

    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def names(text: str) -> list[str]:
    """Split a word with commas into names."""
    return [name for name in text.split(",") if name]


def path(text: str) -> Path:
    """Convert a word to a path; raises ArgumentTypeError for an empty word, as from a variable that is not set."""
    if not text:
        raise argparse.ArgumentTypeError("'' is no name of a file or folder; give a name")
    return Path(text)


def existing(text: str) -> Path:
    """Convert a word to the path of an existing file or folder; raises ArgumentTypeError."""
    found = path(text)
    if not found.exists():
        raise argparse.ArgumentTypeError(f"there is no file '{text}'; check the name")
    return found


# -- options -------------------------------------------------------------------------------------------------------


@contextmanager
def busy(text: str) -> Iterator[None]:
    """On a terminal, show that work is going on until the block ends."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(f"{text} ..."):
        yield


def unused(folder: Path) -> Path:
    """Return the folder, or the first unused name with a number."""
    names = (folder, *(folder.with_name(f"{folder.name}-{number}") for number in range(2, 10_000)))
    return next(each for each in names if not each.exists())


def takes(metavar: str, about: str | None = None, kind: Callable[[str], Any] = str, **more: Any) -> dict[str, Any]:
    """Return the settings of argparse for an argument with a value, which `kind` converts."""
    return {"metavar": metavar, "help": about, "type": kind, **more}


def flag(about: str, **more: Any) -> dict[str, Any]:
    """Return the settings of argparse for an option without a value."""
    return {"action": "store_true", "help": about, **more}


def gone(instead: str) -> dict[str, Any]:
    """Return the settings of argparse for an option that is gone: no help, and a refusal that names the remedy."""

    def refuse(text: str) -> None:
        raise argparse.ArgumentTypeError(f"there is no such option any more; {instead}")

    return {"help": argparse.SUPPRESS, "type": refuse}


# of a command by their names, from `takes` and `flag`
Arguments = Mapping[str, Mapping[str, Any]]


def add(parser: argparse._ActionsContainer, arguments: Arguments) -> None:
    """Add arguments to a parser, or to a group of it."""
    for names, told in arguments.items():
        parser.add_argument(*names.split(), **told)


def add_actions(
    parser: argparse.ArgumentParser, actions: Mapping[str, tuple[Callable[[argparse.Namespace], int], Arguments]]
) -> None:
    """Add actions: each has a name, a function, whose docstring is its help, and its arguments."""
    parsers = parser.add_subparsers(required=True, metavar="ACTION")
    for name, (main, arguments) in actions.items():
        about = (main.__doc__ or "").rstrip(".")
        action = parsers.add_parser(name, help=about[:1].lower() + about[1:])
        action.set_defaults(main=main)
        add(action, arguments)
    parser.set_defaults(parsers=parsers.choices)
