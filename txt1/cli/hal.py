"""`txt1 hal`: list or check hardware layers."""

import argparse
import os
import sys

from txt1.cli import OK, signals_to
from txt1.cli.options import CONFIGURATION, add_actions, flag, takes
from txt1.cli.verdicts import print_verdicts
from txt1.config import load
from txt1.conformance import verdicts
from txt1.errors import ConfigError
from txt1.hal.conformance import HalConformance
from txt1.hal.registry import HALS, create


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    check = {"name": takes("NAME"), "--wheels-up": flag("the wheels are off the ground: do not ask")} | CONFIGURATION
    add_actions(parser, {"list": (list_hals, {}), "check": (check_hal, check)})


def list_hals(_: argparse.Namespace) -> int:
    """Print the names of those that are installed."""
    print("\n".join(HALS.names()))
    return OK


def check_hal(arguments: argparse.Namespace) -> int:
    """Run one through the conformance suite, which drives the wheels at full power, both ways."""
    config = load(arguments.config, arguments.set, os.environ, {"hal": arguments.name}).config
    capabilities = getattr(create(config), "capabilities", None)  # a HAL that lacks them is what the check is for
    if not (arguments.wheels_up or getattr(capabilities, "simulated", False)):
        real = f"'{arguments.name}' is real hardware, and the check drives the wheels at full power, both ways"
        if sys.stdin.isatty():
            print(f"{real}. Are they off the ground? [y/N] ", end="", flush=True)
        if not (sys.stdin.isatty() and sys.stdin.readline().strip().lower() in ("y", "yes")):
            raise ConfigError(f"{real}: lift them off the ground and add --wheels-up")
    with signals_to(lambda number, _: sys.exit(128 + number)):  # a check closes its hardware on the way
        return print_verdicts(verdicts(HalConformance, lambda: create(config)))
