"""The options by which a robot is a node of ROS."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Any

from txt1.cli.app import say
from txt1.errors import ConfigError
from txt1.robot import Robot

RosNode = Callable[[Robot], AbstractAsyncContextManager[Any]]
"""Makes a robot a node of ROS as long as the block is at work."""


def ros2_node(arguments: argparse.Namespace) -> RosNode | None:
    """Return what makes the robot a node of ROS 2, if it is to be one; raises ConfigError where there is no ROS 2."""
    if not arguments.ros2:
        if arguments.ros2_namespace or arguments.ros2_stamped:
            raise ConfigError("--ros2-namespace, --ros2-stamped: there is no node; add --ros2")
        return None
    from txt1.bridges.ros.desk import Ros2Desk, node_beside
    from txt1.bridges.ros.install import outdated
    from txt1.bridges.ros.python import home, ros2

    python = ros2()
    say(f"the node runs under {python.where}")
    if python.ours and outdated(home()):
        raise ConfigError("--ros2: the types were made of other definitions; run 'txt1 ros2 install' again")

    def node(robot: Robot) -> AbstractAsyncContextManager[Any]:
        desk = Ros2Desk(robot)
        options = {
            "namespace": arguments.ros2_namespace or "", "stamped": arguments.ros2_stamped, "stale": desk.stale,
            "virtual": arguments.speed is not None, "parameters": desk.parameters(),
        }  # fmt: skip
        return node_beside(robot, desk, "txt1.bridges.ros.ros2:main", python.program, python.environment, options)

    return node


def ros1_node(arguments: argparse.Namespace) -> RosNode | None:
    """Return what makes the robot the original's node of ROS 1, if it is to be; raises ConfigError without ROS 1."""
    if not arguments.ros1:
        return None
    from txt1.bridges.ros.desk import node_beside
    from txt1.bridges.ros.original import Ros1Desk
    from txt1.bridges.ros.python import ros1

    python = ros1()
    options = {"virtual": arguments.speed is not None}

    def node(robot: Robot) -> AbstractAsyncContextManager[Any]:
        desk = Ros1Desk(robot)
        given = options | {"parameters": desk.parameters()}
        return node_beside(robot, desk, "txt1.bridges.ros.ros1:main", python.program, python.environment, given)

    return node
