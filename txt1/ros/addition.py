"""The nodes of ROS 1 and ROS 2 as an addition."""

from txt1.additions import Addition

ADDITION = Addition(
    name="ros",
    order=130,
    beside="txt1.ros.beside:beside",
    options="txt1.ros.options:OPTIONS",
    sources={"ros": 20, "ros1": 20},
    parts={"txt1.players": {"ros2": "txt1.ros.playback:play"}},
    commands={
        "ros1": ("txt1.ros.command.ros1", "write the original's messages and services as a package of ROS 1"),
        "ros2": ("txt1.ros.command.ros2", "install a ROS 2 for the robot's node, or write its messages as a package"),
    },
)
