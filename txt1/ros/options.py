"""The options by which a robot, or a board, is a node of ROS."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from txt1.additions import Options
from txt1.commands import flag, takes
from txt1.errors import ConfigError

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.ros.beside import RosNode

ROS2: Final = {
    "--ros2": flag("be a node of ROS 2: an installed one, else that of 'txt1 ros2 install'"),
    "--ros2-namespace": takes("NS", "the node's namespace; none by default"),
}
ROS: Final = ROS2 | {
    "--ros2-stamped": flag("cmd_vel is a TwistStamped"),
    "--ros1": flag("be the original's node of ROS 1, txt1_node, at the master of ROS_MASTER_URI"),
}


def asked(arguments: Namespace, config: Config) -> Sequence[RosNode] | None:
    """Return what makes the robot a node, of each ROS that was asked for; raises ConfigError where there is none."""
    if not (arguments.ros1 or arguments.ros2):
        if arguments.ros2_namespace or arguments.ros2_stamped:
            raise ConfigError("--ros2-namespace, --ros2-stamped: there is no node; add --ros2")
        return None
    from txt1.ros.beside import ros1_node, ros2_node

    return [node for node in (ros1_node(arguments), ros2_node(arguments)) if node is not None]


OPTIONS: Final = Options("ROS", ROS, asked)
