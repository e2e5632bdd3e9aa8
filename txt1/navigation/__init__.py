"""Driving to places through the Robot API: along waypoints by look-ahead, and to a pose, in both gears.

::

    source = true_pose(robot)                       # or wheel_pose(robot), the default: from the encoders
    await go_to(robot, (1.0, 0.5, 0.0), pose_source=source, room=Room(5.0, 5.0))
    await follow(robot, [(1.5, 2.0), (-1.5, 2.0)], laps=3)
"""

from txt1.model.reeds_shepp import Pose
from txt1.navigation.goto import Arrival, go_to, go_to_places
from txt1.navigation.plan import NoPath, plan
from txt1.navigation.pose_source import (
    PoseSource,
    best_pose,
    fused_pose,
    located,
    map_floor,
    map_pose,
    true_pose,
    wheel_pose,
)
from txt1.navigation.waypoints import follow

__all__ = [
    "Arrival",
    "NoPath",
    "Pose",
    "PoseSource",
    "best_pose",
    "follow",
    "fused_pose",
    "go_to",
    "go_to_places",
    "located",
    "map_floor",
    "map_pose",
    "plan",
    "true_pose",
    "wheel_pose",
]
