"""Options that make a robot, or a board, a node of ROS 2."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING, Final

from txt1.additions import Options
from txt1.commands import flag, takes
from txt1.errors import ConfigError

if TYPE_CHECKING:
    from txt1.config import Config
    from txt1.ros.robot_node import RosNode

ROS2: Final = {
    "--ros2": flag("be a node of ROS 2: an installed one, else that of 'txt1 ros2 install'"),
    "--ros2-namespace": takes("NS", "the node's namespace; none by default"),
    "--ros2-best-effort": flag("sensors' topics are best effort, for lossy networks; RViz hides them by default"),
}
ROS: Final = ROS2 | {
    "--ros2-tf": {
        "choices": ("auto", "map", "room", "odom", "none"),
        "help": "the moving transforms: auto: odom -> base_footprint, and map or room -> odom until another program "
        "tells it; map, room: always this frame above odom; odom: no frame above odom; none: none at all",
    },
    "--ros2-prefix": flag("frames' names begin with the namespace, such as car1/odom"),
    "--ros2-stamped": flag("cmd_vel is a TwistStamped"),
    "--ros2-ackermann": flag("drive commands, too (AckermannDriveStamped), and ~/drive tells speed and steering angle"),
}
ONLY_OF_ROS2: Final = ("ros2_namespace", "ros2_best_effort", "ros2_tf", "ros2_prefix", "ros2_stamped", "ros2_ackermann")


def asked(arguments: Namespace, config: Config) -> RosNode | None:
    """Return the function that makes the robot a node of ROS 2, None if not requested; raises ConfigError."""
    given = [f"--{name.replace('_', '-')}" for name in ONLY_OF_ROS2 if getattr(arguments, name)]
    if given and not arguments.ros2:
        raise ConfigError(f"{', '.join(given)}: there is no node of ROS 2; add --ros2")
    if arguments.ros2_prefix and not arguments.ros2_namespace:
        raise ConfigError("--ros2-prefix: there is no namespace; add --ros2-namespace NS")
    if not arguments.ros2:
        return None
    from txt1.ros.robot_node import ros2_node

    return ros2_node(arguments)


OPTIONS: Final = Options("ROS 2", ROS, asked)
