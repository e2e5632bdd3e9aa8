"""`txt1 log`: show, export or recover a recording."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from txt1.commands import OK, add_actions, busy, count, flag, need, number, path, takes
from txt1.errors import ConfigError
from txt1.installing import installs_package
from txt1.plugins import Registry
from txt1.record.options import RECORDING

if TYPE_CHECKING:
    from txt1.record.reader import Item

EXPORTERS: Final = Registry("format", "txt1.exporters", {})
"""Functions that write a recording as a file of another program's."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    chosen = RECORDING | {
        "--topic": takes("TOPIC", "only this one; may be repeated", action="append", default=[]),
        "--from": takes("S", "only from this time of the run; in a file of others, time stamp", number, dest="start"),
        "--to": takes("S", "only up to this time", number, dest="end"),
    }
    folder = {
        "-o --output": takes(
            "DIR", "where to; FILE's name, or FOLDER-tables; of one topic a FILE.csv or .parquet", path
        ),
        "--parquet": flag("a Parquet file for each topic, in place of CSV files"),
        "--rosbag1": flag("one bag of ROS 1, FILE's name with .bag, in place of CSV files"),
        "--tub": takes("DIR", "a camera's pictures and how it drove as a tub of donkeycar in DIR, a new one", path),
        "--lerobot": takes("DIR", "its episodes as a LeRobot dataset in DIR, a new one, in place of CSV files", path),
        "--fps": takes("N", "frames a second of --lerobot; 10 by default", count, default=10),
        "--task": takes("WORDS", "what the episodes of --lerobot show; of a learner's: drive to the light"),
    }
    whole = {"-o --output": takes("FILE", "the new file; FILE.recovered.mcap", path)}
    add_actions(
        parser,
        {
            "info": (show_info, RECORDING),
            "cat": (print_messages, chosen),
            "export": (export_csv, chosen | folder),
            "recover": (recover_file, RECORDING | whole),
            "view": (
                view_file,
                RECORDING
                | {"--save": takes("FILE", "save what Rerun shows as a file of its own, such as run.rrd", path)},
            ),
        },
    )


def show_info(arguments: argparse.Namespace) -> int:
    """Print its topics with counts, rates and gaps."""
    from txt1.bags import summary as bag_summary
    from txt1.record import summary

    with busy(f"reading {arguments.file}"):
        told = bag_summary if _is_bag(arguments) else summary
        lines = list(told.info(arguments.file))
    print(*lines, sep="\n")
    return OK


def print_messages(arguments: argparse.Namespace) -> int:
    """Print its messages, one JSON object a line."""
    from txt1.bags import summary as bag_summary
    from txt1.record import summary

    if _is_bag(arguments):
        lines = bag_summary.lines(arguments.file, arguments.topic, arguments.start, arguments.end)
    else:
        lines = summary.lines(_chosen(arguments))
    for line in lines:
        print(line)
    return OK


def _is_bag(arguments: argparse.Namespace) -> bool:
    """Return whether it is a bag of ROS that is read as such; every MCAP file is read as a recording."""
    from txt1.bags.reader import is_bag

    return arguments.file.suffix != ".mcap" and is_bag(arguments.file)


def export_csv(arguments: argparse.Namespace) -> int:
    """Write a table for each topic, a bag of ROS 1, or a LeRobot dataset."""
    from txt1.record import tables

    if arguments.lerobot:
        export, _ = EXPORTERS.find("--lerobot", "lerobot")
        with busy(f"writing {arguments.lerobot}"):
            episodes, frames = export(arguments.file, arguments.lerobot, arguments.fps, arguments.task)
        print(f"{arguments.lerobot}: {episodes} episode{'s' * (episodes != 1)}, {frames} frames")
        return OK
    if arguments.tub:
        export, _ = EXPORTERS.find("--tub", "tub")
        with busy(f"writing {arguments.tub}"):
            records = export(_chosen(arguments), arguments.file, arguments.tub)
        print(f"{arguments.tub}: {records} records")
        return OK
    if arguments.rosbag1:
        export, _ = EXPORTERS.find("--rosbag1", "rosbag1")
        bag = arguments.output or arguments.file.with_suffix(".bag")
        with busy(f"writing {bag}"):
            messages = export(_for_others(arguments), bag)
        print(f"{bag}: {messages} messages")
        return OK
    place = arguments.output or _tables_of(arguments.file)
    if place.suffix in tables.TABLES and len(arguments.topic) != 1:
        raise ConfigError(f"-o {place}: a single table holds one topic: name it with --topic, or give a folder")
    suffix = ".parquet" if arguments.parquet or place.suffix == ".parquet" else ".csv"
    if place.suffix in tables.TABLES and place.suffix != suffix:
        raise ConfigError(f"-o {place}: --parquet writes Parquet; name it {place.stem}.parquet")
    if suffix == ".parquet" and find_spec("pyarrow") is None:
        raise ConfigError(f"--parquet: needs pyarrow: {installs_package('pyarrow')}")
    with busy(f"writing {place}"):
        items = tables.without_derived(_for_others(arguments), frozenset(arguments.topic))
        written = tables.export(items, place, suffix)
    for table, rows in written.items():
        print(f"{table}: {rows} rows")
    return OK


def _tables_of(file: Path) -> Path:
    """Return the folder for the tables of a recording: FILE without its suffix; beside a bag that is a folder."""
    return file.with_suffix("") if file.is_file() else file.resolve().with_name(f"{file.resolve().name}-tables")


def _for_others(arguments: argparse.Namespace) -> Iterator[Item]:
    """Return the messages that were asked for, and of none only those that are for other programs, too."""
    from txt1.record.tables import without_own

    return without_own(_chosen(arguments), frozenset(arguments.topic))


def _chosen(arguments: argparse.Namespace) -> Iterator[Item]:
    """Return the messages that were asked for; raises ConfigError for a topic that the recording does not have."""
    from txt1.record import summary
    from txt1.record.reader import FilePass

    reading, topics = FilePass(arguments.file), frozenset(arguments.topic)
    yield from summary.chosen(reading, topics, arguments.start, arguments.end)
    there = [channel.topic for channel in reading.channels.values()]
    for topic in sorted(topics.difference(there)):
        raise ConfigError(f"--topic {topic}: not in {arguments.file}, which has {', '.join(there) or 'none'}")


def view_file(arguments: argparse.Namespace) -> int:
    """Show it in Rerun with a layout, scans as points; says how Foxglove opens it."""
    need("reading a recording", "record", "mcap", "mcap_ros2")
    from txt1.record.command.view import view

    return view(arguments.file, arguments.save)


def recover_file(arguments: argparse.Namespace) -> int:
    """Make a complete file from a broken one."""
    from txt1.record.recovery import recover

    target = arguments.output or arguments.file.with_suffix(".recovered.mcap")
    with busy(f"writing {target}"):
        saved = recover(arguments.file, target)
    whole = ", and the file was complete" if saved.was_complete else f", {saved.unread} bytes at the end were no record"
    damaged = f", {saved.damaged} damaged chunks left out" if saved.damaged else ""
    print(f"{target}: {saved.messages} messages{damaged}{whole}")
    return OK
