"""The commands of the bridges to ROS."""
