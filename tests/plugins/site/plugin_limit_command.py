"""The command "limit"."""

import argparse

from plugin_speed_limit import SpeedLimit


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """It takes none."""


def main(arguments: argparse.Namespace) -> int:
    """Print the default."""
    print(f"{SpeedLimit().v:g} m/s")
    return 0
