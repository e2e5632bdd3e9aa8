"""The commands about recordings: their words and what they do. `txt1.cli` hangs them into its parser."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path
from typing import Any

from txt1.command_line import positive
from txt1.kernel.loop import run
from txt1.record.session import need

MODULES = ("mcap", "mcap_ros2", "zstandard", "lz4")


def add_commands(commands: Any) -> None:
    """Add `log`, `replay` and `report` to the subparsers of the program."""
    log = commands.add_parser("log", help="look into a recording, export or recover it")
    actions = log.add_subparsers(required=True, metavar="ACTION")

    info = actions.add_parser("info", help="print its topics with counts, rates and gaps")
    info.add_argument("file", type=Path, metavar="FILE")
    info.set_defaults(command=show_info)

    cat = actions.add_parser("cat", help="print its messages, one JSON object a line")
    _add_choice(cat)
    cat.set_defaults(command=print_messages)

    export = actions.add_parser("export", help="write one CSV file per topic")
    _add_choice(export)
    export.add_argument("-o", "--output", type=Path, metavar="DIR", help="where to; FILE's name without .mcap")
    export.set_defaults(command=export_csv)

    recover = actions.add_parser("recover", help="make a complete file of one that breaks off")
    recover.add_argument("file", type=Path, metavar="FILE")
    recover.add_argument("-o", "--output", type=Path, metavar="FILE", help="the new file; FILE.recovered.mcap")
    recover.set_defaults(command=recover_file)

    replay = commands.add_parser("replay", help="show a recording, or run it again and compare")
    replay.add_argument("file", type=Path, metavar="FILE")
    replay.add_argument("--verify", action="store_true", help="run the recorded inputs through the tasks and compare")
    replay.add_argument("--speed", type=positive, default=1.0, metavar="N", help="as a multiple of real time")
    replay.add_argument("--from", type=float, dest="start", metavar="S", help="begin at this time of the run")
    replay.add_argument("--loop", action="store_true", help="begin anew at the end")
    replay.set_defaults(command=replay_file)

    report = commands.add_parser("report", help="draw a recording: a picture, and one page with everything in it")
    report.add_argument("file", type=Path, metavar="FILE")
    report.add_argument("-o", "--output", type=Path, metavar="STEM", help="STEM.png and STEM.html; FILE without .mcap")
    report.set_defaults(command=draw_report)


def _add_choice(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE")
    parser.add_argument("--topic", action="append", default=[], metavar="TOPIC", help="only this one; may be repeated")
    parser.add_argument("--from", type=float, dest="start", metavar="S", help="only from this time stamp on")
    parser.add_argument("--to", type=float, dest="end", metavar="S", help="only up to this time stamp")


def replay_file(arguments: argparse.Namespace) -> int:
    """Show a recording on the screens, or run it again and say where it first differs."""
    need("txt1 replay", "record", *MODULES)
    if not arguments.verify:
        return _play(arguments)
    from txt1.record.verify import verify

    compared, difference = verify(arguments.file)
    if difference is None:
        print(f"{arguments.file}: no difference in {compared} messages")
        return 0
    print(f"{arguments.file}: {difference}")
    return 1


def _play(arguments: argparse.Namespace) -> int:
    from txt1.record.film import Film
    from txt1.record.replay import play

    film = Film(arguments.file)
    with suppress(KeyboardInterrupt):
        run(play(film, arguments.speed, arguments.start, arguments.loop))
    return 0


def draw_report(arguments: argparse.Namespace) -> int:
    """Draw a recording."""
    need("txt1 report", "record", *MODULES)
    need("txt1 report", "plots", "matplotlib")
    from txt1.record.report import report

    stem = arguments.file.with_suffix("") if arguments.output is None else arguments.output
    for path in report(arguments.file, stem):
        print(path)
    return 0


def show_info(arguments: argparse.Namespace) -> int:
    """Print a recording's summary."""
    need("txt1 log", "record", *MODULES)
    from txt1.record import listing

    for line in listing.info(arguments.file):
        print(line)
    return 0


def print_messages(arguments: argparse.Namespace) -> int:
    """Print a recording's messages."""
    need("txt1 log", "record", *MODULES)
    from txt1.record import listing
    from txt1.record.reading import Reading

    topics = frozenset(arguments.topic)
    for line in listing.lines(listing.chosen(Reading(arguments.file), topics, arguments.start, arguments.end)):
        print(line)
    return 0


def export_csv(arguments: argparse.Namespace) -> int:
    """Write a recording's topics as CSV."""
    need("txt1 log", "record", *MODULES)
    from txt1.record import listing
    from txt1.record.reading import Reading

    directory = arguments.file.with_suffix("") if arguments.output is None else arguments.output
    items = listing.chosen(Reading(arguments.file), frozenset(arguments.topic), arguments.start, arguments.end)
    for path, rows in listing.export(items, directory).items():
        print(f"{path}: {rows} rows")
    return 0


def recover_file(arguments: argparse.Namespace) -> int:
    """Make a complete file of one that breaks off."""
    need("txt1 log", "record", *MODULES)
    from txt1.record.recover import recover

    target = arguments.file.with_suffix(".recovered.mcap") if arguments.output is None else arguments.output
    saved = recover(arguments.file, target)
    whole = ", and the file was complete" if saved.was_complete else f", {saved.unread} bytes at the end were no record"
    damaged = f", {saved.damaged} damaged chunks left out" if saved.damaged else ""
    print(f"{target}: {saved.messages} messages{damaged}{whole}")
    return 0
