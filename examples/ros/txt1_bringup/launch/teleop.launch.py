"""The robot and a joystick: ``ros2 launch txt1_bringup teleop.launch.py``; button 0 is to be held."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = Path(__file__).parents[1]


def start(context):
    """The robot and the two nodes for the arguments given."""
    robot = PythonLaunchDescriptionSource(str(HERE / "launch" / "txt1.launch.py"))
    given = {"port": LaunchConfiguration("port").perform(context)}
    parameters = [str(HERE / "config" / "teleop_twist_joy.yaml")]
    return [
        IncludeLaunchDescription(robot, launch_arguments=list(given.items())),
        Node(package="joy", executable="joy_node", name="joy_node", parameters=parameters),
        Node(package="teleop_twist_joy", executable="teleop_node", name="teleop_twist_joy_node", parameters=parameters),
    ]


def generate_launch_description():
    """Argument: port (a simulated robot without one)."""
    return LaunchDescription([DeclareLaunchArgument("port", default_value=""), OpaqueFunction(function=start)])
