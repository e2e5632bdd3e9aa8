"""`txt1 hal`: list or check hardware layers."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from types import FrameType
from typing import NoReturn

from txt1.cli.exit_codes import FAULT, OK, SIGNALS
from txt1.cli.options import add_config
from txt1.config import load
from txt1.conformance import BROKEN, verdicts
from txt1.errors import ConfigError
from txt1.hal.conformance import HalConformance
from txt1.hal.registry import HALS, create

DRIVES = "the check drives the wheels at full power, both ways"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    actions.add_parser("list", help="print the names of those that are installed").set_defaults(main=list_hals)
    check = actions.add_parser("check", help=f"run one through the conformance suite; {DRIVES}")
    check.add_argument("name", metavar="NAME")
    check.add_argument("--wheels-up", action="store_true", help="the wheels are off the ground: do not ask")
    add_config(check)
    check.set_defaults(main=check_hal)


def list_hals(_: argparse.Namespace) -> int:
    """Print the names of the hardware layers that are installed."""
    print("\n".join(HALS.names()))
    return OK


def check_hal(arguments: argparse.Namespace) -> int:
    """Run a hardware layer through the conformance suite."""
    config = load(arguments.config, arguments.set, os.environ, {"hal": arguments.name}).config
    capabilities = getattr(create(config), "capabilities", None)  # a HAL that lacks them is what the check is for
    if not (arguments.wheels_up or getattr(capabilities, "simulated", False)):
        _ask(arguments.name)
    kept = True
    before = {number: signal.signal(number, _end) for number in SIGNALS}
    try:
        for text, verdict in verdicts(HalConformance, lambda: create(config)):
            kept = kept and not verdict.startswith(BROKEN)
            print(f"{text}: {verdict}")
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return OK if kept else FAULT


def _end(number: int, _: FrameType | None) -> NoReturn:
    """End by an exception: a check closes its hardware on the way."""
    raise SystemExit(128 + number)


def _ask(name: str) -> None:
    """Return when the user says that the wheels are off the ground; raises ConfigError when not."""
    if sys.stdin.isatty():
        print(f"'{name}' is real hardware, and {DRIVES}. Are they off the ground? [y/N] ", end="", flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    raise ConfigError(f"'{name}' is real hardware, and {DRIVES}: lift them off the ground and add --wheels-up")
