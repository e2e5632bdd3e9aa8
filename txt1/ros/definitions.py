"""The robot's own messages, services and actions, as files from which ROS makes types."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Final

from txt1.telemetry.messages import DEFINITIONS
from txt1.version import __version__

OWNERS: Final = ("txt1.robot", "txt1.sensors.readings", "txt1.learning.task")
"""Modules that define their own messages."""
SERVICES: Final = {
    "Place": "float64 x\nfloat64 y\nfloat64 theta\n---\nbool success\nstring message\n",
}
"""``place`` places a simulated robot: m and rad in the room."""
ACTIONS: Final = {
    "DriveTo": (
        "geometry_msgs/PoseStamped pose\nfloat64 speed\n---\nbool arrived\nstring message\n"
        "geometry_msgs/Pose2D reached\n---\nfloat64 distance\ngeometry_msgs/Pose2D pose\n"
    ),
}
"""``drive_to`` drives to a pose of odom, map or room, at most at `speed` m/s (0: 0.4)."""
TF2: Final = {"msg/TFMessage.msg": f"{DEFINITIONS['tf2_msgs/TFMessage']}\n"}
"""The necessary part of the package tf2_msgs, which the wheels lack."""

_MANIFEST: Final = """\
<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>{version}</version>
  <description>{about}</description>
  <maintainer email="robot@example.org">TXT-1</maintainer>
  <license>MIT</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>std_msgs</depend>
  <depend>geometry_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""
_CMAKE: Final = """\
cmake_minimum_required(VERSION 3.20)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
find_package(std_msgs REQUIRED)
find_package(geometry_msgs REQUIRED)
rosidl_generate_interfaces(${{PROJECT_NAME}}
  {files}
  DEPENDENCIES std_msgs geometry_msgs)
ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""


def own() -> dict[str, str]:
    """Return the files of the package txt1_msgs, by name."""
    for module in OWNERS:
        import_module(module)
    messages = {name.partition("/")[2]: text for name, text in DEFINITIONS.items() if name.startswith("txt1_msgs/")}
    return {
        **{f"msg/{name}.msg": f"{text}\n" for name, text in sorted(messages.items())},
        **{f"srv/{name}.srv": text for name, text in SERVICES.items()},
        **{f"action/{name}.action": text for name, text in ACTIONS.items()},
    }


def write_package(folder: Path, name: str, files: dict[str, str], about: str) -> Path:
    """Write a package of definitions that colcon finds and builds; return its folder."""
    package = folder / name
    manifest = {
        "package.xml": _MANIFEST.format(name=name, version=__version__, about=about),
        "CMakeLists.txt": _CMAKE.format(name=name, files="\n  ".join(f'"{each}"' for each in files)),
    }
    for path, text in {**manifest, **files}.items():
        (package / path).parent.mkdir(parents=True, exist_ok=True)
        (package / path).write_text(text)
    return package
