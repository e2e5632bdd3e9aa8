"""The map for the screens: its walls, and the robot's pose on it.

This module reads no map, so screens load it quickly.
"""

from __future__ import annotations

from math import cos, sin
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from txt1.telemetry.messages import define
from txt1.telemetry.topics import Rule, Topic, declare

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from txt1.sim.room import Room

Line = tuple[tuple[float, float], ...]
"""Corners (x, y), m; the last corner is joined to the first."""


Pose = tuple[float, float, float]

FRAME: Final = "map"


def in_the_plane(pose: Pose) -> tuple[float, float, float, float]:
    """Return x, y, and z and w of the quaternion of a pose."""
    return pose[0], pose[1], sin(0.5 * pose[2]), cos(0.5 * pose[2])


def as_pose(pose: Pose) -> Mapping[str, Any]:
    """Return a pose as geometry_msgs/Pose."""
    x, y, z, w = in_the_plane(pose)
    return {"position": {"x": x, "y": y}, "orientation": {"z": z, "w": w}}


class MapPose(NamedTuple):
    """The robot's present pose on the map: the pose of the last scan, moved by the odometry since then."""

    x: float
    """m."""
    y: float
    """m."""
    theta: float
    """rad."""
    sigma: float
    """Standard deviation of the position, m."""
    turn: float
    """Standard deviation of theta, rad."""
    fit: float
    """Share of the last scan that fits the map, 0 to 1."""
    lost: bool
    """Whether the pose must not be used."""


define("geometry_msgs/PoseArray", "std_msgs/Header header\ngeometry_msgs/Pose[] poses")

WALLS_ON_MAP: Final = declare(
    Topic[tuple[Line, ...]](
        "/map_walls",
        tuple[Line, ...],
        "m",
        "std_msgs/String",
        Rule.SNAPSHOT,
        "the borders of the free floor on the map, for screens",
    )
)
MAP_POSE: Final = declare(
    Topic("/map_pose", MapPose, "m, rad", "std_msgs/String", Rule.SNAPSHOT, "where the robot is on the map now")
)
PARTICLES: Final = declare(
    Topic[tuple[Pose, ...]](
        "/particles",
        tuple[Pose, ...],
        "m, rad",
        "geometry_msgs/PoseArray",
        Rule.EVENT,
        "some of the particles of the filter on the map",
        {"header": {"frame_id": FRAME}},
        make=lambda poses: {"poses": [as_pose(pose) for pose in poses]},
    )
)
SCAN_ON_MAP: Final = declare(
    Topic[Line]("/map_scan", Line, "m", "std_msgs/String", Rule.SNAPSHOT, "where the last scan's rays end on the map")
)


class MapInUse:
    """The map that the robot uses; a part of its runtime, which other parts find by this class."""

    making = False
    """Whether the map is being made."""

    def pose(self) -> MapPose | None:
        """Return the robot's present pose; None while it is unknown."""
        raise NotImplementedError

    def floor(self, remembered: bool = True, lately: bool = False) -> Room | None:
        """Return the walls and `seen` for the planner, in the frame of the pose; None while they are unknown.

        With `remembered` False, obstacles that are not seen now are left out. With `lately`, floor that was not seen
        free lately is none for driving backward.
        """
        raise NotImplementedError

    def seen(self) -> Sequence[tuple[float, float]]:
        """Return the places (m, in the frame of the pose) of things seen near the robot that are not on the map."""
        return ()

    def keep_out(self) -> tuple[Line, ...]:
        """Return the areas of the map that the robot keeps out of, in the frame of the pose."""
        return ()

    def place(self, x: float, y: float, theta: float | None) -> None:
        """Set the robot's pose, m and rad (theta None: any heading); raises CommandRefused."""
        raise NotImplementedError
