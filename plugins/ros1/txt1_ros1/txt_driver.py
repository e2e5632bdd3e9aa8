"""The original's package txt_driver: its messages and services, defined here, with the original's md5 sums."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

MESSAGES: Final = {
    "Battery": "Header header\nfloat64 batt1\nfloat64 batt2\nduration expected_time\n",
    "Pwm": "int32 pwm4\nint32 pwm5\n",
    "PidTerms": "Header header\nfloat64 pterm\nfloat64 iterm\nfloat64 dterm\nfloat64 signal\n",
}
SERVICES: Final = {
    "Pid": (
        "float32 kp_lv\nfloat32 ki_lv\nfloat32 kd_lv\nfloat32 kp_av\nfloat32 ki_av\nfloat32 kd_av\n",
        "bool result\n",
    ),
    "PidLoad": ("", "bool result\n"),
    "PwmTest": ("int32 esc\nint32 front\nint32 rear\nint32 pwm4\nint32 pwm5\n", "bool result\n"),
    "SwitchedPwr": ("uint8 SOURCE_ATX=0\nuint8 SOURCE_ESC=1\nuint8 source\nbool on\n", "bool result\n"),
    "Shutdown": ("bool request\n", "bool result\n"),
}
"""Request and response of each service; the node serves all but Pid, which programs in C++ include."""

_MANIFEST: Final = """\
<?xml version="1.0"?>
<package format="2">
  <name>txt_driver</name>
  <version>1.0.0</version>
  <description>Messages and services of the TXT-1's driver</description>
  <maintainer email="robot@example.org">TXT-1</maintainer>
  <license>MIT</license>
  <buildtool_depend>catkin</buildtool_depend>
  <depend>std_msgs</depend>
  <build_depend>message_generation</build_depend>
  <exec_depend>message_runtime</exec_depend>
</package>
"""
_CMAKE: Final = """\
cmake_minimum_required(VERSION 3.5)
project(txt_driver)
find_package(catkin REQUIRED COMPONENTS std_msgs message_generation)
add_message_files(FILES {messages})
add_service_files(FILES {services})
generate_messages(DEPENDENCIES std_msgs)
catkin_package(CATKIN_DEPENDS std_msgs message_runtime)
catkin_install_python(PROGRAMS bin/txt_node DESTINATION ${{CATKIN_PACKAGE_BIN_DESTINATION}})
install(DIRECTORY cfg DESTINATION ${{CATKIN_PACKAGE_SHARE_DESTINATION}})
"""


_NODE: Final = """\
#!/usr/bin/env python3
\"\"\"The node txt_node, which launch files start: `txt1 run --ros1` in their namespace, at the port that they give.

A launch file's args are more options of `txt1 run`. The port sim, or none, is a simulated robot.
\"\"\"

import os
import sys
import xmlrpc.client

given = dict(word.split(":=", 1) for word in sys.argv[1:] if ":=" in word)
name = given.get("__name", "txt1_node")
namespace = given.get("__ns", os.environ.get("ROS_NAMESPACE", "")).strip("/")
place = "/".join(["", *([namespace] if namespace else []), name, "port"])
uri = given.get("__master", os.environ.get("ROS_MASTER_URI", "http://localhost:11311"))
with xmlrpc.client.ServerProxy(uri) as master:
    code, _, port = master.getParam("/" + name, place)
words = ["--hal", "sim"] if code != 1 or port in ("", "sim") else ["--port", str(port)]
words += ["--ros1-name", name] + (["--ros1-namespace", namespace] if namespace else [])
words += [word for word in sys.argv[1:] if ":=" not in word]
os.execvp("txt1", ["txt1", "run", "--headless", "--ros1", *words])
"""


def gains() -> str:
    """Return the file of gains that launch files load as parameters of the node: the robot's own gains."""
    # imported here, because ROS 1's Python cannot import it
    from txt1.config import Config

    config = Config()
    linear = ", ".join(f"{each:g}" for each in config.control.linear.gains())
    rows = [", ".join(f"{each:g}" for each in (s.v_max, s.kp, s.ki, s.kd)) for s in config.control.angular]
    told = ",\n              ".join(rows)
    about = "of each set up to v_max, m/s: v_max, kp, ki, kd"
    return f"# kp, ki, kd\nlinear_pid: [{linear}]\n# {about}\nangular_pid: [{told}]\n"


def write_package(folder: Path) -> Path:
    """Write the package for a catkin workspace, for rostopic, rosservice and programs; return its folder."""
    messages = {f"msg/{name}.msg": text for name, text in MESSAGES.items()}
    services = {f"srv/{name}.srv": f"{asked}---\n{answer}" for name, (asked, answer) in SERVICES.items()}
    names = {
        "messages": " ".join(f"{each}.msg" for each in MESSAGES),
        "services": " ".join(f"{s}.srv" for s in SERVICES),
    }
    own = {
        "package.xml": _MANIFEST,
        "CMakeLists.txt": _CMAKE.format(**names),
        "cfg/pid.yaml": gains(),
        "bin/txt_node": _NODE,
    }
    return write(folder / "txt_driver", {**own, **messages, **services})


def write(package: Path, files: Mapping[str, str]) -> Path:
    """Write a package's files, by their paths in it; return its folder."""
    for path, text in files.items():
        (package / path).parent.mkdir(parents=True, exist_ok=True)
        (package / path).write_text(text)
        if path.startswith("bin/"):
            (package / path).chmod(0o755)
    return package
