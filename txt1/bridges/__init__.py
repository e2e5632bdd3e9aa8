"""Processes that connect the robot with other programs: each is one module and one registration."""
