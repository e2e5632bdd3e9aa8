"""`txt1 log view`: a recording in a viewer of others, with all that it needs to show it.

First a copy of the recording is made, with additions for viewers. Scans, walls of a map, particles, the paths, and the
outlines of body, room and obstacles are added as points, because Rerun shows no sensor_msgs/LaserScan,
nav_msgs/OccupancyGrid, geometry_msgs/PoseArray or visualization_msgs/Marker. Speeds of odometry and set-point, and the
outputs, are added as sensor_msgs/JointState, whose numbers it plots. The sensors' places are added as transforms.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import count
from math import hypot
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

from txt1.errors import ConfigError
from txt1.installing import installs_package
from txt1.kernel.clock import NS_PER_S
from txt1.record.cdr import encode
from txt1.record.options import LAYOUT
from txt1.record.reader import Decoding, FilePass, Item
from txt1.sensors.mounts import ORIGINAL, TF_STATIC, mounted
from txt1.sensors.ros_messages import POINTS, cloud
from txt1.tasks.controller import PWM, SETPOINT
from txt1.tasks.encoder import ODOMETRY as ODOMETRY_TOPIC
from txt1.tasks.markers import CUBE, LINES
from txt1.telemetry.messages import define, schema_name, schema_text

Array = NDArray[np.float64]
NUMBERS: Final = define(
    "sensor_msgs/JointState",
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
)
SCAN: Final = "sensor_msgs/msg/LaserScan"
MAP: Final = "nav_msgs/msg/OccupancyGrid"
PARTICLES: Final = "geometry_msgs/msg/PoseArray"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
CAMERA: Final = "sensor_msgs/msg/CameraInfo"
PLACE: Final = "geometry_msgs/msg/PoseWithCovarianceStamped"
OUTLINES: Final = "visualization_msgs/msg/MarkerArray"
# per cent: no floor to drive on
OCCUPIED_FROM: Final = 50
WAY_STEP: Final = 0.05  # m
# m between two points of an outline
DOTS: Final = 0.03
SCRIPT: Final = Path(__file__).with_name("rerun_script.py")


def points(scan: Any) -> dict[str, Any]:
    """Return a LaserScan's echoes as the fields of a PointCloud2, in the laser's own frame."""
    ranges = np.asarray(scan.ranges, np.float32)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    hit = np.isfinite(ranges)
    return _cloud(scan.header, ranges[hit] * np.cos(angles[hit]), ranges[hit] * np.sin(angles[hit]))


def walls(grid: Any) -> dict[str, Any]:
    """Return the walls of an OccupancyGrid as the fields of a PointCloud2."""
    about = grid.info
    cells = np.asarray(grid.data).reshape(about.height, about.width)
    rows, columns = np.nonzero(cells >= OCCUPIED_FROM)
    x, y, turn = (
        about.origin.position.x,
        about.origin.position.y,
        2.0 * np.arctan2(about.origin.orientation.z, about.origin.orientation.w),
    )
    u, v = about.resolution * (columns + 0.5), about.resolution * (rows + 0.5)
    return _cloud(grid.header, x + u * np.cos(turn) - v * np.sin(turn), y + u * np.sin(turn) + v * np.cos(turn))


def particles(poses: Any) -> dict[str, Any]:
    """Return the places of a PoseArray as the fields of a PointCloud2."""
    places = [each.position for each in poses.poses]
    return _cloud(poses.header, [each.x for each in places], [each.y for each in places])


class _Way:
    """The way so far, as points, each time that it has grown by `WAY_STEP` and by a fiftieth."""

    def __init__(self) -> None:
        self._places: list[tuple[float, float]] = []
        self._due = 0

    def points(self, message: Any) -> dict[str, Any] | None:
        """Return the way with another pose, a PoseWithCovarianceStamped or Odometry; None where it has not grown."""
        place = message.pose.pose.position
        if self._places and hypot(place.x - self._places[-1][0], place.y - self._places[-1][1]) < WAY_STEP:
            return None
        self._places.append((place.x, place.y))
        if len(self._places) <= self._due:
            return None
        self._due = len(self._places) + len(self._places) // 50
        return _cloud(message.header, *zip(*self._places, strict=True))


def outlines(markers: Any) -> dict[str, dict[str, Any]]:
    """Return the outlines in a MarkerArray as the fields of PointCloud2s, by their frames."""
    found: dict[str, list[Array]] = defaultdict(list)
    headers: dict[str, Any] = {}
    for each in markers.markers:
        x, y = each.pose.position.x, each.pose.position.y
        if each.type == CUBE:
            a, b = 0.5 * each.scale.x, 0.5 * each.scale.y
            corners = np.array([(x + a, y + b), (x - a, y + b), (x - a, y - b), (x + a, y - b), (x + a, y + b)])
        elif each.type == LINES:
            corners = np.array([(x + point.x, y + point.y) for point in each.points]).reshape(-1, 2)
        else:
            corners = np.array([(x, y)])
        headers[each.header.frame_id] = each.header
        found[each.header.frame_id].append(_dotted(corners))
    return {frame: _cloud(headers[frame], *np.vstack(parts).T) for frame, parts in found.items()}


def _dotted(corners: Array) -> Array:
    """Return points along a line through corners, (n, 2) in m, `DOTS` apart."""
    if len(corners) < 2:
        return corners
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))))
    places = np.linspace(0.0, along[-1], max(2, min(int(along[-1] / DOTS), 100_000)))
    return np.column_stack([np.interp(places, along, corners[:, axis]) for axis in (0, 1)])


def numbers(header: Any, values: dict[str, float]) -> dict[str, Any]:
    """Return named numbers as the fields of a JointState, which viewers plot."""
    stamp = {"sec": header.stamp.sec, "nanosec": header.stamp.nanosec}
    return {"header": {"stamp": stamp}, "name": list(values), "position": list(values.values())}


def _cloud(header: Any, x: Any, y: Any) -> dict[str, Any]:
    """Return places (m) in the plane of a frame as the fields of a PointCloud2."""
    places = np.zeros((1, len(x), 3), np.float32)
    places[0, :, 0], places[0, :, 1] = x, y
    return {
        "header": {
            "stamp": {"sec": header.stamp.sec, "nanosec": header.stamp.nanosec},
            "frame_id": header.frame_id,
        },
        **cloud(places),
    }


class _Copy:
    """A new file that is written message by message."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._numbers = count()

    def add(self, topic: str, schema: str, text: bytes, time: int, data: bytes) -> None:
        """Add a message; the first message makes its channel."""
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
    # told once a second: without them, body and walls would be missing at the beginning
    outlined = next((item for item in FilePass(source) if item.schema.name == OUTLINES), None)
    shown, ways = {SCAN: points, MAP: walls, PARTICLES: particles}, defaultdict[str, _Way](_Way)
    paths = (PLACE, ODOMETRY)
    with target.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "txt1")
        copy = _Copy(writer)
        for item in _with_places(reading, copy):
            time = item.message.log_time
            if not item.schema.name or (item.schema.name == CAMERA and not any(decoding.message(item).k)):
                # of another program, without a definition: viewers cannot read it, either; of a camera that is not
                # calibrated: Rerun then draws nothing of its pictures
                continue
            if outlined is not None:
                clouds += _draw(copy, outlined, decoding, time)
                outlined = None
            copy.add(item.topic, item.schema.name, item.schema.data, item.message.log_time, item.message.data)
            made = ways[item.topic].points if item.schema.name in paths else shown.get(item.schema.name)
            cloud = None if made is None else made(decoding.message(item))
            if cloud is not None:
                clouds += 1
                copy.tell(f"{item.topic}/points", POINTS, time, cloud)
            if item.schema.name == OUTLINES:
                clouds += _draw(copy, item, decoding, time)
            elif item.name in (ODOMETRY_TOPIC.name, SETPOINT.name):
                message = decoding.message(item)
                twist = message.twist.twist if item.schema.name == ODOMETRY else message.twist
                speeds = numbers(message.header, {"v": twist.linear.x, "omega": twist.angular.z})
                copy.tell(f"{item.topic}/speeds", NUMBERS, time, speeds)
            elif item.name == PWM.name:
                message = decoding.message(item)
                outputs = {name: float(getattr(message, name)) for name in PWM.paths}
                copy.tell(f"{item.topic}/outputs", NUMBERS, time, numbers(message.header, outputs))
        writer.finish()  # type: ignore[no-untyped-call]
    return clouds


def _draw(copy: _Copy, item: Item, decoding: Decoding, time: int) -> int:
    """Add the outlines of a MarkerArray as of a time; return how many clouds."""
    found = outlines(decoding.message(item))
    for frame, outline in found.items():
        copy.tell(f"{item.topic}/{frame}", POINTS, time, outline)
    return len(found)


def _with_places(reading: FilePass, copy: _Copy) -> Iterator[Item]:
    """Yield every message; before the first the places of the original's sensors are told, which the recording's own
    replace.
    """
    told = False
    for item in reading:
        if not told:
            told = True
            values = mounted(ORIGINAL)
            seconds, nanoseconds = divmod(item.message.log_time, NS_PER_S)
            for each in values["transforms"]:
                each["header"] = {**each["header"], "stamp": {"sec": seconds, "nanosec": nanoseconds}}
            copy.tell(TF_STATIC.name, TF_STATIC.message, item.message.log_time, values)
        yield item


def python_of_rerun() -> str | None:
    """Return a Python with Rerun's library: this one, or the one beside the program `rerun`; None: there is none."""
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
            f"there is no Rerun here: {installs_package('rerun-sdk')}; or open {file} in Foxglove, with the "
            f"layout {LAYOUT}"
        )
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / file.name
        viewable(file, copy)
        words = [python, str(SCRIPT), str(copy), *([str(save)] if save else [])]
        return subprocess.run(words, check=False).returncode  # noqa: S603
