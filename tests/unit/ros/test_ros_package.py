"""The example of a package: what its launch file starts, and whether its parameters are of this car."""

from __future__ import annotations

import argparse
import os
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml
from urdf_parser_py.urdf import URDF

from txt1.cli import run
from txt1.config import Config
from txt1.ros.urdf import links_of
from txt1.sensors.readings import Scan

PACKAGE = Path(__file__).parents[3] / "examples" / "ros" / "txt1_bringup"


def launched(monkeypatch: pytest.MonkeyPatch, **given: str) -> list[SimpleNamespace]:
    """The actions of the launch file with these arguments; in the place of ``launch`` stands as little as it needs."""

    def action(*_: object, **fields: Any) -> SimpleNamespace:
        return SimpleNamespace(**fields)

    asked = SimpleNamespace(**{"port": "", "namespace": ""} | given)
    names = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {
            "DeclareLaunchArgument": lambda name, default_value: SimpleNamespace(name=name, value=default_value),
            "ExecuteProcess": action,
            "OpaqueFunction": action,
        },
        "launch.substitutions": {
            "LaunchConfiguration": lambda name: SimpleNamespace(perform=lambda context: getattr(context, name)),
        },
        "launch_ros": {},
        "launch_ros.actions": {"Node": action},
        "launch_ros.parameter_descriptions": {"ParameterValue": lambda value, value_type: value_type(value)},
    }
    for name, functions in names.items():
        module = ModuleType(name)
        vars(module).update(functions)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    *arguments, start = runpy.run_path(str(PACKAGE / "launch" / "txt1.launch.py"))["generate_launch_description"]()
    assert {each.name: each.value for each in arguments} == {"port": "", "namespace": ""}
    return list(start.function(asked))


@pytest.mark.parametrize(
    ("given", "hal", "port"),
    [({}, "sim", None), ({"port": "/dev/ttyUSB0", "namespace": "txt03"}, None, "/dev/ttyUSB0")],
)
def test_the_launch_file_starts_a_robot_with_a_node_and_the_description(
    given: dict[str, str], hal: str | None, port: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, state = launched(monkeypatch, **given)
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
    frames = {"map", "odom", "base_footprint", *links_of([Scan])}
    for name in ("local_costmap", "global_costmap"):
        costmap = told[name][name]["ros__parameters"]
        corners = yaml.safe_load(costmap["footprint"])
        assert max(x for x, _ in corners) == pytest.approx(0.5 * car.length + car.centre, abs=1e-3)
        assert max(y for _, y in corners) == pytest.approx(0.5 * car.width, abs=1e-3)
        assert {costmap["global_frame"], costmap["robot_base_frame"]} <= frames
        assert costmap["obstacles"]["scan"]["topic"] == "/scan"
        assert set(costmap["plugins"]) <= costmap.keys()
