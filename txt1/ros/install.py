"""An own ROS 2: wheels in a virtual environment, and the types that they lack."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Final

from txt1.errors import ConfigError
from txt1.ros.definitions import TF2, own, write_package
from txt1.ros.python import clean

INTERFACES: Final = Path(__file__).with_name("interfaces.py")
# the definitions from which types were made
STATE: Final = "txt1_msgs.txt"

_MESSAGES: Final = ("std", "geometry", "nav", "sensor", "diagnostic")


def _pins(rclpy: str, middleware: str, messages: str, **others: str) -> tuple[str, ...]:
    named = {f"ros-{name}-msgs": messages for name in _MESSAGES} | {"ros-std-srvs": messages}
    named |= {"ros-rclpy": rclpy, "ros-rmw-fastrtps-cpp": middleware}
    named |= {name.replace("_", "-"): version for name, version in others.items()}
    return tuple(f"{name}=={version}" for name, version in named.items())


WHEELS: Final = {
    "jazzy": _pins("7.1.6", "8.4.3", "5.3.6", ros_rosidl_adapter="4.6.6"),
    "kilted": _pins(
        "9.1.2", "9.3.3", "5.5.1", ros_rosgraph_msgs="2.3.0", ros_builtin_interfaces="2.3.0", ros_rosidl_adapter="4.9.5"
    ),
}
"""Wheels of a distribution that fit together."""
MAKING, FETCHING = "making the environment", "installing the wheels"
TYPES: Final = "making types (gcc and g++ are needed)"
# shares of the work: wheels are being fetched, and are installed
FETCHED, INSTALLED = (0.05, 0.5), 0.7
# a dependency that the generators' wheels do not declare
GENERATING: Final = ("catkin-pkg",)


Told = Callable[[float, str], None]
"""Takes the share of the work that is done, 0 to 1, and what is being done."""


def install(place: Path, distribution: str, told: Told = lambda share, doing: None) -> None:
    """Make the environment, or update its types; raises ConfigError if that is impossible."""
    if sys.platform != "linux" or os.uname().machine != "x86_64":
        raise ConfigError("txt1 ros2 install: there are wheels for Linux on x86-64 alone; install ROS 2 itself here")
    python = place / "bin" / "python"
    if not python.exists():
        told(0.0, MAKING)
        _run(MAKING, sys.executable, "-m", "venv", str(place))
    wanted, collected = [*WHEELS[distribution], *GENERATING], 0

    def line_of_pip(line: str) -> None:
        nonlocal collected
        if line.startswith("Collecting "):
            # each wheel that is wanted needs about one more
            collected += 1
            told(FETCHED[0] + (FETCHED[1] - FETCHED[0]) * min(1.0, collected / (2.0 * len(wanted))), FETCHING)
        elif line.startswith("Installing collected"):
            told(FETCHED[1], FETCHING)

    told(FETCHED[0], FETCHING)
    pip = ("-m", "pip", "--disable-pip-version-check", "install", "--progress-bar", "off", *wanted)
    _run(FETCHING, str(python), *pip, told=line_of_pip)
    told(INSTALLED, TYPES)
    definitions = own()
    with tempfile.TemporaryDirectory() as folder:
        write_package(Path(folder), "tf2_msgs", TF2, "transforms")
        write_package(Path(folder), "txt1_msgs", definitions, "the TXT-1's own messages")
        _run(TYPES, str(python), "-P", str(INTERFACES), folder, "tf2_msgs", "txt1_msgs")
    (place / STATE).write_text(state(definitions))


def state(definitions: dict[str, str]) -> str:
    """Return the definitions as text, for comparison."""
    return "".join(f"== {name}\n{text}" for name, text in definitions.items())


def outdated(place: Path) -> bool:
    """Return whether the types there were made from other definitions than the present."""
    made = place / STATE
    return not made.exists() or made.read_text() != state(own())


def _run(doing: str, *words: str, told: Callable[[str], None] = lambda line: None) -> None:
    """Run a program, and pass on its lines; raises ConfigError with the last of them if it fails."""
    last: deque[str] = deque(maxlen=3)
    with subprocess.Popen(  # noqa: S603
        words, env=clean(os.environ), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as program:
        assert program.stdout is not None
        for line in program.stdout:
            if line.strip():
                last.append(line.strip())
            told(line)
    if program.returncode != 0:
        raise ConfigError(f"{doing}: {' / '.join(last)}")
