"""`txt1 log view`: a recording in a viewer of others, with all that it needs to show it.

A copy of the recording is made first, with what recordings do not have and viewers want: each scan as points, as Rerun
shows no sensor_msgs/LaserScan, and the places of the sensors as static transforms.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.writer import Writer

from txt1.errors import ConfigError
from txt1.installing import installs
from txt1.kernel.clock import NS_PER_S
from txt1.record.layout import encode
from txt1.record.options import LAYOUT
from txt1.record.reading import Decoding, FilePass, Item
from txt1.ros.topics import fixed
from txt1.ros.urdf import links_of
from txt1.sensors.readings import FixReading, Image, ImuReading, Scan
from txt1.telemetry.messages import define, schema_name, schema_text

define("sensor_msgs/PointField", "string name\nuint32 offset\nuint8 datatype\nuint32 count")
POINTS: Final = define(
    "sensor_msgs/PointCloud2",
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n"
    "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense",
)
FLOAT32: Final = 7  # a PointField's datatype
_FIELDS: Final = [
    {"name": name, "offset": 4 * place, "datatype": FLOAT32, "count": 1} for place, name in enumerate("xyz")
]
SCAN: Final = "sensor_msgs/msg/LaserScan"
SCRIPT: Final = Path(__file__).with_name("rerun_script.py")


def points(scan: Any) -> dict[str, Any]:
    """Return a LaserScan's echoes as the fields of a PointCloud2, in the laser's own frame."""
    ranges = np.asarray(scan.ranges, np.float32)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    hit = np.isfinite(ranges)
    cloud = np.zeros((int(hit.sum()), 3), np.float32)
    cloud[:, 0], cloud[:, 1] = ranges[hit] * np.cos(angles[hit]), ranges[hit] * np.sin(angles[hit])
    return {
        "header": {
            "stamp": {"sec": scan.header.stamp.sec, "nanosec": scan.header.stamp.nanosec},
            "frame_id": scan.header.frame_id,
        },
        "height": 1,
        "width": len(cloud),
        "fields": _FIELDS,
        "point_step": 12,
        "row_step": 12 * len(cloud),
        "data": cloud.tobytes(),
        "is_dense": True,
    }


class _Copy:
    """A new file that is written message by message."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._numbers = count()

    def add(self, topic: str, schema: str, text: bytes, time: int, data: bytes) -> None:
        """Add a message; its channel is made with the first one."""
        if topic not in self._channels:
            if schema not in self._schemas:
                self._schemas[schema] = self._writer.register_schema(schema, "ros2msg", text)
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[schema])
        self._writer.add_message(self._channels[topic], time, data, time, next(self._numbers))

    def tell(self, topic: str, message: str, time: int, values: Any) -> None:
        """Add a message of ours."""
        text = schema_text(message).encode()
        self.add(topic, schema_name(message), text, time, bytes(encode(message, values)))


def viewable(source: Path, target: Path) -> int:
    """Write a recording with points and static transforms beside all that it has; returns how many clouds.

    Raises RecordingError: the recording cannot be read.
    """
    reading, decoding, clouds = FilePass(source), Decoding(), 0
    with target.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "txt1")
        copy = _Copy(writer)
        for item in _with_places(reading, copy):
            copy.add(item.topic, item.schema.name, item.schema.data, item.message.log_time, item.message.data)
            if item.schema.name == SCAN:
                clouds += 1
                copy.tell(f"{item.topic}/points", POINTS, item.message.log_time, points(decoding.message(item)))
        writer.finish()  # type: ignore[no-untyped-call]
    return clouds


def _with_places(reading: FilePass, copy: _Copy) -> Iterator[Item]:
    """Yield every message; before the first the static transforms are told."""
    told = False
    for item in reading:
        if not told:
            told = True
            links = fixed(links_of([Scan, Image, ImuReading, FixReading]))
            values: Any = links.make(None)
            seconds, nanoseconds = divmod(item.message.log_time, NS_PER_S)
            for each in values["transforms"]:
                each["header"] = {**each["header"], "stamp": {"sec": seconds, "nanosec": nanoseconds}}
            copy.tell("/tf_static", links.message, item.message.log_time, values)
        yield item


def python_of_rerun() -> str | None:
    """Return the Python that has Rerun's library: this one, or that beside the program `rerun`; None: there is none."""
    if find_spec("rerun") is not None:
        return sys.executable
    program = shutil.which("rerun")
    beside = program and Path(program).resolve().with_name("python")
    return str(beside) if beside and beside.exists() else None


def view(file: Path, save: Path | None) -> int:
    """Show a recording in Rerun with a layout, or save that as a file of Rerun's; returns the exit code.

    Raises ConfigError: Rerun is not here; it says how to get it, and how Foxglove opens the file.
    """
    python = python_of_rerun()
    if python is None:
        raise ConfigError(
            f"there is no Rerun here: {installs('rerun')}; or open {file} in Foxglove, with the layout {LAYOUT}"
        )
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / file.name
        viewable(file, copy)
        words = [python, str(SCRIPT), str(copy), *([str(save)] if save else [])]
        return subprocess.run(words, check=False).returncode  # noqa: S603
