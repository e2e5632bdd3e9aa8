"""The bridges to ROS: the robot's end, and the nodes, which run under the Python of ROS."""
