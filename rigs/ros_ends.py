"""The robot's end of each node of ROS, by the name of its source; of ROS 1's only where its plug-in is installed."""

from importlib.util import find_spec
from typing import Final

from txt1 import additions
from txt1.bridges.registry import RobotEnd
from txt1.ros.robot_end import Ros2RobotEnd

ROS_ENDS: Final[dict[str, type[Ros2RobotEnd] | type[RobotEnd]]] = {"ros": Ros2RobotEnd}
if find_spec("txt1_ros1"):
    from txt1_ros1.robot_end import Ros1Desk

    # so that its source's priority is known
    additions.strangers()
    ROS_ENDS["ros1"] = Ros1Desk
