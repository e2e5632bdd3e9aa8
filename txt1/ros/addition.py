"""The node of ROS 2 as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="ros",
    order=130,
    beside="txt1.ros.robot_node:beside",
    options="txt1.ros.options:OPTIONS",
    sources={"ros": 20},
    parts={"txt1.players": {"ros2": "txt1.ros.playback:play"}},
    commands={
        "ros2": ("txt1.ros.command.ros2", "install a ROS 2 for the robot's node, or write its messages as a package"),
    },
)
