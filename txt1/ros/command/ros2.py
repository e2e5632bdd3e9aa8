"""`txt1 ros2`: the ROS 2 for the robot's node."""

from __future__ import annotations

import argparse

from rich.progress import TaskProgressColumn, TimeElapsedColumn

from txt1.commands import OK, add_actions, path, say, takes
from txt1.kit.options import CONFIGURATION, loaded


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions."""
    which = {
        "--distribution": {
            "choices": ("jazzy", "kilted"),
            "default": "jazzy",
            "help": "distribution of ROS 2; jazzy by default",
        },
    }
    place = {"folder": takes("FOLDER", "such as the src of a colcon workspace", path)}
    add_actions(
        parser,
        {
            "install": (install, which),
            "info": (show, {}),
            "package": (package, place),
            "urdf": (urdf, CONFIGURATION),
        },
    )


def install(arguments: argparse.Namespace) -> int:
    """Install a ROS 2 of its own from wheels (Linux on x86-64; 280 MB), with the robot's types."""
    from txt1.ros import install
    from txt1.ros.python import home
    from txt1.trials.run import progress

    place, before = home(), ""
    say(f"installing ROS 2 {arguments.distribution} into {place}, which takes some minutes")
    with progress("beginning", 1.0, TaskProgressColumn(), TimeElapsedColumn()) as bar:

        def told(share: float, doing: str) -> None:
            nonlocal before
            bar.update(bar.task_ids[0], completed=share, description=doing)
            if doing != before and bar.disable:
                # without a terminal a line for each part
                say(doing)
            before = doing

        install.install(place, arguments.distribution, told)
    print(f"ROS 2 {arguments.distribution} is in {place}; 'txt1 run --ros2' uses it where no other is installed")
    return OK


def show(arguments: argparse.Namespace) -> int:
    """Print the ROS 2 under which the node runs."""
    from txt1.ros.python import ros2

    print(ros2().where)
    return OK


def package(arguments: argparse.Namespace) -> int:
    """Write the robot's messages as a package that colcon builds."""
    from txt1.ros.definitions import own, write_package

    print(write_package(arguments.folder, "txt1_msgs", own(), "messages of the TXT-1"))
    return OK


def urdf(arguments: argparse.Namespace) -> int:
    """Print the URDF of the configured robot, without its sensors, which tell their places themselves."""
    from txt1.ros.urdf import robot_description

    config = loaded(arguments).config
    print(robot_description(config.name, config.geometry), end="")
    return OK
