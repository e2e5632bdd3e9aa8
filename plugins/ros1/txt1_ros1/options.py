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
    "--ros1-name": takes("NAME", "the node's name in place of txt1_node"),
}


def asked(arguments: Namespace, config: Config) -> Node | None:
    """Return the requested node, None if there is none; raises ConfigError if there is no ROS 1."""
    if not arguments.ros1:
        if arguments.ros1_namespace or arguments.ros1_name:
            raise ConfigError("--ros1-namespace, --ros1-name: there is no node of ROS 1; add --ros1")
        return None
    from txt1_ros1.robot_node import Node, python

    namespace = (arguments.ros1_namespace or "").strip("/")
    return Node(python(namespace), namespace, arguments.ros1_name or "", arguments.speed is not None)


OPTIONS: Final = Options("ROS 1", ROS1, asked)
