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
    from txt1.bridges.ros.desk import ros_bridge
    from txt1.bridges.ros.install import outdated
    from txt1.bridges.ros.python import home, ros2

    python = ros2()
    say(f"the node runs under {python.where}")
    if python.ours and outdated(home()):
        raise ConfigError("--ros2: the types were made of other definitions; run 'txt1 ros2 install' again")

    def node(robot: Robot) -> AbstractAsyncContextManager[Any]:
        stale = robot.config.commander.timeouts.get("ros", robot.config.safety.command_timeout)
        options = {
            "namespace": arguments.ros2_namespace or "", "stamped": arguments.ros2_stamped, "stale": stale,
            "virtual": arguments.speed is not None,
        }  # fmt: skip
        return ros_bridge(robot, "txt1.bridges.ros.ros2:main", python.program, python.environment, options)

    return node
