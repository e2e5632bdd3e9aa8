"""The robot, slam_toolbox and nav2: ``ros2 launch txt1_bringup nav2.launch.py``.

nav2's own nav2_params.yaml has values for all its servers; those of ``config/nav2.yaml`` go in their place.
"""

import tempfile
from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

HERE = Path(__file__).parents[1]


def merged(theirs, ours):
    """Parameters with ours in the place of theirs; a plugin of ours has nothing of theirs."""
    if not isinstance(theirs, dict) or not isinstance(ours, dict) or "plugin" in ours:
        return ours
    return theirs | {name: merged(theirs.get(name), value) for name, value in ours.items()}


def start(context):
    """The launch files for the arguments given."""
    share = Path(get_package_share_directory("nav2_bringup"))
    theirs, ours = share / "params" / "nav2_params.yaml", HERE / "config" / "nav2.yaml"
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", delete=False) as file:
        yaml.safe_dump(merged(yaml.safe_load(theirs.read_text()), yaml.safe_load(ours.read_text())), file)
    slam = {"port": LaunchConfiguration("port").perform(context)}
    nav2 = {"params_file": file.name, "use_sim_time": "false"}
    return [
        IncludeLaunchDescription(PythonLaunchDescriptionSource(str(path)), launch_arguments=list(given.items()))
        for path, given in (
            (HERE / "launch" / "slam.launch.py", slam),
            (share / "launch" / "navigation_launch.py", nav2),
        )
    ]


def generate_launch_description():
    """Argument: port (a simulated robot without one)."""
    return LaunchDescription([DeclareLaunchArgument("port", default_value=""), OpaqueFunction(function=start)])
