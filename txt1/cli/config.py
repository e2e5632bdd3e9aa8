"""`txt1 config`: show or check a configuration."""

import argparse
import json
import os

from txt1.commands import OK, add_actions, existing, takes
from txt1.config import completed, flatten, load, origin_of
from txt1.kit.options import CONFIGURATION, VEHICLE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    file = {"file": takes("FILE", kind=existing)}
    add_actions(parser, {"show": (show, CONFIGURATION | VEHICLE), "check": (check, file)})


def show(arguments: argparse.Namespace) -> int:
    """Print every value in force and its origin."""
    given = {"vehicle": arguments.vehicle} if arguments.vehicle else {}
    loaded = load(arguments.config, arguments.set, os.environ, given)
    values = flatten(completed(loaded.config))
    rows = [(f"{key}:", json.dumps(value), origin_of(key, loaded.origins)) for key, value in values]
    key_width = max(len(key) for key, _, _ in rows)
    value_width = max((len(value) for _, value, _ in rows if len(value) <= 24), default=0)
    for key, value, origin in rows:
        print(f"{key:<{key_width}}  {value:<{value_width}}  # {origin}")
    return OK


def check(arguments: argparse.Namespace) -> int:
    """Check whether a file is a valid configuration."""
    load(arguments.file)
    print(f"{arguments.file}: valid")
    return OK
