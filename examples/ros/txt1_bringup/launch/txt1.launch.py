"""The robot, and the transforms of its wheels: ``ros2 launch txt1_bringup txt1.launch.py port:=/dev/ttyUSB0``."""

import shlex
import subprocess

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {"port": "", "namespace": "", "tf": "auto", "options": ""}


def start(context):
    """The processes for the arguments given."""
    port, namespace, tf, options = (LaunchConfiguration(name).perform(context) for name in ARGUMENTS)
    command = [
        "txt1",
        "run",
        "--headless",
        "--ros2",
        "--ros2-tf",
        tf,
        *(["--port", port] if port else ["--hal", "sim"]),
    ]
    if namespace:
        command += ["--ros2-namespace", namespace]
    command += shlex.split(options)
    urdf = subprocess.run(["txt1", "ros2", "urdf"], capture_output=True, text=True, check=True).stdout
    state = Node(
        package="robot_state_publisher",
        executable="robot_state_publisher",
        namespace=namespace,
        parameters=[{"robot_description": ParameterValue(urdf, value_type=str)}],
    )
    return [ExecuteProcess(cmd=command, output="screen"), state]


def generate_launch_description():
    """Arguments: port (a simulated robot without one), namespace, tf (as --ros2-tf), options (more of txt1 run)."""
    arguments = [DeclareLaunchArgument(name, default_value=value) for name, value in ARGUMENTS.items()]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
