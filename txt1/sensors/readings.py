"""The types of the sensors' readings, their units, and their topics.

A value was measured at the time of its `txt1.sensors.Reading`. Axes are the vehicle's: x forward, y left, z up. A value
that the device does not report is None. `mount` is the device's place on the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import atan2, nan, pi
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from txt1.sensors.base import reading_topic
from txt1.telemetry.messages import define
from txt1.telemetry.topics import Topic

STANDARD_GRAVITY: Final = 9.80665
"""m/s^2: the unit g in which devices tell accelerations. `txt1.units.GRAVITY` is that of the simulated world."""

Vector = tuple[float, float, float]
# x, y, z, w
Quaternion = tuple[float, float, float, float]


class Mount(NamedTuple):
    """A device's place: its origin on the vehicle, in m and rad; the vehicle's own origin is on the floor below the
    point that its pose is of (`txt1.model.vehicle.Geometry`).
    """

    # forward, m
    x: float = 0.0
    # left, m
    y: float = 0.0
    # up, m
    z: float = 0.0
    # angle of its x axis to the vehicle's, rad
    yaw: float = 0.0


# height of base_link over the floor, m
BASE_HEIGHT: Final = 0.14605
IMU_MOUNT: Final = Mount(-0.1016, 0.0, BASE_HEIGHT + 0.3187)
GPS_MOUNT: Final = Mount(-0.0762, 0.0, BASE_HEIGHT + 0.3492)
LASER_MOUNT: Final = Mount(0.1905, 0.0, BASE_HEIGHT + 0.1435)
CAMERA_MOUNT: Final = Mount(0.1448, 0.0, BASE_HEIGHT + 0.2832)
TRACKER_MOUNT: Final = Mount()
ALL_ROUND: Final = 5.5
"""rad of a sweep from which a scanner turns all round: others see 270 degrees."""
OPTICAL: Final = "base_camera_optical_link"
"""The camera's optical frame, for users of its pictures (REP 103): z ahead, x to the right."""


def heading(orientation: Quaternion) -> float:
    """Return the heading theta of an orientation, rad in (-pi, pi]."""
    x, y, z, w = orientation
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


# -- IMU ---------------------------------------------------------------------------------------------------------


class ImuSigma(NamedTuple):
    """Standard deviations of an IMU's values."""

    rates: float
    """Standard deviation of each rate, rad/s."""
    acceleration: float
    """Standard deviation of each acceleration, m/s^2."""
    attitude: float
    """Standard deviation of roll and pitch in its orientation, rad."""
    heading: float
    """Standard deviation of its heading, rad."""


_UNKNOWN: Final = ImuSigma(0.0, 0.0, 0.0, 0.0)


class ImuReading(NamedTuple):
    """Accelerations and rates about the vehicle's axes."""

    acceleration: Vector
    """Specific force at the device, m/s^2: at rest on level ground (0, 0, 9.81)."""
    rates: Vector
    """Rates of roll, pitch and yaw, rad/s, left turns positive."""
    orientation: Quaternion | None = None
    """Orientation of the vehicle: roll and pitch against gravity; the device chooses the origin of the heading."""
    magnetic: Vector | None = None
    """Magnetic field, T."""
    mount: Mount = IMU_MOUNT
    sigma: ImuSigma | None = None
    """Standard deviations; None: unknown."""

    def summary(self) -> dict[str, float]:
        """Return its numbers for a line on a screen."""
        (ax, ay, az), (_, _, omega) = self.acceleration, self.rates
        return {"ax": ax, "ay": ay, "az": az, "omega": omega}


_XYZ: Final = ("x", "y", "z")
_IMU: Final = define(
    "sensor_msgs/Imu",
    "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
    "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance",
)


def _imu(value: ImuReading) -> tuple[float, ...]:
    sigma = value.sigma or _UNKNOWN
    rates, force, attitude, heading = (each**2 for each in sigma)
    known = value.orientation is not None
    return (
        *(value.orientation or (0.0, 0.0, 0.0, 1.0)),
        *((attitude, attitude, heading) if known else (-1.0, 0.0, 0.0)),
        *value.rates,
        *(rates,) * 3,
        *value.acceleration,
        *(force,) * 3,
    )


def _diagonal(name: str) -> tuple[str, ...]:
    """Return the paths of the variances in a covariance of 3 x 3."""
    return tuple(f"{name}_covariance.{place}" for place in (0, 4, 8))


def imu_topic(name: str) -> Topic[ImuReading]:
    """Return the topic ``/sensors/NAME`` of an IMU.

    Covariances follow sensor_msgs/Imu: all 0 if a reading has no `sigma`, as they are unknown; and -1 in the first
    place of the orientation's if a reading has no orientation.
    """
    return reading_topic(
        name,
        ImuReading,
        "m/s^2, rad/s",
        "accelerations and rates",
        _IMU,
        (
            *(f"orientation.{each}" for each in "xyzw"),
            *_diagonal("orientation"),
            *(f"angular_velocity.{each}" for each in _XYZ),
            *_diagonal("angular_velocity"),
            *(f"linear_acceleration.{each}" for each in _XYZ),
            *_diagonal("linear_acceleration"),
        ),
        _imu,
        {"header": {"frame_id": "base_imu_link"}},
    )


# -- GPS ---------------------------------------------------------------------------------------------------------


class FixReading(NamedTuple):
    """A position on the earth, and in the plane: metres east and north of a datum, on the UTM grid."""

    latitude: float
    """Degrees, north positive."""
    longitude: float
    """Degrees, east positive."""
    x: float
    """East of the datum on the grid, m."""
    y: float
    """North of the datum on the grid, m."""
    altitude: float | None = None
    """m."""
    theta: float | None = None
    """Direction of motion on the grid, rad anticlockwise from east."""
    v: float | None = None
    """Speed over ground, m/s, never negative."""
    mode: int = 3
    """2: without height, 3: with height."""
    sigma_x: float | None = None
    """Standard deviation of x, m."""
    sigma_y: float | None = None
    """Standard deviation of y, m."""
    sigma_theta: float | None = None
    """Standard deviation of theta, rad."""
    sigma_v: float | None = None
    """Standard deviation of v, m/s."""
    satellites: int | None = None
    """Number of satellites used."""
    mount: Mount = GPS_MOUNT

    def summary(self) -> dict[str, float]:
        """Return its numbers for a line on a screen."""
        told = {"x": self.x, "y": self.y, "theta": self.theta, "v": self.v, "sigma": self.sigma_x}
        return {name: value for name, value in told.items() if value is not None}


_FIX_FIELDS: Final = (
    "latitude",
    "longitude",
    "altitude",
    "x",
    "y",
    "theta",
    "v",
    "sigma_x",
    "sigma_y",
    "sigma_theta",
    "sigma_v",
)
_FIX: Final = define(
    "txt1_msgs/Fix",
    "std_msgs/Header header\nint32 mode\nint32 satellites\n" + "\n".join(f"float64 {each}" for each in _FIX_FIELDS),
)


def _fix(value: FixReading) -> tuple[float, ...]:
    known = (getattr(value, name) for name in _FIX_FIELDS)
    satellites = -1 if value.satellites is None else value.satellites
    return value.mode, satellites, *(nan if each is None else each for each in known)


def fix_topic(name: str) -> Topic[FixReading]:
    """Return the topic ``/sensors/NAME`` of a GPS. Unknown numbers are NaN there, unknown satellites -1."""
    return reading_topic(
        name,
        FixReading,
        "m, rad, m/s",
        "position on the earth and on the grid",
        _FIX,
        ("mode", "satellites", *_FIX_FIELDS),
        _fix,
        {"header": {"frame_id": "grid"}},
    )


# -- motion capture ----------------------------------------------------------------------------------------------


class TrackerReading(NamedTuple):
    """A pose in the room, seen by cameras, and the velocities that a differentiator computes from poses."""

    x: float
    """m."""
    y: float
    """m."""
    z: float
    """m."""
    orientation: Quaternion
    v: float | None = None
    """Speed forward, m/s."""
    omega: float | None = None
    """Yaw rate, rad/s."""
    subject: str = ""
    """Name of the tracked body."""
    mount: Mount = TRACKER_MOUNT
    # standard deviations, m and rad, if they are known
    sigma_x: float | None = None
    sigma_y: float | None = None
    sigma_theta: float | None = None

    @property
    def theta(self) -> float:
        """Heading, rad in (-pi, pi]."""
        return heading(self.orientation)

    def summary(self) -> dict[str, float]:
        """Return its numbers for a line on a screen."""
        told = {"x": self.x, "y": self.y, "theta": self.theta, "v": self.v, "omega": self.omega}
        return {name: value for name, value in told.items() if value is not None}


def _tracked(value: TrackerReading) -> tuple[float, ...]:
    v, omega = (nan if each is None else each for each in (value.v, value.omega))
    return value.x, value.y, value.z, *value.orientation, v, omega


def tracker_topic(name: str) -> Topic[TrackerReading]:
    """Return the topic ``/sensors/NAME`` of a motion capture system; unknown velocities are NaN there."""
    return reading_topic(
        name,
        TrackerReading,
        "m, rad, m/s, rad/s",
        "pose seen by motion capture",
        "nav_msgs/Odometry",
        (
            *(f"pose.pose.position.{each}" for each in _XYZ),
            *(f"pose.pose.orientation.{each}" for each in "xyzw"),
            "twist.twist.linear.x",
            "twist.twist.angular.z",
        ),
        _tracked,
        {"header": {"frame_id": "room"}, "child_frame_id": "base_footprint"},
    )


# -- laser -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Scan:
    """A sweep of a laser scanner; the time of its reading is that of the first beam.

    Attributes:
        angle_min: angle of the first beam in the device's frame, rad, anticlockwise from straight ahead.
        angle_step: angle between two beams, rad; negative for a clockwise sweep.
        time_step: time between two beams, s.
        ranges: m, read-only; inf if nothing is in range, NaN if the device reports a failure.
        range_min: shortest measurable range, m.
        range_max: longest measurable range, m.
        intensities: in the device's own unit, read-only; None if it reports none.
        mount: the device's place on the vehicle.
        scan_time: time between two sweeps, s; None if it is unknown.

    """

    angle_min: float
    angle_step: float
    time_step: float
    ranges: NDArray[np.float32] = field(repr=False)
    range_min: float
    range_max: float
    intensities: NDArray[np.float32] | None = field(default=None, repr=False)
    mount: Mount = LASER_MOUNT
    scan_time: float | None = None

    def __post_init__(self) -> None:
        self.ranges.flags.writeable = False

    @cached_property
    def angles(self) -> NDArray[np.float64]:
        """Angles of the beams in the vehicle's frame, rad."""
        return self.mount.yaw + self.angle_min + self.angle_step * np.arange(len(self.ranges), dtype=np.float64)

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """Return the points that the beams hit, (n, 2) in m in the vehicle's frame."""
        hit = np.isfinite(self.ranges)
        ranges, angles = self.ranges[hit].astype(float), self.angles[hit]
        return np.column_stack((self.mount.x + ranges * np.cos(angles), self.mount.y + ranges * np.sin(angles)))

    @cached_property
    def all_round(self) -> bool:
        """Whether the scanner turns all round, known beams or not."""
        return len(self.ranges) * abs(self.angle_step) > ALL_ROUND

    @cached_property
    def shows_behind(self) -> bool:
        """Whether each beam of a turn that points backwards is known, or both its neighbours are."""
        unknown = np.isnan(self.ranges) & (np.cos(self.angles) < 0.0)
        return not (unknown & np.roll(unknown, 1)).any()

    def summary(self) -> dict[str, float]:
        """Return nearest range (m), its direction (degrees) and the number of hits, for a line on a screen."""
        hit = np.isfinite(self.ranges)
        count = float(hit.sum())
        if not count:
            return {"hits": count}
        nearest = int(np.nanargmin(self.ranges))
        return {"nearest": float(self.ranges[nearest]), "at": float(self.angles[nearest]) * 180.0 / pi, "hits": count}


_SCAN: Final = define(
    "sensor_msgs/LaserScan",
    "std_msgs/Header header\nfloat32 angle_min\nfloat32 angle_max\nfloat32 angle_increment\nfloat32 time_increment\n"
    "float32 scan_time\nfloat32 range_min\nfloat32 range_max\nfloat32[] ranges\nfloat32[] intensities",
)


def _scan(value: Scan) -> Mapping[str, Any]:
    beams = len(value.ranges)
    return {
        "angle_min": value.angle_min,
        "angle_max": value.angle_min + value.angle_step * (beams - 1),
        "angle_increment": value.angle_step,
        "time_increment": value.time_step,
        "scan_time": value.time_step * beams if value.scan_time is None else value.scan_time,
        "range_min": value.range_min,
        "range_max": value.range_max,
        "ranges": value.ranges.tolist(),
        "intensities": () if value.intensities is None else value.intensities.tolist(),
    }


def scan_topic(name: str) -> Topic[Scan]:
    """Return the topic ``/sensors/NAME`` of a laser scanner."""
    return reading_topic(
        name,
        Scan,
        "m, degrees",
        "ranges of a laser scanner",
        _SCAN,
        (),
        _scan,
        {"header": {"frame_id": "base_laser_link"}},
    )


# -- cameras -----------------------------------------------------------------------------------------------------


class Image(NamedTuple):
    """A picture."""

    width: int
    """Pixels."""
    height: int
    """Pixels."""
    data: bytes
    """JPEG."""
    mount: Mount = CAMERA_MOUNT

    def summary(self) -> dict[str, float]:
        """Return its size for a line on a screen."""
        return {"width": self.width, "height": self.height, "kB": len(self.data) / 1000.0}


_COMPRESSED: Final = define("sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data")


def image_topic(name: str) -> Topic[Image]:
    """Return the topic ``/sensors/NAME`` of a camera."""
    return reading_topic(
        name,
        Image,
        "pixels",
        "pictures of a camera",
        _COMPRESSED,
        (),
        lambda image: {"data": image.data},
        {"header": {"frame_id": OPTICAL}, "format": "jpeg"},
    )


class DepthImage(NamedTuple):
    """Distances along a camera's axis, and the pinhole model that turns them into points."""

    width: int
    """Pixels."""
    height: int
    """Pixels."""
    data: bytes
    """Distances row by row from the top left, uint16 little-endian, mm; 0 if nothing was measured."""
    focal: float
    """Focal length, pixels."""
    mount: Mount = CAMERA_MOUNT

    @property
    def depths(self) -> NDArray[np.float32]:
        """Return the distances, (height, width) in m; NaN if nothing was measured."""
        values = np.frombuffer(self.data, "<u2").reshape(self.height, self.width).astype(np.float32) / 1000.0
        values[values == 0.0] = nan
        return values

    def summary(self) -> dict[str, float]:
        """Return the nearest distance (m) and the share of pixels with a distance, for a line on a screen."""
        values = np.frombuffer(self.data, "<u2")
        seen = values[values > 0]
        return {"nearest": float(seen.min()) / 1000.0, "seen": len(seen) / len(values)} if len(seen) else {"seen": 0.0}


_DEPTH: Final = define(
    "sensor_msgs/Image",
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n"
    "uint8[] data",
)


def depth_topic(name: str) -> Topic[DepthImage]:
    """Return the topic ``/sensors/NAME`` of a depth camera."""
    return reading_topic(
        name,
        DepthImage,
        "m",
        "distances seen by a depth camera",
        _DEPTH,
        (),
        lambda image: {
            "height": image.height,
            "width": image.width,
            "step": 2 * image.width,
            "data": image.data,
        },
        {"header": {"frame_id": OPTICAL}, "encoding": "16UC1"},
    )
