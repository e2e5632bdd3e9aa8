"""Options that make a robot the original's node of ROS 1."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING, Final

from txt1.additions import Options
from txt1.commands import flag, takes
from txt1.errors import ConfigError

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1_ros1.robot_node import Node

ROS1: Final = {
    "--ros1": flag("be the original's node of ROS 1, txt1_node, at the master of ROS_MASTER_URI"),
    "--ros1-namespace": takes("NS", "namespace of its topics, services and frames, for several robots on one master"),
    "--ros1-auto-arm": flag(
        "arm once by itself, as the original needed no arming: when it has stood for a second without a command; any "
        "program on the master may move the robot from then on"
    ),
    "--ros1-name": takes("NAME", "the node's name in place of txt1_node"),
}


def asked(arguments: Namespace, config: Config) -> Node | None:
    """Return the requested node, None if there is none; raises ConfigError if there is no ROS 1."""
    if not arguments.ros1:
        if arguments.ros1_namespace or arguments.ros1_name or arguments.ros1_auto_arm:
            raise ConfigError("--ros1-namespace, --ros1-name, --ros1-auto-arm: there is no node of ROS 1; add --ros1")
        return None
    if arguments.ros1_auto_arm and arguments.arm is False:
        raise ConfigError("--ros1-auto-arm, --no-arm: give one of them")
    from txt1_ros1.robot_node import Node, python

    namespace = (arguments.ros1_namespace or "").strip("/")
    virtual, auto_arm = arguments.speed is not None, arguments.ros1_auto_arm
    return Node(python(namespace), namespace, arguments.ros1_name or "", virtual, auto_arm)


OPTIONS: Final = Options("ROS 1", ROS1, asked)
