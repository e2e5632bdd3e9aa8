"""ROS's standard messages beside a sensor's own: NavSatFix of a GPS, CameraInfo of a camera, PointCloud2 of a depth
camera.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, nan
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from txt1.sensors.readings import OPTICAL, DepthImage, FixReading, Image
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic

define("sensor_msgs/NavSatStatus", "int8 status\nuint16 service")
define(
    "sensor_msgs/NavSatFix",
    "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n"
    "float64[9] position_covariance\nuint8 position_covariance_type",
)
define("sensor_msgs/RegionOfInterest", "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify")
define(
    "sensor_msgs/CameraInfo",
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n"
    "float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi",
)
define("sensor_msgs/PointField", "string name\nuint32 offset\nuint8 datatype\nuint32 count")
POINTS: Final = define(
    "sensor_msgs/PointCloud2",
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n"
    "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense",
)
# a PointField's datatype
FLOAT32: Final = 7
POINT_FIELDS: Final = [
    {"name": name, "offset": 4 * place, "datatype": FLOAT32, "count": 1} for place, name in enumerate("xyz")
]
# most points in a row of a depth camera's cloud: a cloud of all pixels has six times the bytes of the picture
POINTS_ACROSS: Final = 160


def _nav_sat_fix(value: FixReading) -> dict[str, Any]:
    known = value.sigma_x is not None and value.sigma_y is not None
    east, north = value.sigma_x or 0.0, value.sigma_y or 0.0
    # the height of a receiver without an estimate has about twice its error
    up = 4.0 * max(east, north) ** 2
    return {
        "status": {"status": 0 if value.mode >= 2 else -1, "service": 1},
        "latitude": value.latitude,
        "longitude": value.longitude,
        "altitude": nan if value.altitude is None else value.altitude,
        "position_covariance": (east**2, 0.0, 0.0, 0.0, north**2, 0.0, 0.0, 0.0, up),
        "position_covariance_type": 1 if known else 0,
    }


def fix(name: str) -> Topic[FixReading]:
    """Return the topic of this name with a GPS's positions as NavSatFix."""
    return Topic(
        name,
        FixReading,
        "degrees, m",
        "sensor_msgs/NavSatFix",
        Rule.EVENT,
        "a position on the earth",
        {"header": {"frame_id": "base_gps_link"}},
        make=_nav_sat_fix,
        derived=True,
    )


def _info(image: Image | DepthImage) -> dict[str, Any]:
    """Return the model of a pinhole camera; all zero if it is not calibrated."""
    found = {"height": image.height, "width": image.width, "distortion_model": "plumb_bob"}
    if isinstance(image, Image):
        return found
    f, x, y = image.focal, 0.5 * (image.width - 1), 0.5 * (image.height - 1)
    return found | {
        "d": (0.0,) * 5,
        "k": (f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0),
        "r": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        "p": (f, 0.0, x, 0.0, 0.0, f, y, 0.0, 0.0, 0.0, 1.0, 0.0),
    }


def camera_info(name: str) -> Topic[Any]:
    """Return the topic of this name with a camera's model as CameraInfo."""
    return Topic(
        name,
        object,
        "pixels",
        "sensor_msgs/CameraInfo",
        Rule.EVENT,
        "how a camera sees",
        {"header": {"frame_id": OPTICAL}},
        make=_info,
    )


def cloud(points: NDArray[np.float32]) -> dict[str, Any]:
    """Return places, (height, width, 3) in m, as the fields of a PointCloud2 without its header."""
    height, width, _ = points.shape
    return {
        "height": height,
        "width": width,
        "fields": POINT_FIELDS,
        "point_step": 12,
        "row_step": 12 * width,
        "data": points.tobytes(),
        "is_dense": bool(np.isfinite(points).all()),
    }


def _places(image: DepthImage) -> dict[str, Any]:
    """Return the places that a depth camera sees, in its optical frame; NaN where nothing was measured."""
    step = ceil(image.width / POINTS_ACROSS)
    depths = image.depths[::step, ::step]
    u = np.arange(0, image.width, step) - 0.5 * (image.width - 1)
    v = np.arange(0, image.height, step) - 0.5 * (image.height - 1)
    points = np.empty((*depths.shape, 3), np.float32)
    points[..., 0] = depths * (u / image.focal)
    points[..., 1] = depths * (v / image.focal)[:, None]
    points[..., 2] = depths
    return cloud(points)


def depth_points(name: str) -> Topic[DepthImage]:
    """Return the topic of this name with the places that a depth camera sees as PointCloud2."""
    return Topic(
        name,
        DepthImage,
        "m",
        POINTS,
        Rule.EVENT,
        "places that a depth camera sees",
        {"header": {"frame_id": OPTICAL}},
        make=_places,
        derived=True,
    )


_BESIDE: Final[Mapping[type, tuple[tuple[Any, str], ...]]] = {
    FixReading: ((fix, "fix"),),
    Image: ((camera_info, "camera_info"),),
    DepthImage: ((camera_info, "camera_info"), (depth_points, "points")),
}


def beside(topic: Topic[Any]) -> tuple[Topic[Any], ...]:
    """Return the topics with standard messages of a sensor's readings, below the name of its own topic."""
    return tuple(make(f"{topic.name}/{name}") for make, name in _BESIDE.get(topic.type, ()))
