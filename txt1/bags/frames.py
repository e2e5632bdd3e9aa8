"""The frames of a bag: where a laser sits on the robot, by its static transforms."""

from __future__ import annotations

from math import atan2
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STATIC: Final = "/tf_static"
MOVING: Final = "/tf"
TRANSFORMS: Final = ("tf2_msgs/TFMessage", "tf/tfMessage")
BODIES: Final = ("base_footprint", "base_link", "base")
"""Usual names of the robot's own frame."""


class FramePlace(NamedTuple):
    """The place of a device on the robot, in the plane."""

    x: float
    """m."""
    y: float
    """m."""
    yaw: float
    """rad."""
    upside_down: bool = False
    """Whether its z axis points down, so that its angles run clockwise."""


class FrameTree:
    """The newest transform of each pair of frames."""

    def __init__(self) -> None:
        self._to_parent: dict[str, tuple[str, Array]] = {}

    def take(self, message: Any) -> None:
        """Take a message of transforms."""
        for each in message.transforms:
            turn, way = each.transform.rotation, each.transform.translation
            matrix = np.eye(4)
            matrix[:3, :3] = rotation(turn.x, turn.y, turn.z, turn.w)
            matrix[:3, 3] = way.x, way.y, way.z
            self._to_parent[bare(each.child_frame_id)] = bare(each.header.frame_id), matrix

    def place(self, frame: str, body: str | None = None) -> FramePlace | None:
        """Return the place of a frame on the robot; None: no chain leads from it to the robot's frame.

        The robot's frame is `body`, or one of the usual names, the first of `BODIES` that the chain meets last.
        """
        at, matrix, found = bare(frame), np.eye(4), None
        wanted = BODIES if body is None else (bare(body),)
        for _ in range(len(self._to_parent) + 1):
            if at in wanted:
                found = matrix
            if at not in self._to_parent:
                break
            at, step = self._to_parent[at]
            matrix = step @ matrix
        if found is None:
            return None
        return FramePlace(
            float(found[0, 3]), float(found[1, 3]), atan2(found[1, 0], found[0, 0]), bool(found[2, 2] < 0.0)
        )


def bare(frame: str) -> str:
    """Return a frame's name without the slash that ROS 1 may put before it."""
    return frame.removeprefix("/")


def rotation(x: float, y: float, z: float, w: float) -> Array:
    """Return the matrix of a quaternion, which need not have length 1."""
    x, y, z, w = np.array((x, y, z, w)) / (np.linalg.norm((x, y, z, w)) or 1.0)
    return np.array(
        (
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
            (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
            (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
        )
    )


def heading(orientation: Any) -> float:
    """Return the heading of a message's quaternion, rad."""
    matrix = rotation(orientation.x, orientation.y, orientation.z, orientation.w)
    return atan2(matrix[1, 0], matrix[0, 0])
