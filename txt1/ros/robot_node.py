"""A robot, or a board, as a node of ROS 2."""

from __future__ import annotations

import argparse
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any, Final

from txt1.commands import say
from txt1.errors import ConfigError
from txt1.navigation import fused_pose, true_pose
from txt1.robot import Robot
from txt1.ros.install import outdated
from txt1.ros.node import node_beside
from txt1.ros.publisher import Told, Transforms
from txt1.ros.python import RosPython, home, ros2

ASKED: Final = {"map": fused_pose, "room": true_pose}
"""Sources of the frame above odom; NotCapable if the robot does not know it."""
NODE: Final = "txt1.ros.ros2:main"
RosNode = Callable[[Robot], AbstractAsyncContextManager[Any]]
"""Makes a robot a node of ROS 2 until the block is left."""


@asynccontextmanager
async def beside(robot: Robot, node: RosNode) -> AsyncIterator[None]:
    """Run the node until the block is left."""
    async with node(robot):
        yield


def ros2_node(arguments: argparse.Namespace) -> RosNode:
    """Return the function that makes the robot a node of ROS 2; raises ConfigError without ROS 2."""
    from txt1.ros.robot_end import Ros2RobotEnd

    python = ros2_python()
    namespace = (arguments.ros2_namespace or "").strip("/")
    tf: Transforms = arguments.ros2_tf or "auto"
    told = Told(tf, f"{namespace}/" if arguments.ros2_prefix else "", namespace, arguments.ros2_ackermann)

    def node(robot: Robot) -> AbstractAsyncContextManager[Any]:
        if tf in ASKED:
            ASKED[tf](robot)
        desk = Ros2RobotEnd(robot, told)
        options = {
            "namespace": namespace,
            "owner": namespace,
            "child": f"{told.prefix}odom" if tf == "auto" else "",
            "best_effort": arguments.ros2_best_effort,
            "offers": desk.offers,
            "stamped": arguments.ros2_stamped,
            "ackermann": arguments.ros2_ackermann,
            "stale": desk.stale,
            "virtual": arguments.speed is not None,
            "parameters": desk.parameters(),
        }
        return node_beside(robot.runtime, desk, NODE, python, options)

    return node


def ros2_python() -> RosPython:
    """Return the Python for a node of ROS 2, and print it; raises ConfigError."""
    python = ros2()
    say(f"the node runs under {python.where}")
    if python.ours and outdated(home()):
        raise ConfigError("--ros2: the types were made of other definitions; run 'txt1 ros2 install' again")
    return python
