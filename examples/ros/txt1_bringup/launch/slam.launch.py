"""The robot and slam_toolbox, which says where odom is on its map: ``ros2 launch txt1_bringup slam.launch.py``.

A simulated robot gets a simulated laser; for a real one, its laser is in its settings (txt1.yaml).
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

HERE = Path(__file__).parents[1]


def start(context):
    """The launch files for the arguments given."""
    port = LaunchConfiguration("port").perform(context)
    options = "" if port else "--set sensors.laser.driver=sim_laser"
    robot = {"port": port, "tf": "odom", "options": options}
    slam = {"slam_params_file": str(HERE / "config" / "slam_toolbox.yaml"), "use_sim_time": "false"}
    theirs = Path(get_package_share_directory("slam_toolbox")) / "launch" / "online_async_launch.py"
    return [
        IncludeLaunchDescription(PythonLaunchDescriptionSource(str(path)), launch_arguments=list(given.items()))
        for path, given in ((HERE / "launch" / "txt1.launch.py", robot), (theirs, slam))
    ]


def generate_launch_description():
    """Argument: port (a simulated robot without one)."""
    return LaunchDescription([DeclareLaunchArgument("port", default_value=""), OpaqueFunction(function=start)])
