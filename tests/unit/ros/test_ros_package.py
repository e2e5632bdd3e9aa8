"""The example of a package: what its launch file starts, and whether its parameters are of this car."""

from __future__ import annotations

import argparse
import os
import runpy
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml
from urdf_parser_py.urdf import URDF

from txt1.cli import run
from txt1.config import Config
from txt1.sensors.mounts import ORIGINAL
from txt1.sensors.sim_laser import LaserParameters

PACKAGE = Path(__file__).parents[3] / "examples" / "ros" / "txt1_bringup"


ARGUMENTS = {
    "txt1": {"port": "", "namespace": "", "tf": "auto", "options": ""},
    **{name: {"port": ""} for name in ("slam", "nav2", "localization", "teleop")},
}


PROCESS = subprocess.run


@cache
def ran(words: tuple[str, ...], **options: bool) -> subprocess.CompletedProcess[str]:
    """A process that has ended. Each launch asks for the same description, so it is started once for all tests."""
    return PROCESS(words, **options)


def launched(
    monkeypatch: pytest.MonkeyPatch, name: str, share: Path = Path("/nowhere"), **given: str
) -> list[SimpleNamespace]:
    """The actions of a launch file with these arguments; in the place of ``launch`` stands as little as it needs."""

    def action(*place: object, **fields: Any) -> SimpleNamespace:
        return SimpleNamespace(place=place, **fields)

    asked = SimpleNamespace(**ARGUMENTS[name] | given)
    names = {
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": lambda package: str(share / package)},
        "launch": {"LaunchDescription": list},
        "launch.actions": {
            "DeclareLaunchArgument": lambda name, default_value: SimpleNamespace(name=name, value=default_value),
            "ExecuteProcess": action,
            "IncludeLaunchDescription": action,
            "OpaqueFunction": action,
        },
        "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Path},
        "launch.substitutions": {
            "LaunchConfiguration": lambda name: SimpleNamespace(perform=lambda context: getattr(context, name)),
        },
        "launch_ros": {},
        "launch_ros.actions": {"Node": action},
        "launch_ros.parameter_descriptions": {"ParameterValue": lambda value, value_type: value_type(value)},
    }
    for module_name, functions in names.items():
        module = ModuleType(module_name)
        vars(module).update(functions)
        monkeypatch.setitem(sys.modules, module_name, module)
    monkeypatch.setattr(subprocess, "run", lambda words, **options: ran(tuple(words), **options))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    *arguments, start = runpy.run_path(str(PACKAGE / "launch" / f"{name}.launch.py"))["generate_launch_description"]()
    assert {each.name: each.value for each in arguments} == ARGUMENTS[name]
    return list(start.function(asked))


def asked_of(include: SimpleNamespace) -> tuple[str, dict[str, str]]:
    """The name of a launch file that is included, and its arguments."""
    return include.place[0].name, dict(include.launch_arguments)


def words_of(include: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> argparse.Namespace:
    """What the robot is started with, when this is included."""
    name, given = asked_of(include)
    assert name == "txt1.launch.py"
    robot, _ = launched(monkeypatch, "txt1", **given)
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    return parser.parse_args(robot.cmd[2:])


def parameters(name: str, node: str) -> dict[str, Any]:
    """The parameters of a node in a file of the package."""
    found: dict[str, Any] = yaml.safe_load((PACKAGE / "config" / f"{name}.yaml").read_text())[node]["ros__parameters"]
    return found


@pytest.mark.parametrize("port", ["", "/dev/ttyUSB0"])
def test_slam_toolbox_alone_says_where_odom_is(port: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, slam = launched(monkeypatch, "slam", port=port)
    told = words_of(robot, monkeypatch)
    assert (told.ros2_tf, told.port) == ("odom", port or None)
    assert told.set == ([] if port else ["sensors.laser.driver=sim_laser"])
    name, given = asked_of(slam)
    assert name == "online_async_launch.py" and given["use_sim_time"] == "false"
    assert Path(given["slam_params_file"]).is_file()
    slam_toolbox = parameters("slam_toolbox", "slam_toolbox")
    assert (slam_toolbox["odom_frame"], slam_toolbox["base_frame"]) == ("odom", "base_footprint")
    assert slam_toolbox["max_laser_range"] == LaserParameters().range_max


def test_the_filter_of_robot_localization_alone_tells_odom_s_child(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, ekf = launched(monkeypatch, "localization")
    told = words_of(robot, monkeypatch)
    assert told.ros2_tf == "none" and told.set == ["sensors.imu.driver=sim_imu"]
    assert (ekf.package, ekf.executable, ekf.name) == ("robot_localization", "ekf_node", "ekf_filter_node")
    assert Path(ekf.parameters[0]).is_file()
    fused = parameters("robot_localization", "ekf_filter_node")
    assert (fused["world_frame"], fused["base_link_frame"]) == ("odom", "base_footprint")
    assert fused["publish_tf"] and fused["two_d_mode"]
    which = {name: [k for k, used in enumerate(fused[f"{name}_config"]) if used] for name in ("odom0", "imu0")}
    assert which == {"odom0": [6, 7, 11], "imu0": [11]}, "vx and vy, which is 0, and the yaw rate"


def test_a_joystick_asks_for_no_more_than_the_car_can(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, joy, teleop = launched(monkeypatch, "teleop")
    assert words_of(robot, monkeypatch).ros2_tf == "auto"
    assert (joy.package, teleop.package, teleop.executable) == ("joy", "teleop_twist_joy", "teleop_node")
    told, config = parameters("teleop_twist_joy", teleop.name), Config()
    v, omega = told["scale_linear"]["x"], told["scale_angular"]["yaw"]
    assert v <= config.safety.v_max and omega == pytest.approx(v / config.geometry.radius_min, abs=0.01)
    assert told["require_enable_button"]
    assert 1.0 / parameters("teleop_twist_joy", joy.name)["autorepeat_rate"] < 0.5 * config.safety.command_timeout


def test_nav2_gets_its_own_parameters_with_those_of_this_car_in_their_place(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    theirs = tmp_path / "nav2_bringup" / "params" / "nav2_params.yaml"
    theirs.parent.mkdir(parents=True)
    server = {"controller_frequency": 99.0, "FollowPath": {"plugin": "dwb", "critics": []}, "min_x": 0.1}
    theirs.write_text(yaml.safe_dump({"controller_server": {"ros__parameters": server}, "docking_server": {"a": 1}}))
    slam, nav2 = launched(monkeypatch, "nav2", tmp_path)
    assert asked_of(slam)[0] == "slam.launch.py"
    name, given = asked_of(nav2)
    assert name == "navigation_launch.py"
    path = Path(given["params_file"])
    told = yaml.safe_load(path.read_text())
    path.unlink()
    control = told["controller_server"]["ros__parameters"]
    assert told["docking_server"] == {"a": 1} and control["min_x"] == 0.1
    assert control["controller_frequency"] == 20.0 and "critics" not in control["FollowPath"]


@pytest.mark.parametrize(
    ("given", "hal", "port"),
    [({}, "sim", None), ({"port": "/dev/ttyUSB0", "namespace": "txt03"}, None, "/dev/ttyUSB0")],
)
def test_the_launch_file_starts_a_robot_with_a_node_and_the_description(
    given: dict[str, str], hal: str | None, port: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, state = launched(monkeypatch, "txt1", **given)
    program, command, *words = robot.cmd
    assert (program, command) == ("txt1", "run")
    parser = argparse.ArgumentParser()
    run.add_arguments(parser)
    told = parser.parse_args(words)
    assert told.ros2 and told.headless and (told.hal, told.port) == (hal, port)
    assert (told.ros2_namespace or "") == state.namespace == given.get("namespace", "")
    assert (state.package, state.executable) == ("robot_state_publisher", "robot_state_publisher")
    described = URDF.from_xml_string(state.parameters[0]["robot_description"].partition("\n")[2])
    assert described.get_root() == "base_footprint"


def test_nav2_is_told_this_car_s_size_radius_speeds_and_frames() -> None:
    config = Config()
    car, told = config.geometry, yaml.safe_load((PACKAGE / "config" / "nav2.yaml").read_text())
    control = told["controller_server"]["ros__parameters"]["FollowPath"]
    plan = told["planner_server"]["ros__parameters"]["GridBased"]
    smooth = told["velocity_smoother"]["ros__parameters"]
    assert car.radius_min <= plan["minimum_turning_radius"] <= 1.2 * car.radius_min
    assert not control["use_rotate_to_heading"], "it cannot"
    assert "spin" not in told["behavior_server"]["ros__parameters"]["behavior_plugins"]
    assert control["desired_linear_vel"] <= smooth["max_velocity"][0] <= config.safety.v_max
    assert -config.safety.v_max <= smooth["min_velocity"][0] < 0.0
    assert smooth["max_velocity"][1] == 0.0 and smooth["max_velocity"][2] <= config.safety.omega_max
    frames = {"map", "odom", "base_footprint", "base_link", *dict(ORIGINAL)}
    for name in ("local_costmap", "global_costmap"):
        costmap = told[name][name]["ros__parameters"]
        corners = yaml.safe_load(costmap["footprint"])
        assert max(x for x, _ in corners) == pytest.approx(0.5 * car.length + car.centre, abs=1e-3)
        assert max(y for _, y in corners) == pytest.approx(0.5 * car.width, abs=1e-3)
        assert {costmap["global_frame"], costmap["robot_base_frame"]} <= frames
        assert costmap["obstacles"]["scan"]["topic"] == "/scan"
        assert set(costmap["plugins"]) <= costmap.keys()
