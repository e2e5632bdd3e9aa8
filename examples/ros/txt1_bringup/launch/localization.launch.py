"""The robot and robot_localization, whose filter says where base_footprint is in odom.

``ros2 launch txt1_bringup localization.launch.py``: a simulated robot gets a simulated IMU.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

HERE = Path(__file__).parents[1]


def start(context):
    """The robot and the filter for the arguments given."""
    port = LaunchConfiguration("port").perform(context)
    given = {"port": port, "tf": "none", "options": "" if port else "--set sensors.imu.driver=sim_imu"}
    robot = PythonLaunchDescriptionSource(str(HERE / "launch" / "txt1.launch.py"))
    ekf = Node(
        package="robot_localization",
        executable="ekf_node",
        name="ekf_filter_node",
        parameters=[str(HERE / "config" / "robot_localization.yaml")],
    )
    return [IncludeLaunchDescription(robot, launch_arguments=list(given.items())), ekf]


def generate_launch_description():
    """Argument: port (a simulated robot without one)."""
    return LaunchDescription([DeclareLaunchArgument("port", default_value=""), OpaqueFunction(function=start)])
