"""The original's node of ROS 1 beside a robot of txt1, and bags of ROS 1 of recordings."""
