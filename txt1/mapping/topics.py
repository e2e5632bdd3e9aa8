"""The telemetry of mapping: the result of each scan, and the topics made from the results."""

from __future__ import annotations

import zlib
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from txt1.maps.grid import Grid
from txt1.maps.keep_out import closed
from txt1.maps.outlines import Outline, outlines
from txt1.sensors.base import reading_topic
from txt1.tasks.encoder import ROOM
from txt1.tasks.on_map import FRAME, Pose, as_pose, in_the_plane
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare


class MapSheet(NamedTuple):
    """A map at an instant, for publishing."""

    resolution: float
    """Side of a cell, m."""
    origin: Pose
    """Pose of its lower left corner: x, y (m), yaw (rad)."""
    rows: int
    columns: int
    cells: bytes
    """int8, row by row from the lowest y: 0 free, 100 wall, -1 unknown; compressed (zlib)."""
    walls: tuple[Outline, ...]
    """The borders of the free floor, closed lines, m."""
    keep_out: tuple[Outline, ...] | None = None
    """The areas that a robot keeps out of, m; None: none."""

    @property
    def grid(self) -> Grid:
        """Return the map as a grid."""
        return _grid(self)

    @property
    def floor(self) -> Grid:
        """Return the map as a grid in which the areas to keep out of are walls."""
        return _floor(self)


@lru_cache(maxsize=2)
def _grid(sheet: MapSheet) -> Grid:
    cells = np.frombuffer(zlib.decompress(sheet.cells), np.int8).reshape(sheet.rows, sheet.columns)
    return Grid(cells, sheet.resolution, sheet.origin)


@lru_cache(maxsize=2)
def _floor(sheet: MapSheet) -> Grid:
    return closed(sheet.grid, sheet.keep_out or ())


def sheet_of(grid: Grid) -> MapSheet:
    """Return a grid for publishing."""
    rows, columns = grid.cells.shape
    packed = zlib.compress(np.ascontiguousarray(grid.cells).tobytes(), 1)
    x, y, yaw = (float(each) for each in grid.origin)
    return MapSheet(float(grid.resolution), (x, y, yaw), rows, columns, packed, outlines(grid))


class MapNews(NamedTuple):
    """The result of a scan."""

    time: float
    """Time of the scan, s of the run."""
    pose: Pose
    """The robot's pose on the map, m and rad."""
    covariance: tuple[float, float, float, float, float, float, float, float, float]
    """Covariance of the pose on the whole map, row by row, m^2 and rad^2."""
    origin: Pose
    """Pose of the odometry's origin on the map: map -> odom."""
    fit: float
    """Share of the scan that fits the map, 0 to 1."""
    lost: bool
    """Whether the pose must not be used."""
    closed: int = 0
    """Number of loops closed so far."""
    sheet: MapSheet | None = None
    """The map, if it has changed."""
    particles: tuple[Pose, ...] = ()
    """Some of the filter's particles, as poses of the laser."""
    trouble: str = ""
    """A problem; empty for none."""
    local: tuple[float, float, float, float, float, float, float, float, float] | None = None
    """Covariance of the pose on the map round it, row by row, m^2 and rad^2; None: that on the whole map.

    On a map in the making the parts that were driven long ago may lie wrong by far more.
    """


_PLACES: Final = (0, 1, 5, 6, 7, 11, 30, 31, 35)
"""Places of a planar covariance in a 6 x 6 covariance."""
_NEWS: Final = define(
    "geometry_msgs/PoseWithCovarianceStamped", "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose"
)
_QUATERNION: Final = ("position.x", "position.y", "orientation.z", "orientation.w")


def news_topic(name: str) -> Topic[MapNews]:
    """Return the topic ``/sensors/NAME`` of the results; its message has the pose, as AMCL's ``/amcl_pose``."""
    return reading_topic(
        name,
        MapNews,
        "m, rad",
        "what each scan has led to on the map",
        _NEWS,
        (*(f"pose.pose.{each}" for each in _QUATERNION), *(f"pose.covariance.{place}" for place in _PLACES)),
        lambda news: (*in_the_plane(news.pose), *news.covariance),
        {"header": {"frame_id": FRAME}},
    )


define(
    "nav_msgs/MapMetaData",
    "builtin_interfaces/Time map_load_time\nfloat32 resolution\nuint32 width\nuint32 height\ngeometry_msgs/Pose origin",
)
define("nav_msgs/OccupancyGrid", "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data")

MAP: Final = declare(
    Topic(
        "/map",
        MapSheet,
        "m",
        "nav_msgs/OccupancyGrid",
        Rule.CHANGE,
        "the map that the robot makes, or drives in",
        {"header": {"frame_id": FRAME}},
        in_snapshots=False,
        make=lambda sheet: {
            "info": {
                "resolution": sheet.resolution,
                "width": sheet.columns,
                "height": sheet.rows,
                "origin": as_pose(sheet.origin),
            },
            "data": zlib.decompress(sheet.cells),
        },
    )
)
MAP_TRANSFORM: Final = declare(
    Topic[Pose](
        "/tf_map",
        tuple,
        "m",
        "tf2_msgs/TFMessage",
        Rule.EVENT,
        "where the odometry began on the map",
        {"transforms": [{"header": {"frame_id": FRAME}, "child_frame_id": "odom"}]},
        ROOM.paths,
        in_the_plane,
    )
)
ROOM_BELOW: Final = declare(
    Topic[Pose](
        "/tf_room_below",
        tuple,
        "m",
        "tf2_msgs/TFMessage",
        Rule.SECOND,
        "where the simulated room is, as seen from odom: a frame has one parent, and the map is odom's",
        {"transforms": [{"header": {"frame_id": "odom"}, "child_frame_id": "room"}]},
        ROOM.paths,
        in_the_plane,
        in_snapshots=False,
    )
)
