"""`txt1 log`: look into a recording, export or recover it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from txt1.cli.exit_codes import OK
from txt1.cli.options import existing
from txt1.errors import ConfigError
from txt1.record.session import MODULES, need

if TYPE_CHECKING:
    from txt1.record.reading import Item


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")

    def add(name: str, main: Callable[[argparse.Namespace], int], about: str) -> argparse.ArgumentParser:
        action = actions.add_parser(name, help=about)
        action.add_argument("file", type=existing, metavar="FILE")
        action.set_defaults(main=main)
        return action

    add("info", show_info, "print its topics with counts, rates and gaps")
    cat = add("cat", print_messages, "print its messages, one JSON object a line")
    export = add("export", export_csv, "write one CSV file per topic")
    export.add_argument("-o", "--output", type=Path, metavar="DIR", help="where to; FILE's name without .mcap")
    for chooser in (cat, export):
        chooser.add_argument(
            "--topic", action="append", default=[], metavar="TOPIC", help="only this one; may be repeated"
        )
        chooser.add_argument("--from", type=float, dest="start", metavar="S", help="only from this time stamp on")
        chooser.add_argument("--to", type=float, dest="end", metavar="S", help="only up to this time stamp")
    recover = add("recover", recover_file, "make a complete file of one that breaks off")
    recover.add_argument("-o", "--output", type=Path, metavar="FILE", help="the new file; FILE.recovered.mcap")


def show_info(arguments: argparse.Namespace) -> int:
    """Print a recording's summary."""
    need("txt1 log", "record", *MODULES)
    from txt1.record import summary

    for line in summary.info(arguments.file):
        print(line)
    return OK


def print_messages(arguments: argparse.Namespace) -> int:
    """Print a recording's messages."""
    need("txt1 log", "record", *MODULES)
    from txt1.record import summary

    for line in summary.lines(_chosen(arguments)):
        print(line)
    return OK


def export_csv(arguments: argparse.Namespace) -> int:
    """Write a recording's topics as CSV."""
    need("txt1 log", "record", *MODULES)
    from txt1.record import summary

    directory = arguments.output or arguments.file.with_suffix("")
    for path, rows in summary.export(_chosen(arguments), directory).items():
        print(f"{path}: {rows} rows")
    return OK


def _chosen(arguments: argparse.Namespace) -> Iterator[Item]:
    """Return the messages that were asked for; raises ConfigError for a topic that the recording does not have."""
    from txt1.record import summary
    from txt1.record.reading import Reading

    reading, topics = Reading(arguments.file), frozenset(arguments.topic)
    yield from summary.chosen(reading, topics, arguments.start, arguments.end)
    there = [channel.topic for channel in reading.channels.values()]
    for topic in sorted(topics.difference(there)):
        raise ConfigError(f"--topic {topic}: not in {arguments.file}, which has {', '.join(there) or 'none'}")


def recover_file(arguments: argparse.Namespace) -> int:
    """Make a complete file of one that breaks off."""
    need("txt1 log", "record", *MODULES)
    from txt1.record.recover import recover

    target = arguments.output or arguments.file.with_suffix(".recovered.mcap")
    saved = recover(arguments.file, target)
    whole = ", and the file was complete" if saved.was_complete else f", {saved.unread} bytes at the end were no record"
    damaged = f", {saved.damaged} damaged chunks left out" if saved.damaged else ""
    print(f"{target}: {saved.messages} messages{damaged}{whole}")
    return OK
