"""`txt1 run`: its options, and those of additions. The robot itself is brought up by `txt1.cli.operated_robot`."""

import argparse

from txt1 import additions
from txt1.commands import add, count, flag, positive, takes, velocity
from txt1.errors import ConfigError
from txt1.kit import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `run`."""
    add(
        parser,
        options.ROBOT
        | {
            "--practice": flag(
                "the simulation alone, whatever a file or the environment says: on a track, with a laser and the page"
            ),
            "--duration": takes("S", "end after S seconds of the robot's time", positive),
            "--realtime": flag("ask for SCHED_FIFO, locked memory and a processor of its own, and report the answer"),
            "--screen": takes("N", "first screen, such as 5 for MAP; 1 by default", count),
            "--headless": flag("no screens; a status line every second"),
            "--json": flag("no screens; one JSON object at the end"),
            "--name": takes("NAME", "name of the robot, before the names of its topics and in the fleet"),
        },
    )
    add(
        parser.add_mutually_exclusive_group(),
        {
            "--drive": takes("V,OMEGA", "command this velocity throughout: m/s, rad/s", velocity),
            "--source": takes(
                "NAME", "let this source of commands drive (entry points txt1.sources), or a taught policy, FILE.onnx"
            ),
        },
    )
    add(
        parser.add_mutually_exclusive_group(),
        {
            "--arm": flag("arm at the start", default=None),
            "--no-arm": {"dest": "arm", "action": "store_false", "help": "do not arm, not even in simulation"},
        },
    )
    optional = {name: additions.brought(each, each.options) for name, each in additions.known().items() if each.options}
    for name, told in optional.items():
        try:
            add(parser.add_argument_group(told.title), told.arguments)
        except argparse.ArgumentError as error:
            raise ConfigError(f"the addition '{name}': {error}; uninstall it, or rename its option") from None
    parser.set_defaults(optional=optional)


def main(arguments: argparse.Namespace) -> int:
    """Run the robot until the duration is over, the operator quits or a signal comes."""
    # imported here: it takes time, and the help does not need it
    from txt1.cli.operated_robot import run

    return run(arguments)
