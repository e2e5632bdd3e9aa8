"""`txt1 map`: makes a map from a recorded drive."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from txt1.commands import FAULT, OK, add, existing, flag, need, number, path, takes
from txt1.errors import ConfigError
from txt1.record.options import ONE_ROBOT

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from txt1.mapping.mapper import Mapper
    from txt1.mapping.sweeps import Sweep

T = TypeVar("T")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the drive, the map's name, and settings."""
    add(
        parser,
        {
            "file": takes(
                "FILE",
                "a recording with a laser's scans, a bag of ROS 1 or 2 (.bag, .db3, .mcap or its folder), or a log in "
                "CARMEN's format, plain or gzip",
                existing,
            )
        }
        | ONE_ROBOT
        | {
            "-o --output": takes(
                "NAME", "write NAME.yaml, .pgm, .svg and .graph, or extend an existing map (default: FILE's name)", path
            ),
            "--new": flag("begin a new map, even if NAME exists"),
            "--again": flag("make the map again from FILE alone, write nothing, and compare it with NAME's files"),
            "--sensor": takes("NAME", "name of the laser, if there are several"),
            "--scan": takes("TOPIC", "topic of a bag's scans, if there are several"),
            "--odometry": takes("TOPIC", "topic of a bag's odometry, if there are several"),
            "--resolution": takes("M", "side of a cell, m (default 0.05)", number, default=0.05),
        },
    )


class ScanLog(NamedTuple):
    """The scans for a map."""

    sweeps: list[Sweep]
    laser: str
    """Description of the laser and its mount."""
    alone: bool = False
    """Whether there is no odometry."""


def main(arguments: argparse.Namespace) -> int:
    """Make a map, or extend a map, and describe it."""
    need("txt1 map", "fast", "numba", "scipy")
    from txt1.mapping import graph_file

    if not 0.01 <= arguments.resolution <= 1.0:
        raise ConfigError(f"--resolution {arguments.resolution:g}: a cell's side is 0.01 to 1 m")
    output = arguments.output or arguments.file.with_name(arguments.file.name.split(".")[0])
    if output.suffix in (".yaml", ".pgm", ".graph"):
        output = output.with_suffix("")
    source = _source(arguments)
    mapper, drives = _begun(arguments, output, source.alone)
    if _repeats(mapper, source.sweeps):
        raise ConfigError(
            f"{arguments.file}: this drive is on the map {output}.yaml already; --again makes the map again and "
            "compares, --new begins a new one, -o NAME another"
        )
    mapper, closed, odometry = _mapped(mapper, source, arguments.file)
    if not mapper.placed:
        raise ConfigError(
            f"{arguments.file}: this drive fits nowhere on the map {output}.yaml, which stays; --new begins a new one"
        )
    files, remark = graph_file.files_of(mapper, output, arguments.resolution, [*drives, arguments.file.name])
    if arguments.again:
        return compared(files)
    write(files)
    _tell(mapper, source, closed, odometry)
    if remark:
        print(remark)
    print(*files, sep="\n")
    return OK


def _source(arguments: argparse.Namespace) -> ScanLog:
    """Return the scans of a recording, a bag or a log; raises RecordingError, BagError, LogError, ConfigError."""
    from txt1.bags.reader import is_bag
    from txt1.mapping import carmen_logs, sweeps

    if is_bag(arguments.file):
        from txt1.mapping import bag_drives

        drive = bag_drives.read(arguments.file, arguments.scan, arguments.odometry)
        print(f"{arguments.file}: {drive.laser}")
        return ScanLog(drive.sweeps, "the bag's laser", drive.alone)
    if arguments.scan is not None or arguments.odometry is not None:
        raise ConfigError(f"--scan, --odometry: they name topics of a bag of ROS, and {arguments.file} is none")
    if arguments.file.suffix == ".mcap":
        from txt1.record.reader import robot_in

        read = sweeps.read(arguments.file, robot_in(arguments.file, arguments.robot), arguments.sensor)
        mount = read.mount
        return ScanLog(read.sweeps, f"sensors.{read.sensor} at {mount.x:g}, {mount.y:g} m, {mount.yaw:g} rad")
    import numpy as np

    log = carmen_logs.read(arguments.file)
    longest = log.longest
    taken = []
    for scan in log.scans:
        points, pose = carmen_logs.points_of(scan.ranges, scan.angles, longest, scan.swept), np.array(scan.odometry)
        taken.append(sweeps.Sweep(scan.time, points, pose, pose))
    return ScanLog(taken, "the log's laser")


def _begun(arguments: argparse.Namespace, output: Path, alone: bool) -> tuple[Mapper, list[str]]:
    """Return a new mapper, or the mapper of an existing map, and the drives in it."""
    from txt1.mapping import graph_file
    from txt1.mapping.mapper import ALONE, Mapper

    there = output.with_name(output.name + ".graph")
    if not there.exists() or arguments.new or arguments.again:
        if arguments.again:
            if not there.exists():
                raise ConfigError(f"{there}: not there, so there is nothing to compare with; make it without --again")
            _, told = graph_file.load(there)
            if len(told.get("drives", [])) > 1:
                raise ConfigError(
                    f"{there}: of several drives ({', '.join(told['drives'])}); --again takes one of one drive"
                )
        return Mapper(odometry=ALONE if alone else None), []
    mapper, told = graph_file.load(there)
    return mapper, list(told.get("drives", []))


def _repeats(mapper: Mapper, sweeps: list[Sweep]) -> bool:
    """Return whether the map has scans of this drive, more than the one of a start that several drives may share."""
    import numpy as np

    from txt1.mapping.matcher import cloud_of

    taken = {sweep.time: sweep.points for sweep in sweeps}
    alike = 0
    for key in mapper.keys:
        points = taken.get(key.time)
        alike += points is not None and np.array_equal(cloud_of(points, mapper.loops).points, key.cloud.points)
    return alike > 1


def _mapped(mapper: Mapper, source: ScanLog, file: Path) -> tuple[Mapper, int, NDArray[np.float64]]:
    import numpy as np

    from txt1.mapping.poses import composed, difference

    closed, step, before = 0, np.zeros(3), None
    predicted = source.sweeps[0].predicted
    for sweep in _shown(source.sweeps, f"mapping {file.name}"):
        # without odometry, it goes on as it went from one scan to the next
        predicted = composed(predicted, step) if source.alone else sweep.predicted
        match = mapper.add(sweep.time, sweep.points, predicted)
        closed += match.closed
        if source.alone and before is not None and not match.closed:
            step = difference(before, match.pose)
        before = match.pose
    mapper.finish()
    return mapper, closed, np.array([sweep.odometry for sweep in source.sweeps])


def _shown(items: list[T], text: str) -> Iterable[T]:
    """Return the items, with a bar on a terminal."""
    if not sys.stderr.isatty():
        return items
    from rich.console import Console
    from rich.progress import track

    return track(items, text, console=Console(stderr=True), transient=True)


def write(files: dict[Path, bytes]) -> None:
    """Write a map's files; raises ConfigError if a file cannot be written, and then the old files stay."""
    from txt1.mapping.grid_files import put

    try:
        put(files)
    except OSError as error:
        file = str(error.filename or next(iter(files))).removesuffix(".new")
        raise ConfigError(f"{file}: {error.strerror}; the files that were there stay") from None


def compared(files: dict[Path, bytes]) -> int:
    """Print which files are as they were made; return FAULT if a file differs."""
    different = 0
    for file, content in files.items():
        same = file.exists() and file.read_bytes() == content
        different += not same
        print(f"{file}: {'the same bytes' if same else 'DIFFERENT' if file.exists() else 'MISSING'}")
    return FAULT if different else OK


def _tell(mapper: Mapper, source: ScanLog, closed: int, odometry: Any) -> None:
    from txt1.mapping.sweeps import AWRY, awry

    scans, keys = len(mapper.poses), len(mapper.keys)
    print(f"{scans} scans, {keys} keyframes, {closed} loops closed")
    angle = awry(mapper.poses, odometry)
    if angle is not None and abs(angle) > AWRY:
        side = "left" if angle > 0 else "right"
        print(
            f"{source.laser}: it looks {abs(angle):.0f} degrees farther to the {side} than that; measure its pose again"
        )
