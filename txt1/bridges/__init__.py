"""Processes that connect the robot with other programs. A bridge is a module and a registration."""
