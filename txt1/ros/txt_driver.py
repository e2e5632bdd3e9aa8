"""The original's package txt_driver: its messages and services, by our own definitions with the original's md5 sums."""

from pathlib import Path
from typing import Final

MESSAGES: Final = {
    "Battery": "Header header\nfloat64 batt1\nfloat64 batt2\nduration expected_time\n",
    "Pwm": "int32 pwm4\nint32 pwm5\n",
}
SERVICES: Final = {
    "PidLoad": ("", "bool result\n"),
    "PwmTest": ("int32 esc\nint32 front\nint32 rear\nint32 pwm4\nint32 pwm5\n", "bool result\n"),
    "SwitchedPwr": ("uint8 SOURCE_ATX=0\nuint8 SOURCE_ESC=1\nuint8 source\nbool on\n", "bool result\n"),
    "Shutdown": ("bool request\n", "bool result\n"),
}
"""Request and response of each."""

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
"""


def write_package(folder: Path) -> Path:
    """Write the package for a catkin workspace, for rostopic, rosservice and programs; its folder."""
    package = folder / "txt_driver"
    messages = {f"msg/{name}.msg": text for name, text in MESSAGES.items()}
    services = {f"srv/{name}.srv": f"{asked}---\n{answer}" for name, (asked, answer) in SERVICES.items()}
    names = {
        "messages": " ".join(f"{each}.msg" for each in MESSAGES),
        "services": " ".join(f"{s}.srv" for s in SERVICES),
    }
    for path, text in {
        "package.xml": _MANIFEST,
        "CMakeLists.txt": _CMAKE.format(**names),
        **messages,
        **services,
    }.items():
        (package / path).parent.mkdir(parents=True, exist_ok=True)
        (package / path).write_text(text)
    return package
