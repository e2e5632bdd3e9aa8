"""`txt1 run`: its options, and those of additions. The robot itself is brought up by `txt1.cli.operating`."""

import argparse

from txt1 import additions, commands
from txt1.cli import options
from txt1.commands import flag, takes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what `run` takes."""
    commands.add(parser, options.ROBOT | options.LOG | options.VIEW | {
        "--duration": takes("S", "end after S seconds of the robot's time", commands.positive),
        "--realtime": flag("ask for SCHED_FIFO, locked memory and a processor of its own; says what was granted"),
        "--headless": flag("no screens; one status line a second"),
        "--json": flag("no screens; one JSON object at the end"),
        "--view-control": flag("let the live view's teleop panel drive"),
    } | options.WEB | options.ROS | options.NETWORK | {
        "--name": takes("NAME", "name of the robot, before the names of its topics and in the fleet"),
        "--cooperate": takes("LAW", "drive by a law of cooperation with those of --team (see docs/fleet.md)"),
        "--team": takes("NAME,NAME,...", "robots that cooperate, the leader of a convoy first", commands.names),
        "--share": takes(
            "EPISODES", "with --learn: learn from the fleet before every so many episodes", commands.count
        ),
        "--bridge": takes(
            "NAME[:KEY=VALUE,...]", "run this bridge beside the robot (entry points txt1.bridges); may be given again",
            commands.bridge_options, action="append", default=[],
        ),
    })  # fmt: skip
    commands.add(parser.add_mutually_exclusive_group(), {
        "--drive": takes("V,OMEGA", "command this velocity throughout: m/s, rad/s", commands.velocity),
        "--source": takes("NAME", "let this source of commands drive (entry points txt1.sources)"),
        "--learn": takes("AGENT", "let this learner learn to find the light (see txt1 learn)"),
        "--policy": takes("FILE", "drive to the light by a learned qtable.json", commands.existing),
    })  # fmt: skip
    commands.add(parser.add_mutually_exclusive_group(), {
        "--arm": flag("arm at the start", default=None),
        "--no-arm": {"dest": "arm", "action": "store_false", "help": "do not arm, not even in simulation"},
    })  # fmt: skip
    optional = {name: additions.load(each.options) for name, each in additions.known().items() if each.options}
    for told in optional.values():
        commands.add(parser.add_argument_group(told.title), told.arguments)
    parser.set_defaults(optional=optional)


def main(arguments: argparse.Namespace) -> int:
    """Run the robot until the duration is over, the operator quits or a signal comes."""
    from txt1.cli.operating import run  # which takes its time to import; the help does without

    return run(arguments)
