"""The original's node of ROS 1 as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="ros1",
    order=130,
    beside="txt1_ros1.robot_node:beside",
    options="txt1_ros1.options:OPTIONS",
    sources={"ros1": 20},
    commands={"ros1": ("txt1_ros1.command", "write the original's messages, services and launch files as packages")},
)
