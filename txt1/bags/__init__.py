"""Recordings that ROS 1 and ROS 2 made: bags."""
