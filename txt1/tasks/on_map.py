"""What screens draw of the map that a robot drives in, or makes: its walls, and where the robot is on it.

Nothing here reads a map, so screens load it in no time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from txt1.telemetry.topics import Rule, Topic, declare

if TYPE_CHECKING:
    from collections.abc import Sequence

    from txt1.sim.room import Room

Line = tuple[tuple[float, float], ...]
"""Corners (x, y), m, the last one joined to the first."""


class MapPose(NamedTuple):
    """Where the robot is on the map now: the pose of the last scan, and odometry since."""

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
    """Whether the pose is not to be used."""


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
PARTICLES_ON_MAP: Final = declare(
    Topic[Line]("/map_particles", Line, "m", "std_msgs/String", Rule.SNAPSHOT, "where the robot may be on the map")
)
SCAN_ON_MAP: Final = declare(
    Topic[Line]("/map_scan", Line, "m", "std_msgs/String", Rule.SNAPSHOT, "where the last scan's rays end on the map")
)


class MapInUse:
    """The map of a robot, whoever knows where the robot is on it: a part of its runtime, found by this class."""

    making = False
    """Whether the map is in the making."""

    def pose(self) -> MapPose | None:
        """Return where the robot is now; None: nothing is known yet."""
        raise NotImplementedError

    def floor(self) -> Room | None:
        """Return the walls, and what is `seen`, to plan round, in the frame of the pose; None: they are not known."""
        raise NotImplementedError

    def seen(self) -> Sequence[tuple[float, float]]:
        """Return what is seen near the robot now that the map does not have: places, m, in the frame of the pose."""
        return ()

    def place(self, x: float, y: float, theta: float | None) -> None:
        """Say where the robot is, m and rad (None: with any heading); raises CommandRefused."""
        raise NotImplementedError
