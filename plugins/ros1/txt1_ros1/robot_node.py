"""A robot as the original's node of ROS 1."""

from __future__ import annotations

import os
import subprocess
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final, NamedTuple

from txt1 import Robot
from txt1.errors import ConfigError
from txt1.ros.node import node_beside
from txt1.ros.python import RosPython, clean
from txt1_ros1.robot_end import Ros1Desk

SYSTEM: Final = "/usr/bin/python3"


class Node(NamedTuple):
    """The node that was asked for."""

    python: RosPython
    namespace: str
    """Before the names of its topics, services and frames; "" for none."""
    name: str
    """"" for the original's."""
    virtual: bool
    """Whether ROS gets the robot's time instead of the time of day."""
    auto_arm: bool = False
    """Whether the robot arms once by itself."""


def python(namespace: str = "") -> RosPython:
    """Return the Python for ROS 1, Debian's own; raises ConfigError, with the remedy, if there is none."""
    found = (
        subprocess.run(  # noqa: S603
            [SYSTEM, "-c", "import rospy, genpy"], env=clean(os.environ), capture_output=True, check=False
        )
        if Path(SYSTEM).exists()
        else None
    )
    if found is None or found.returncode != 0:
        raise ConfigError(
            f"--ros1: {SYSTEM} has no rospy: 'apt install python3-rospy python3-rosmaster' (Debian, Ubuntu)"
        )
    names = {"ROS_NAMESPACE": f"/{namespace}"} if namespace else {}
    return RosPython((SYSTEM, "-P"), {**clean(os.environ), **names}, "Debian's rospy")


@asynccontextmanager
async def beside(robot: Robot, node: Node) -> AsyncIterator[None]:
    """Run the node until the block is left."""
    desk = Ros1Desk(robot, node.auto_arm, node.namespace)
    options = {"virtual": node.virtual, "parameters": desk.parameters(), "namespace": node.namespace}
    if node.name:
        options["name"] = node.name
    async with node_beside(robot.runtime, desk, "txt1_ros1.ros1:main", node.python, options):
        yield
