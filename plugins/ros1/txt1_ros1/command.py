"""`txt1 ros1`: files that programs of ROS 1 need for the robot's node."""

from __future__ import annotations

import argparse

from txt1.commands import OK, add_actions, path, takes
from txt1_ros1.txt_driver import write, write_package
from txt1_ros1.txt_launch import files


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the action."""
    add_actions(
        parser, {"package": (package, {"folder": takes("FOLDER", "such as the src of a catkin workspace", path)})}
    )


def package(arguments: argparse.Namespace) -> int:
    """Write the original's packages txt_driver (messages, services) and txt_launch, which catkin builds."""
    print(write_package(arguments.folder))
    print(write(arguments.folder / "txt_launch", files()))
    return OK
